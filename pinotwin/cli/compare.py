"""``pinotwin compare twin_march twin_june --log today.csv --out moved``: twins or diagnoses side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pinotwin.cli.arguments import Answer, Folder, Several
from pinotwin.cli.inputs import distinct
from pinotwin.errors import InputError

if TYPE_CHECKING:
    from pinotwin.analysis.comparison import Comparison


def run(subjects: Several, *, log: str | None = None, out: Folder) -> Answer:
    """Compare, write the page, and say what moved.

    Args:
        subjects (TWIN|DIAGNOSIS): two folders or more, in the order of time, all of twins or all of diagnoses
        log (LOG): servo log on which every twin is judged (without one: parameters alone)
        out (PATH): folder for compare.html and compare.json
    """
    names = ("twin.json", "diagnosis.json")
    for subject in subjects:
        path = Path(subject)
        if path.name not in names and not any((path / name).is_file() for name in names):
            raise InputError(
                f"{subject}: holds neither twin.json nor diagnosis.json; give what identify or diagnose wrote"
            )
    from pinotwin.analysis.comparison import Comparison
    from pinotwin.analysis.diagnoses import compare

    paths = [Path(subject).resolve() for subject in subjects]
    labels = distinct([(p.parent if p.suffix == ".json" else p).parts for p in paths], "/")
    found = compare(*subjects, labels=labels, log=log)
    found.save(out)
    lines = moved_lines(found) if isinstance(found, Comparison) else [found.sentence]
    return Answer([*lines, f"written to {out}: compare.html, compare.json"], found.to_dict())


def moved_lines(found: Comparison) -> list[str]:
    """Return what moved between twins, and how well each predicts."""
    from pinotwin.diagnosis.grade import printed
    from pinotwin.report.comparison import effort_grade

    lines = [found.sentence]
    width = min(max([len(row.name) for row in (*found.moved[:10], *found.retuned)], default=0), 34)
    for row in (*found.moved[:10], *found.retuned):
        told = " -> ".join(f"{x:.4g}" for x in row.values)
        lines.append(f"  {row.name:<{width}}  {told} {row.unit}  (± {1.6449 * row.change_error:.2g})")
    for axis, signals in found.errors.items():
        for signal, held in signals.items():
            errors = [f"{row['nrmse']:.1%} {printed(effort_grade(row))}".strip() for row in held.values()]
            lines.append(f"  {axis} {signal} error: {', '.join(errors)}")
    return [*lines, *(f"note: {n}" for n in found.notes)]
