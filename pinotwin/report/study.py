"""The page and the tables of ``pinotwin study``: the source's studies on a machine of one's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pinotwin.analysis.decomposition import Decomposition, decompose
from pinotwin.diagnosis.conclusion.provenance import made_of
from pinotwin.errors import DataError, InputError
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.report.blocks import Block, Plot, notes, table
from pinotwin.report.closed_loop_plots import causes_figure
from pinotwin.report.page import Page, files_block
from pinotwin.report.study_plots import figure_of
from pinotwin.studies.amount import error_against_data
from pinotwin.studies.coupling import coupled_against_decoupled
from pinotwin.studies.overlay import FRICTION, RIPPLE, TABLE, overlay
from pinotwin.studies.removal import with_and_without
from pinotwin.system.writing import as_path, whole_folder, write_text
from pinotwin.twin import Twin

KINDS = {
    "amount": "how much data is enough (Fig. 3-6)",
    "coupling": "one model of the machine against one per axis (Fig. 3-7)",
    "without": "the effort with and without each effect (Fig. 3-8)",
    "overlay": "each effect over the data it was found in (Fig. 3-9, 3-10, 4-10, 4-11)",
    "errors": "the tracking error by cause (Fig. 4-16)",
}
"""Study -> what it shows, with the figure of the thesis."""


@dataclass
class Studied:
    """What the studies found.

    Attributes:
        page: the report.
        tables: name of a CSV file -> header and rows.
        left_out: studies that could not be made, and why.
    """

    page: Page
    tables: dict[str, tuple[Sequence[str], Sequence[Sequence[object]]]] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)
    machine: str = ""

    def dated(self, machine: Machine, logs: Sequence[Log], made: Mapping[str, Any]) -> Studied:
        """Return it with the last section of the page: version, date, time taken, options, and the logs."""
        told = made_of(machine, [(log, "studied") for log in logs], **made)
        return replace(self, page=replace(self.page, made=told), machine=machine.name)

    def to_dict(self) -> dict[str, Any]:
        """Return what ``pinotwin study --json`` writes."""
        tables = {
            name: [dict(zip(header, row, strict=True)) for row in rows]
            for name, (header, rows) in self.tables.items()
        }
        return {"machine": self.machine, "tables": tables, "left_out": self.left_out}

    def save(self, folder: str | Path) -> Path:
        """Write study.html and a CSV file per study into a folder and return it."""
        with whole_folder(target := as_path(folder, "folder"), replaces=("study.html", "*.csv")) as part:
            write_text(part / "study.html", self.page.html())
            for name, (header, rows) in self.tables.items():
                write_text(part / name, "\n".join(csv_lines(header, rows)) + "\n")
        return target

    def add(
        self, kind: str, name: str, header: Sequence[str], rows: Sequence[Sequence[object]], *more: Block
    ) -> None:
        """Add a study: a section of the page and a table."""
        self.tables[f"{name}.csv"] = (header, rows)
        shown = [[_short(cell) for cell in row] for row in rows]
        link = [(f"{name}.csv", f"{len(rows)} rows: {', '.join(header)}")]
        blocks = (
            [table(header, shown, numeric=range(1, len(header)))] if len(rows) <= 20 else files_block(link)
        )
        title = KINDS[kind].split(" (")[0].capitalize() + (
            "" if name == kind else f": {name.partition('_')[2].replace('_', ', ')}"
        )
        self.page = self.page.section(title, *more, *blocks)


def studies(
    machine: Machine,
    twin: Twin | None,
    logs: Sequence[Log],
    *,
    kinds: Sequence[str],
    axes: Sequence[str] = (),
    window: tuple[float, float] | None = None,
    report: Callable[[str, float], None] | None = None,
) -> Studied:
    """Return the studies of a machine and its logs.

    Args:
        machine: what is believed.
        twin: what was found; needed by ``without``, ``overlay`` and ``errors``.
        logs: of the machine.
        kinds: keys of :data:`KINDS`.
        axes: axes to look at; all when empty.
        window: first and last time of the tracking error by cause [s]; all when None.
        report: told what is done and how far it is.
    """
    names = list(axes) or list(machine.axes)
    for name in names:
        machine.axis(name)
    out = Studied(Page(f"{machine.name}: studies", ", ".join(log.source for log in logs)))
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
        make = _without if kind == "without" else _overlays
        for name in names:
            make(out, twin, logs, name)


def _amount(out: Studied, machine: Machine, logs: Sequence[Log]) -> None:
    found = error_against_data(machine, logs)
    rows, enough = list(zip(found.seconds, found.fitted, found.held_out, strict=True)), found.enough()
    unsettled = "the error has not settled; a longer log would help"
    said = notes([unsettled if enough is None else f"{enough:.3g} s are enough"])
    out.add("amount", "amount", ("seconds [s]", "fitted", "held out"), rows, said, Plot(figure_of(found)))


def _coupling(out: Studied, machine: Machine, logs: Sequence[Log], names: Sequence[str]) -> None:
    found = coupled_against_decoupled(machine, logs)
    rows = [
        (row.axis, row.coupled_error["nrmse"], row.decoupled_error["nrmse"])
        for row in found.axes.values()
        if row.axis in names
    ]
    header = ("axis", "coupled, held out", "decoupled, held out")
    out.add("coupling", "coupling", header, rows, Plot(figure_of(found)))


def _without(out: Studied, twin: Twin, logs: Sequence[Log], axis: str) -> None:
    own = [effect.name for effect in twin.effects if getattr(effect, "axis", None) == axis]
    found = [(name, with_and_without(twin, logs, axis, [name])) for name in dict.fromkeys(own)]
    if not found:
        return
    rows = [(name, *one.errors()) for name, one in found]
    largest = max(found, key=lambda item: item[1].errors()[1])[1]
    header = ("effect", "RMS error with it [N, N·m]", "without")
    out.add("without", f"without_{axis}", header, rows, Plot(figure_of(largest)))


def _overlays(out: Studied, twin: Twin, logs: Sequence[Log], axis: str) -> None:
    kinds = (("friction", FRICTION, "velocity"), ("ripple", RIPPLE, "position"), ("table", TABLE, "position"))
    for name, effects, against in kinds:
        held = {effect.name for effect in twin.effects if getattr(effect, "axis", None) == axis}
        if not held & set(effects):
            continue
        found = overlay(twin, logs, axis, effects, "velocity" if against == "velocity" else "position")
        bins = found.bins
        rows = list(zip(bins.x, bins.median, bins.low, bins.high, strict=True))
        header = (f"{against} [SI]", "median of the data", "lower quartile", "upper quartile")
        said = notes([f"the curve explains {found.explained:.0%} of the data's power"])
        out.add("overlay", f"overlay_{axis}_{name}", header, rows, said, Plot(figure_of(found)))


def _errors(out: Studied, found: Decomposition, axis: str, rotary: bool) -> None:
    rows = [
        (row["cause"], row["disturbance_rms"] or 0.0, row["error_rms"], row["error_peak"], row["share"])
        for row in found.table()
        if row["axis"] == axis
    ]
    if rows:
        header = ("cause", "disturbance RMS [N, N·m]", "error RMS [m, rad]", "error peak", "share")
        out.add("errors", f"errors_{axis}", header, rows, Plot(causes_figure(found, axis, rotary, "error")))


def _short(cell: object) -> str:
    return f"{cell:.4g}" if isinstance(cell, float | np.floating) else str(cell)


def csv_lines(header: Sequence[str], rows: Sequence[Sequence[object]]) -> Iterator[str]:
    """Yield the lines of a table as CSV."""
    yield ",".join(f'"{name}"' if "," in name else name for name in header)
    for row in rows:
        yield ",".join(f"{cell:.9g}" if isinstance(cell, float | np.floating) else str(cell) for cell in row)
