"""Two or more diagnoses side by side, read from their diagnosis.json: gaps, verdicts, causes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pinotwin.analysis.comparison import effect_title
from pinotwin.errors import InputError


@dataclass(frozen=True)
class Diagnoses:
    """Diagnoses side by side.

    Attributes:
        labels: name of each.
        documents: the content of each diagnosis.json.
    """

    labels: tuple[str, ...]
    documents: tuple[Mapping[str, Any], ...]

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
        """Axis -> signal -> label -> gap."""
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
                single.append(f"{name} only in {', '.join(found)}")
        if not common and not single:
            return "No diagnosis names a cause."
        shared = f"Found in all: {', '.join(common)}" if common else "No cause is found in all"
        return f"{shared}; {'; '.join(single)}." if single else f"{shared}."

    def to_dict(self) -> dict[str, Any]:
        """Return the content of compare.json."""
        return {
            "kind": "diagnoses",
            "labels": list(self.labels),
            "sentence": self.sentence,
            "verdicts": {
                label: document.get("verdict")
                for label, document in zip(self.labels, self.documents, strict=True)
            },
            "gap": self.gap,
            "causes": [
                {"effect": effect, "axis": axis or None, "title": effect_title(effect), "in": found}
                for (effect, axis), found in self.causes.items()
            ],
        }


def read_diagnoses(folders: Sequence[str | Path], labels: Sequence[str]) -> Diagnoses:
    """Read diagnoses from their folders or from their diagnosis.json.

    Raises:
        InputError: a folder holds none, or it cannot be read.
    """
    documents = []
    for folder in folders:
        path = Path(folder) / "diagnosis.json" if Path(folder).is_dir() else Path(folder)
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, json.JSONDecodeError, UnicodeDecodeError) as error:
            raise InputError(f"{path}: not a diagnosis ({error}); give what `diagnose --out` wrote") from None
        if not isinstance(content, dict) or "verdict" not in content:
            raise InputError(f"{path}: not a diagnosis; give what `diagnose --out` wrote")
        documents.append(content)
    return Diagnoses(tuple(labels), tuple(documents))
