"""The page and the tables of ``pinotwin study``: the source's studies on a machine of one's own."""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go

from pinotwin.analysis.decomposition import decompose
from pinotwin.diagnosis.conclusion.provenance import made_of
from pinotwin.errors import DataError, InputError, nearest
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.logs.files.given import LogLike, as_logs
from pinotwin.machine import Machine
from pinotwin.report.blocks import Plot, heading, notes, table
from pinotwin.report.closed_loop_plots import CAUSES, causes_figure
from pinotwin.report.display import effort_unit
from pinotwin.report.page import Page, files_block
from pinotwin.report.study_plots import figure_of
from pinotwin.studies.amount import error_against_data
from pinotwin.studies.coupling import coupled_against_decoupled
from pinotwin.studies.evidence import Evidence, evidence
from pinotwin.studies.overlay import KINDS as OVERLAYS
from pinotwin.studies.overlay import overlay
from pinotwin.studies.removal import with_and_without
from pinotwin.system.phrases import STUDIED
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


@dataclass(frozen=True)
class Table:
    """What one study found: its name begins with the study's, ``finding`` says it in a sentence."""

    name: str
    header: Sequence[str]
    rows: Sequence[Sequence[object]]
    finding: str
    figure: go.Figure


@dataclass(frozen=True)
class Request:
    """What the studies are made of; a twin and its evidence where one of them needs it."""

    machine: Machine
    twin: Twin | None
    logs: Sequence[Log]
    names: Sequence[str]
    window: tuple[float, float] | None

    @cached_property
    def given(self) -> tuple[Twin, Evidence]:
        """The twin beside the logs."""
        if self.twin is None:
            raise InputError("needs a twin")
        return self.twin, evidence(self.twin, self.logs)

    def own(self, axis: str) -> list[str]:
        """Return the names of an axis' own effects."""
        own = [effect.name for effect in self.given[0].effects if getattr(effect, "axis", None) == axis]
        return list(dict.fromkeys(own))


@dataclass
class Studied:
    """What the studies found: the page, and by name of a CSV file header and rows, and the finding in a sentence.

    ``left_out``: studies that could not be made, and why.
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
                write_text(part / name, _csv(header, rows))
        return target

    def add(self, found: Table) -> None:
        """Add a table: a section of the page, the finding first."""
        name, header, rows = f"{found.name}.csv", found.header, found.rows
        self.tables[name], self.findings[name] = (header, rows), found.finding
        kind, _, of = found.name.partition("_")
        title, part = KINDS[kind].split(" (")[0].capitalize(), [heading(of.replace("_", ", "))] if of else []
        shown = [[_short(cell) for cell in row] for row in rows]
        link = [(name, f"{len(rows)} rows: {', '.join(header)}")]
        short = len(rows) <= 20
        below = [table(header, shown, numeric=range(1, len(header)))] if short else files_block(link)
        self.page = self.page.section(title, *part, notes([found.finding]), Plot(found.figure), *below)


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
    if unknown := [kind for kind in only if kind not in KINDS]:
        raise InputError(f"study: no study {unknown[0]!r}; {nearest(unknown[0], KINDS)}")
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
    asked = Request(machine, twin, logs, names, window)
    for i, kind in enumerate(kinds):
        if report is not None:
            report(f"study: {kind}", i / len(kinds))
        try:
            for found in MAKE[kind](asked):
                out.add(found)
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


def _amount(asked: Request) -> Iterator[Table]:
    found = error_against_data(asked.machine, asked.logs)
    rows = list(zip(found.seconds, found.fitted, found.held_out, strict=True))
    enough = found.enough()
    finding = STUDIED["more" if enough is None else "enough"].format(seconds=enough)
    yield Table("amount", ("seconds [s]", "fitted", "held out"), rows, finding, figure_of(found))


def _coupling(asked: Request) -> Iterator[Table]:
    found = coupled_against_decoupled(asked.machine, asked.logs)
    errors = {k: (row.coupled_error["nrmse"], row.decoupled_error["nrmse"]) for k, row in found.axes.items()}
    rows = [(name, *pair) for name, pair in errors.items() if name in asked.names]
    axis, ratio = max(found.gain.items(), key=lambda item: item[1])
    finding = STUDIED["coupling"].format(ratio=ratio, axis=axis)
    header = ("axis", "coupled, held out", "decoupled, held out")
    yield Table("coupling", header, rows, finding, figure_of(found))


def _without(asked: Request) -> Iterator[Table]:
    for axis in asked.names:
        found = {name: with_and_without(*asked.given, axis, [name]) for name in asked.own(axis)}
        if not found:
            continue
        rows = [(name, *one.errors()) for name, one in found.items()]
        name, complete, without = max(rows, key=lambda row: row[2])
        unit, sizes = effort_unit(found[name].rotary), {"complete": complete, "without": without}
        finding = STUDIED["without"].format(effect=name, unit=unit, **sizes)
        header = ("effect", "RMS error with it [N, N·m]", "without")
        yield Table(f"without_{axis}", header, rows, finding, figure_of(found[name]))


def _overlays(asked: Request) -> Iterator[Table]:
    names = ("friction", "ripple", "table")
    for axis in asked.names:
        for name, (effects, against) in zip(names, OVERLAYS.values(), strict=True):
            if not set(asked.own(axis)) & set(effects):
                continue
            found = overlay(*asked.given, axis, effects, against)
            bins = found.bins
            rows = list(zip(bins.x, bins.median, bins.low, bins.high, strict=True))
            header = (f"{against} [SI]", "median of the data", "lower quartile", "upper quartile")
            finding = STUDIED["overlay"].format(share=found.explained)
            yield Table(f"overlay_{axis}_{name}", header, rows, finding, figure_of(found))


def _errors(asked: Request) -> Iterator[Table]:
    if asked.twin is None:
        raise InputError("needs a twin")
    found = decompose(asked.twin, asked.logs[0], asked.window)
    keys = ("cause", "disturbance_rms", "error_rms", "error_peak", "share")
    header = ("cause", "disturbance RMS [N, N·m]", "error RMS [m, rad]", "error peak", "share")
    for axis in asked.names:
        rows = [tuple(row[k] or 0.0 for k in keys) for row in found.table() if row["axis"] == axis]
        if rows:
            cause, *_, share = rows[0]
            finding = STUDIED["errors"].format(share=share, cause=CAUSES[str(cause)][0])
            figure = causes_figure(found, axis, asked.machine.axis(axis).rotary, "error")
            yield Table(f"errors_{axis}", header, rows, finding, figure)


MAKE: dict[str, Callable[[Request], Iterator[Table]]] = {
    "amount": _amount,
    "coupling": _coupling,
    "without": _without,
    "overlay": _overlays,
    "errors": _errors,
}


def _short(cell: object, digits: int = 4) -> str:
    return f"{cell:.{digits}g}" if isinstance(cell, float | np.floating) else str(cell)


def _csv(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a table as CSV."""
    out = io.StringIO()
    lines = [header, *([_short(cell, 9) for cell in row] for row in rows)]
    csv.writer(out, lineterminator="\n").writerows(lines)
    return out.getvalue()
