"""The page and the tables of ``pinotwin study``: the source's studies on a machine of one's own."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go

from pinotwin.analysis.decomposition import Decomposition, decompose
from pinotwin.diagnosis.conclusion.provenance import made_of
from pinotwin.errors import DataError, InputError, nearest
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.logs.files.given import LogLike, as_logs
from pinotwin.machine import Machine
from pinotwin.report.blocks import Plot, notes, table
from pinotwin.report.closed_loop_plots import CAUSES, causes_figure
from pinotwin.report.page import Page, files_block
from pinotwin.report.study_plots import figure_of
from pinotwin.studies.amount import error_against_data
from pinotwin.studies.coupling import coupled_against_decoupled
from pinotwin.studies.evidence import Evidence, evidence
from pinotwin.studies.overlay import FRICTION, RIPPLE, TABLE, Against, overlay
from pinotwin.studies.removal import with_and_without
from pinotwin.system.stamps import made
from pinotwin.system.writing import as_path, whole_folder, write_text
from pinotwin.twin import Twin
from pinotwin.twin.twin import as_subject

KINDS = {
    "amount": "how much data is enough (Fig. 3-6)",
    "coupling": "one model of the machine against one per axis (Fig. 3-7)",
    "without": "the effort with and without each effect (Fig. 3-8)",
    "overlay": "each effect over the data it was found in (Fig. 3-9, 3-10, 4-10, 4-11)",
    "errors": "the tracking error by cause (Fig. 4-16)",
}
"""Study -> what it shows, with the figure of the thesis."""


Rows = Sequence[Sequence[object]]


@dataclass
class Studied:
    """What the studies found.

    Attributes:
        page: the report.
        tables: name of a CSV file -> header and rows.
        findings: name of a CSV file -> what it says, in a sentence.
        left_out: studies that could not be made, and why.
        machine: its name.
    """

    page: Page
    tables: dict[str, tuple[Sequence[str], Sequence[Sequence[object]]]] = field(default_factory=dict)
    findings: dict[str, str] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)
    machine: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return what ``pinotwin study --json`` writes."""
        tables = {
            name: [dict(zip(header, row, strict=True)) for row in rows]
            for name, (header, rows) in self.tables.items()
        }
        found = {"tables": tables, "findings": self.findings, "left_out": self.left_out}
        return {"machine": self.machine, **found}

    def save(self, folder: str | Path) -> Path:
        """Write study.html and a CSV file per study into a folder and return it."""
        with whole_folder(target := as_path(folder, "folder"), replaces=("study.html", "*.csv")) as part:
            write_text(part / "study.html", self.page.html())
            for name, (header, rows) in self.tables.items():
                write_text(part / name, "\n".join(csv_lines(header, rows)) + "\n")
        return target

    def add(self, name: str, header: Sequence[str], rows: Rows, finding: str, figure: go.Figure) -> None:
        """Add a table; its name begins with its study's: a section of the page, the finding first."""
        self.tables[f"{name}.csv"], self.findings[f"{name}.csv"] = (header, rows), finding
        kind, _, of = name.partition("_")
        title = KINDS[kind].split(" (")[0].capitalize() + (f": {of.replace('_', ', ')}" if of else "")
        shown = [[_short(cell) for cell in row] for row in rows]
        link = [(f"{name}.csv", f"{len(rows)} rows: {', '.join(header)}")]
        short = len(rows) <= 20
        below = [table(header, shown, numeric=range(1, len(header)))] if short else files_block(link)
        self.page = self.page.section(title, notes([finding]), Plot(figure), *below)


def study(
    subject: Machine | Twin | str | Path,
    log: LogLike | Sequence[LogLike],
    *,
    only: Sequence[str] = (),
    axes: Sequence[str] = (),
    window: tuple[float, float] | None = None,
    report: Callable[[str, float], None] | None = None,
) -> Studied:
    """Make the studies of a machine: how much data, which coupling, which effect matters.

    Args:
        subject: a twin, or a machine to make one of from the logs; or its folder.
        log: servo log(s) or their files.
        only: studies of :data:`KINDS`; all when empty.
        axes: axes to look at; all when empty.
        window: first and last time of the tracking error by cause [s]; all when None.
        report: called with the stage and the share done.

    Raises:
        InputError: a study or an axis is unknown, or none can be made.
    """
    began = time.monotonic()
    for kind in only:
        if kind not in KINDS:
            raise InputError(f"study: no study {kind!r}; {nearest(kind, KINDS)}")
    kinds = [kind for kind in KINDS if not only or kind in only]
    given, logs = as_subject(subject), as_logs(log)
    twin, machine = (given, given.machine) if isinstance(given, Twin) else (None, given)
    names = list(axes) or list(machine.axes)
    for name in names:
        machine.axis(name)
    if twin is None and set(kinds) - {"amount", "coupling"}:
        twin = identify(machine, logs, loop="errors" in kinds, report=report)
    out = Studied(
        Page(f"{machine.name}: studies", ", ".join(one.source for one in logs)), machine=machine.name
    )
    for i, kind in enumerate(kinds):
        if report is not None:
            report(f"study: {kind}", i / len(kinds))
        try:
            _one(kind, out, machine, twin, logs, names, window)
        except InputError as error:
            out.left_out.append(f"{kind}: {error}")
    if out.left_out:
        out.page = out.page.section("Left out", notes(out.left_out))
    if not out.tables:
        raise DataError("; ".join(out.left_out) or "no study was chosen")
    span = None if window is None else ",".join(f"{x:g}" for x in window)
    how = made(began, only=kinds, axis=list(axes) or "all", window=span)
    told = made_of(machine, [(one, "studied") for one in logs], **how)
    out.page = replace(out.page, made=told)
    return out


def _one(
    kind: str,
    out: Studied,
    machine: Machine,
    twin: Twin | None,
    logs: Sequence[Log],
    names: Sequence[str],
    window: tuple[float, float] | None,
) -> None:
    if kind == "amount":
        _amount(out, machine, logs)
    elif kind == "coupling":
        _coupling(out, machine, logs, names)
    elif twin is None:
        raise InputError("needs a twin")
    elif kind == "errors":
        found = decompose(twin, logs[0], window)
        for name in names:
            _errors(out, found, name, machine.axis(name).rotary)
    else:
        make, seen = _without if kind == "without" else _overlays, evidence(twin, logs)
        for name in names:
            make(out, twin, seen, name)


def _amount(out: Studied, machine: Machine, logs: Sequence[Log]) -> None:
    found = error_against_data(machine, logs)
    rows = list(zip(found.seconds, found.fitted, found.held_out, strict=True))
    enough = found.enough()
    more = "the error has not settled; a longer log would help"
    finding = more if enough is None else f"{enough:.3g} s are enough"
    out.add("amount", ("seconds [s]", "fitted", "held out"), rows, finding, figure_of(found))


def _coupling(out: Studied, machine: Machine, logs: Sequence[Log], names: Sequence[str]) -> None:
    found = coupled_against_decoupled(machine, logs)
    errors = {
        name: (row.coupled_error["nrmse"], row.decoupled_error["nrmse"]) for name, row in found.axes.items()
    }
    rows = [(name, *pair) for name, pair in errors.items() if name in names]
    axis, ratio = max(found.gain.items(), key=lambda item: item[1])
    finding = f"a model for each axis alone multiplies the held-out error by {ratio:.3g} on {axis}"
    out.add("coupling", ("axis", "coupled, held out", "decoupled, held out"), rows, finding, figure_of(found))


def _without(out: Studied, twin: Twin, seen: Evidence, axis: str) -> None:
    own = [effect.name for effect in twin.effects if getattr(effect, "axis", None) == axis]
    found = {name: with_and_without(twin, seen, axis, [name]) for name in dict.fromkeys(own)}
    if not found:
        return
    rows = [(name, *one.errors()) for name, one in found.items()]
    name, complete, without = max(rows, key=lambda row: row[2])
    unit = "N·m" if found[name].rotary else "N"
    finding = f"without {name} the RMS error grows from {complete:.3g} to {without:.3g} {unit}"
    header = ("effect", "RMS error with it [N, N·m]", "without")
    out.add(f"without_{axis}", header, rows, finding, figure_of(found[name]))


def _overlays(out: Studied, twin: Twin, seen: Evidence, axis: str) -> None:
    kinds: tuple[tuple[str, tuple[str, ...], Against], ...] = (
        ("friction", FRICTION, "velocity"),
        ("ripple", RIPPLE, "position"),
        ("table", TABLE, "position"),
    )
    held = {effect.name for effect in twin.effects if getattr(effect, "axis", None) == axis}
    for name, effects, against in kinds:
        if not held & set(effects):
            continue
        found = overlay(twin, seen, axis, effects, against)
        bins = found.bins
        rows = list(zip(bins.x, bins.median, bins.low, bins.high, strict=True))
        header = (f"{against} [SI]", "median of the data", "lower quartile", "upper quartile")
        finding = f"the curve explains {found.explained:.0%} of the data's power"
        out.add(f"overlay_{axis}_{name}", header, rows, finding, figure_of(found))


def _errors(out: Studied, found: Decomposition, axis: str, rotary: bool) -> None:
    rows = [
        (row["cause"], row["disturbance_rms"] or 0.0, row["error_rms"], row["error_peak"], row["share"])
        for row in found.table()
        if row["axis"] == axis
    ]
    if rows:
        header = ("cause", "disturbance RMS [N, N·m]", "error RMS [m, rad]", "error peak", "share")
        cause, *_, share = rows[0]
        finding = f"{share:.0%} of the tracking error comes from {CAUSES[cause][0]}"
        out.add(f"errors_{axis}", header, rows, finding, causes_figure(found, axis, rotary, "error"))


def _short(cell: object) -> str:
    return f"{cell:.4g}" if isinstance(cell, float | np.floating) else str(cell)


def csv_lines(header: Sequence[str], rows: Sequence[Sequence[object]]) -> Iterator[str]:
    """Yield the lines of a table as CSV."""
    yield ",".join(f'"{name}"' if "," in name else name for name in header)
    for row in rows:
        yield ",".join(f"{cell:.9g}" if isinstance(cell, float | np.floating) else str(cell) for cell in row)
