"""``pinotwin compare A B [MORE...] --out DIR``: twins or diagnoses side by side."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from pinotwin.cli.inputs import add_effects
from pinotwin.cli.output import add_common, say, write_json

if TYPE_CHECKING:
    from pinotwin.analysis.comparison import Compared, Comparison


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "subjects",
        nargs="+",
        metavar="TWIN|DIAGNOSIS",
        help="two folders or more, in the order of time, all of twins or all of diagnoses",
    )
    parser.add_argument(
        "--log", metavar="LOG", help="servo log on which every twin is judged (without one: parameters alone)"
    )
    add_effects(parser)
    add_common(parser, out="folder for compare.html and compare.json", required=True)


def run(args: argparse.Namespace) -> int:
    """Compare, write the page, and say what moved."""
    from pinotwin.errors import InputError

    if len(args.subjects) < 2:
        raise InputError("compare: give two twins or two diagnoses, or more")
    labels = _labels(args.subjects)
    kinds = {_kind(subject) for subject in args.subjects}
    if len(kinds) > 1:
        raise InputError("compare: give twins or diagnoses, not both")
    (kind,) = kinds
    if kind == "diagnosis" and args.log:
        raise InputError("--log: is for twins; a diagnosis holds its logs already")
    found: Compared
    if kind == "twin":
        from pinotwin.analysis.comparison import compare

        found = compare(*args.subjects, labels=labels, log=args.log)
        lines = moved_lines(found)
    else:
        from pinotwin.analysis.diagnoses import read_diagnoses

        found = read_diagnoses(args.subjects, labels)
        lines = [found.sentence]
    found.save(args.out)
    if args.json:
        write_json(args.json, found.to_dict())
    for line in lines:
        say(line)
    say(f"written to {args.out}: compare.html, compare.json")
    return 0


def _kind(subject: str) -> str:
    from pinotwin.errors import InputError

    path = Path(subject)
    if path.name == "diagnosis.json" or (path / "diagnosis.json").is_file():
        return "diagnosis"
    if path.name == "twin.json" or (path / "twin.json").is_file():
        return "twin"
    raise InputError(
        f"{subject}: holds neither twin.json nor diagnosis.json; give what identify or diagnose wrote"
    )


def _labels(subjects: list[str]) -> list[str]:
    """Return a short name for each: the folder's, with its parents where two are the same."""
    paths = [Path(s).resolve() for s in subjects]
    paths = [p.parent if p.suffix == ".json" else p for p in paths]
    for depth in range(1, 6):
        names = ["/".join(p.parts[-depth:]) for p in paths]
        if len(set(names)) == len(names):
            return names
    return [f"{k + 1}" for k in range(len(paths))]


def moved_lines(found: Comparison) -> list[str]:
    """Return what moved between twins, and how well each predicts."""
    from pinotwin.diagnosis.grade import printed
    from pinotwin.report.comparison import effort_grade

    lines = [found.sentence]
    width = min(max([len(row.name) for row in found.moved[:10]], default=0), 34)
    for row in found.moved[:10]:
        told = " -> ".join(f"{x:.4g}" for x in row.values)
        lines.append(f"  {row.name:<{width}}  {told} {row.unit}  (± {1.6449 * row.change_error:.2g})")
    for axis, signals in found.errors.items():
        for signal, held in signals.items():
            errors = [f"{row['nrmse']:.1%} {printed(effort_grade(row))}".strip() for row in held.values()]
            lines.append(f"  {axis} {signal} error: {', '.join(errors)}")
    return [*lines, *(f"note: {n}" for n in found.notes)]
