"""The file of figures: what one is, how they are kept, and the page made of them."""

from __future__ import annotations

import datetime
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from pinotwin.system.writing import write_text

DOCS = Path(__file__).resolve().parents[2] / "docs"
FILE, PAGE = DOCS / "figures.json", DOCS / "figures.md"

Kind = Literal["unseen", "fitted", "development", "construction"]
KINDS: Mapping[str, str] = {
    "unseen": "on data that were not fitted, with rules that were set before",
    "fitted": "on the data that were fitted",
    "development": "on cases that were looked at while the rules were set: no estimate for unseen ones",
    "construction": "true by construction: what is compared was made from the same equations or numbers",
}


@dataclass(frozen=True)
class Figure:
    """One figure.

    Attributes:
        name: short, unique within its part.
        what: in words.
        value: the number.
        unit: of value, low and high; ``%``, a unit, or empty for counts.
        kind: on what it was measured, a key of :data:`KINDS`.
        of: for a count, of how many.
        low: lowest over seeds or cases.
        high: highest.
        published: the same figure as its source states it.
        plain: the same figure of a regressor and least squares, see :mod:`benchmarks._plain`.
        note: what else a reader must know.
    """

    name: str
    what: str
    value: float
    unit: str = "%"
    kind: Kind = "unseen"
    of: int | None = None
    low: float | None = None
    high: float | None = None
    published: float | str | None = None
    plain: float | None = None
    note: str = ""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"{self.name}: kind {self.kind!r}; known: {', '.join(KINDS)}")


def read() -> dict[str, Any]:
    """Return the file: part -> {what, command, seeds, date, seconds, figures: name -> figure}."""
    return dict(json.loads(FILE.read_text(encoding="utf-8"))) if FILE.is_file() else {}


def value(name: str) -> float:
    """Return a stated figure, ``part.name``; tests hold what they measure against 1.5 times it."""
    part, _, figure = name.partition(".")
    return float(read()[part]["figures"][figure]["value"])


def keep(
    part: str, what: str, figures: Sequence[Figure], *, command: str, seeds: str, seconds: float | None = None
) -> None:
    """Put a part's figures in the place of its earlier ones, and write the page anew."""
    names = [figure.name for figure in figures]
    if not names or len(set(names)) < len(names):
        raise ValueError(f"{part}: a part has figures, each with a name of its own: {names}")
    content = read()
    content[part] = {
        "what": what,
        "command": command,
        "seeds": seeds,
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d"),
        "seconds": None if seconds is None else round(seconds),
        "figures": {
            f.name: {k: _short(x) for k, x in asdict(f).items() if x not in (None, "")} for f in figures
        },
    }
    ordered = dict(sorted(content.items()))
    write_text(FILE, json.dumps(ordered, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    write_text(PAGE, page(ordered))


def _short(x: Any) -> Any:
    return float(f"{x:.4g}") if isinstance(x, float) else x


def page(content: Mapping[str, Any]) -> str:
    """Return the page of all figures: a table a part, with the command that measures it."""
    lines = [
        "# Figures",
        "",
        "Every measured figure, with its command. `make evidence` writes this page from `figures.json`. The module",
        "of a part in `benchmarks/evidence/` says how it is measured. Tests fail at 1.5 times what is stated here.",
        "`plain` is a regressor and least squares (`benchmarks/_plain.py`, 30 lines) on the same rows.",
        "",
        "| kind | means |",
        "|---|---|",
        *(f"| {kind} | {words} |" for kind, words in KINDS.items()),
    ]
    for part, one in content.items():
        lines += ["", f"## {part}", "", one["what"].partition("\n\n")[0], *_table(one)]
    return "\n".join(lines) + "\n"


def _table(one: Mapping[str, Any]) -> list[str]:
    """Return how a part was measured, and its figures; a row states its kind where the rows differ in it."""
    rows: Mapping[str, Mapping[str, Any]] = one["figures"]
    kinds = {f["kind"] for f in rows.values()}
    took = "" if one["seconds"] is None else f"; {one['seconds']} s"
    heads = ["name", "figure", "ours", *(["range"] if any("low" in f for f in rows.values()) else [])]
    heads += ["plain"] if any("plain" in f for f in rows.values()) else []
    heads += ["published"] if any("published" in f for f in rows.values()) else []
    heads += ["kind"] if len(kinds) > 1 else []
    of_all = "" if len(kinds) > 1 else f"; {kinds.pop()}"
    lines = [f"`{one['command']}`, seeds {one['seeds']}; {one['date']}{took}{of_all}.", ""]
    lines += [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for name, f in rows.items():
        note = f" ({f['note']})" if f.get("note") else ""
        cells = {"name": f"`{name}`", "figure": f["what"] + note, "ours": _number(f), "kind": f["kind"]}
        cells |= {"range": _range(f), "published": _published(f)}
        cells["plain"] = f"{f['plain']:g} {f.get('unit', '')}".strip() if "plain" in f else ""
        lines.append(f"| {' | '.join(cells[head] for head in heads)} |")
    return lines


def _number(f: Mapping[str, Any]) -> str:
    if f.get("of") is not None:
        return f"{f['value']:g} of {f['of']}"
    return f"{f['value']:g} {f.get('unit', '')}".strip()


def _range(f: Mapping[str, Any]) -> str:
    return f"{f['low']:g} to {f['high']:g}" if "low" in f and "high" in f else ""


def _published(f: Mapping[str, Any]) -> str:
    found = f.get("published", "")
    return found if isinstance(found, str) else f"{found:g} {f.get('unit', '')}".strip()
