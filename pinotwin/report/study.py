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
from pinotwin.diagnosis.phrases import effect_words
from pinotwin.effects import AxisEffect
from pinotwin.errors import DataError, InputError, require
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.logs.files import LogLike, as_logs
from pinotwin.machine import Machine
from pinotwin.report.blocks import Page, Plot, Section, files_block, heading, notes, paragraph, table
from pinotwin.report.closed_loop_plots import CAUSES, causes_figure
from pinotwin.report.display import percent
from pinotwin.report.study_plots import amount_figure, coupling_figure, overlay_figure, removal_figure
from pinotwin.studies.amount import error_against_data
from pinotwin.studies.coupling import coupled_against_decoupled
from pinotwin.studies.evidence import Evidence, evidence
from pinotwin.studies.overlay import KINDS as OVERLAYS
from pinotwin.studies.overlay import overlay, with_and_without
from pinotwin.studies.study import Study
from pinotwin.system.phrases import STUDIED, capital
from pinotwin.system.stamps import made
from pinotwin.system.writing import as_path, csv_text, whole_folder, write_text
from pinotwin.twin import Twin
from pinotwin.twin.twin import as_subject

KINDS = {  # Study -> what it shows, with the figure of the thesis
    "amount": "how much data is enough (Fig. 3-6)",
    "coupling": "one model of the machine against one per axis (Fig. 3-7)",
    "without": "the effort with and without each effect (Fig. 3-8)",
    "overlay": "each effect over the data it was found in (Fig. 3-9, 3-10, 4-10, 4-11)",
    "errors": "the tracking error by cause (Fig. 4-16)",
}


@dataclass
class Studied:
    """What the studies found."""

    page: Page  # the report
    studies: dict[str, Study] = field(default_factory=dict)  # name of a CSV file -> what it is the table of
    left_out: list[str] = field(default_factory=list)  # studies that could not be made, and why
    machine: str = ""  # its name

    def to_dict(self) -> dict[str, Any]:
        """Return what ``pinotwin study --json`` writes."""
        tables = {
            name: [dict(zip(one.header, row, strict=True)) for row in one.rows]
            for name, one in self.studies.items()
        }
        findings = {name: one.finding for name, one in self.studies.items()}
        found = {"tables": tables, "findings": findings, "left_out": self.left_out}
        return {"machine": self.machine, **found}

    def save(self, folder: str | Path) -> Path:
        """Write study.html and a CSV file per study into a folder and return it."""
        with whole_folder(target := as_path(folder, "folder"), replaces=("study.html", "*.csv")) as part:
            write_text(part / "study.html", self.page.html())
            for name, one in self.studies.items():
                rows = ([_short(cell, 9) for cell in row] for row in one.rows)
                write_text(part / name, csv_text([one.header, *rows]))
        return target

    def add(self, kind: str, of: Sequence[str], found: Study, figure: go.Figure) -> None:
        """Add a study ``of`` an axis, and a kind of effect: a section of the page, the finding first, and a table."""
        header, rows, file = found.header, found.rows, f"{'_'.join((kind, *of))}.csv"
        self.studies[file] = found
        part = [heading(", ".join(of))] if of else []
        shown = [[_cell(*cell) for cell in zip(header, row, strict=True)] for row in rows]
        link = [(file, f"{len(rows)} rows: {', '.join(header)}")]
        short = len(rows) <= 20
        below = [table(header, shown, numeric=range(1, len(header)))] if short else files_block(link)
        said = paragraph(f"{capital(found.finding)}.")
        self.page = self.page.section(_title(kind), *part, said, Plot(figure), *below)


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
    began, tell = time.monotonic(), report or (lambda stage, done: None)
    for kind in only:
        require(kind, KINDS, "study: no study", InputError)
    kinds = [kind for kind in KINDS if not only or kind in only]
    given, logs = as_subject(subject), as_logs(log)
    twin, machine = (given, given.machine) if isinstance(given, Twin) else (None, given)
    names = list(axes) or list(machine.axes)
    for name in names:
        machine.axis(name)
    if twin is None and set(kinds) - {"amount", "coupling"}:
        twin = identify(machine, logs, loop="errors" in kinds, report=report)
    page = Page(f"{machine.name}: studies", ", ".join(one.source for one in logs))
    out, findings = Studied(page, machine=machine.name), list[tuple[str, str, str]]()
    for i, kind in enumerate(kinds):
        tell(f"study: {kind}", i / len(kinds))
        try:
            for k, (of, found, figure) in enumerate(_made(kind, machine, twin, logs, names, window)):
                out.add(kind, of, found, figure)
                findings.append(("" if k else _title(kind), ", ".join(of), f"{capital(found.finding)}."))
        except InputError as error:
            out.left_out.append(f"{kind}: {error}")
    if out.left_out:
        out.page = out.page.section("Left out", notes(out.left_out))
    if not out.studies:
        raise DataError("; ".join(out.left_out) or "no study was chosen")
    span = None if window is None else ",".join(f"{x:g}" for x in window)
    how = made(began, only=kinds, axis=list(axes) or "all", window=span)
    facts = made_of(machine, [(one, "studied") for one in logs], **how)
    first = Section("Findings", (table(("study", "of", "finding"), findings),))
    out.page = replace(out.page, sections=(first, *out.page.sections), made=facts)
    return out


Made = Iterator[tuple[Sequence[str], Study, go.Figure]]


def _made(
    kind: str,
    machine: Machine,
    twin: Twin | None,
    logs: Sequence[Log],
    names: Sequence[str],
    window: tuple[float, float] | None,
) -> Made:
    """Yield the studies of a kind, each with axis and kind of effect that it is of, and its figure."""
    if kind == "amount":
        yield (), (found := error_against_data(machine, logs)), amount_figure(found)
    elif kind == "coupling":
        yield (), (found := coupled_against_decoupled(machine, logs, axes=names)), coupling_figure(found)
    elif twin is None:
        raise InputError("needs a twin")
    elif kind == "errors":
        yield from _errors(decompose(twin, logs[0], window), machine, names)
    else:
        seen = evidence(twin, logs)
        for axis in names:
            yield from (_without if kind == "without" else _overlays)(twin, seen, axis)


def _without(twin: Twin, seen: Evidence, axis: str) -> Made:
    if own := _own_effects(twin, axis):
        found = with_and_without(twin, seen, axis, own)
        yield [axis], found, removal_figure(found)


def _overlays(twin: Twin, seen: Evidence, axis: str) -> Made:
    for name, (effects, against) in zip(("friction", "ripple", "table"), OVERLAYS.values(), strict=True):
        if set(_own_effects(twin, axis)) & set(effects):
            found = overlay(twin, seen, axis, effects, against)
            yield (axis, name), found, overlay_figure(found)


def _own_effects(twin: Twin, axis: str) -> list[str]:
    """Return the names of the effects that act on one axis alone."""
    return list(dict.fromkeys(e.name for e in twin.effects if isinstance(e, AxisEffect) and e.axis == axis))


def _errors(found: Decomposition, machine: Machine, names: Sequence[str]) -> Made:
    keys = ("cause", "disturbance_rms", "error_rms", "error_peak", "share")
    header = ("cause", "disturbance RMS [N, N·m]", "error RMS [m, rad]", "error peak", "share")
    for axis in names:
        rows = [tuple(row[k] or 0.0 for k in keys) for row in found.table() if row["axis"] == axis]
        if rows:
            cause, *_, share = rows[0]
            finding = STUDIED["errors"].format(share=share, cause=CAUSES[str(cause)][0])
            figure = causes_figure(found, axis, machine.axis(axis).rotary, "error")
            yield [axis], Study(finding, header, rows), figure


def _title(kind: str) -> str:
    return KINDS[kind].split(" (")[0].capitalize()


def _cell(title: str, cell: object) -> str:
    """Return a cell as it stands on the page: a share in per cent."""
    if title == "effect":
        return effect_words(str(cell))
    share = isinstance(cell, float) and title.endswith(("fitted", "held out", "of std", "share"))
    return percent(float(str(cell))) if share else _short(cell)


def _short(cell: object, digits: int = 4) -> str:
    return f"{cell:.{digits}g}" if isinstance(cell, float | np.floating) else str(cell)
