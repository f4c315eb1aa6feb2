"""Two or more diagnoses side by side, read from their diagnosis.json: residuals, verdicts, causes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pinotwin.analysis.comparison import Compared, Comparison, effect_title
from pinotwin.analysis.comparison import compare as twins_compared
from pinotwin.errors import InputError
from pinotwin.logs.files import LogLike
from pinotwin.notebook import Shown


@dataclass(frozen=True, repr=False)
class Diagnoses(Compared):
    """Diagnoses side by side."""

    labels: tuple[str, ...]  # name of each
    documents: tuple[Mapping[str, Any], ...]  # the content of each diagnosis.json

    @property
    def causes(self) -> dict[tuple[str, str], dict[str, Mapping[str, Any]]]:
        """(effect, axis) -> label -> the effect as that diagnosis found it."""
        out: dict[tuple[str, str], dict[str, Mapping[str, Any]]] = {}
        for label, document in zip(self.labels, self.documents, strict=True):
            for effect in document.get("effects", ()):
                out.setdefault((effect["effect"], effect.get("axis") or ""), {})[label] = effect
        return out

    @property
    def gap(self) -> dict[str, dict[str, dict[str, Mapping[str, Any]]]]:
        """Axis -> signal -> label -> residual."""
        out: dict[str, dict[str, dict[str, Mapping[str, Any]]]] = {}
        for label, document in zip(self.labels, self.documents, strict=True):
            for axis, signals in document.get("gap", {}).items():
                for signal, row in signals.items():
                    out.setdefault(axis, {}).setdefault(signal, {})[label] = row
        return out

    @property
    def sentence(self) -> str:
        """The result in one sentence."""
        common, single = [], []
        for (effect, axis), found in self.causes.items():
            name = f"{effect_title(effect)} on {axis}" if axis else effect_title(effect)
            if len(found) == len(self.labels):
                common.append(name)
            else:
                single.append(f"Only {', '.join(found)}: {name}")
        if not common and not single:
            return "No diagnosis names a cause."
        shared = [f"Found in all: {', '.join(common)}"] if common else []
        return ". ".join([*shared, *single]) + "."

    def _shown(self) -> Shown:
        rows = [(f"{effect} on {axis}", ", ".join(found)) for (effect, axis), found in self.causes.items()]
        return "Diagnoses side by side", ("cause", "found in"), rows, self.sentence

    def to_dict(self) -> dict[str, Any]:
        """Return the content of compare.json."""
        verdicts = [document.get("verdict") for document in self.documents]
        return {
            "kind": "diagnoses",
            "labels": list(self.labels),
            "sentence": self.sentence,
            "verdicts": dict(zip(self.labels, verdicts, strict=True)),
            "gap": self.gap,
            "causes": [
                {"effect": effect, "axis": axis or None, "title": effect_title(effect), "in": found}
                for (effect, axis), found in self.causes.items()
            ],
        }


def compare(
    *subjects: Any, labels: Sequence[str] | None = None, log: LogLike | None = None
) -> Comparison | Diagnoses:
    """Put twins of one machine, or diagnoses, side by side, in the order of time.

    Args:
        subjects: two twins or more, or two diagnoses or more; or their folders.
        labels: name of each; ``1``, ``2``... where None.
        log: on which every twin is judged; without it parameters alone are compared.

    Raises:
        InputError: fewer than two, twins beside diagnoses, or twins of different machines.
    """
    kinds = {_is_diagnosis(one) for one in subjects}
    if len(subjects) < 2:
        raise InputError("compare: give two twins or more, or two diagnoses or more")
    if len(kinds) > 1:
        raise InputError("compare: give twins or diagnoses, not both")
    if not kinds.pop():
        return twins_compared(*subjects, labels=labels, log=log)
    if log is not None:
        raise InputError("compare: a log is for twins; a diagnosis holds its logs already")
    names = labels or [str(k + 1) for k in range(len(subjects))]
    return Diagnoses(tuple(names), tuple(map(_document, subjects)))


def _is_diagnosis(given: Any) -> bool:
    if isinstance(given, str | Path):
        return Path(given).name == "diagnosis.json" or (Path(given) / "diagnosis.json").is_file()
    return hasattr(given, "verdict")


def _document(given: Any) -> Mapping[str, Any]:
    if hasattr(given, "verdict"):
        content: Any = given.to_dict()
        return dict(content)
    path = Path(given) / "diagnosis.json" if Path(given).is_dir() else Path(given)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a diagnosis ({error}); give what `diagnose --out` wrote") from None
    if not isinstance(content, dict) or "verdict" not in content:
        raise InputError(f"{path}: not a diagnosis; give what `diagnose --out` wrote")
    return content
