"""The report of an identification: verdict, evidence, parameters, and what the data cannot tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pinotwin.diagnosis.conclusion.provenance import made_of
from pinotwin.log import Log
from pinotwin.report import display
from pinotwin.report.blocks import (
    Block,
    Group,
    Plot,
    Tabs,
    bullets,
    heading,
    notes,
    paragraph,
    table,
    tiles,
)
from pinotwin.report.closed_loop import closed_loop_blocks
from pinotwin.report.effort_plots import (
    breakdown_figure,
    can_correlate,
    correlation_figure,
    effort_figure,
    residual_figure,
    shares_figure,
    spectrum_figure,
)
from pinotwin.report.flexible import flexible_blocks
from pinotwin.report.page import Page, provenance_blocks
from pinotwin.report.parameter_table import parameter_table
from pinotwin.report.study_plots import overlay_figure
from pinotwin.report.verdict import axis_tiles, cautions, headline, known
from pinotwin.studies.evidence import Evidence, evidence, split_rigid_body
from pinotwin.studies.overlay import (
    FRICTION,
    RIPPLE,
    TABLE,
    effect_keys_of,
    overlay,
)
from pinotwin.twin import Twin


def identification_report(
    twin: Twin,
    logs: Log | Sequence[Log],
    validate: Sequence[Log] = (),
    made: Mapping[str, Any] | None = None,
) -> str:
    """Return a self-contained HTML page about an identified machine.

    Args:
        twin: what was identified.
        logs: the log(s) it was identified from.
        validate: log(s) it was judged on, if there were any.
        made: ``date``, ``seconds_taken`` and ``options``, where they are known.

    Raises:
        DataError: the logs hold no row that the twin can be compared with.
    """
    page = identification_page(twin, logs, validate)
    fitted = [logs] if isinstance(logs, Log) else logs
    used = [*((log, "fitted") for log in fitted), *((log, "validation") for log in validate)]
    told = made_of(twin.machine, used, **(made or {}))
    return page.section("How this was made", *provenance_blocks(told)).html()


def identification_page(twin: Twin, logs: Log | Sequence[Log], validate: Sequence[Log] = ()) -> Page:
    """Return the same report as a :class:`Page`, to which further sections can be added."""
    given = evidence(twin, logs)
    split = split_rigid_body(twin, given)
    page = Page(f"{twin.machine.name}: identification", subtitle(given))
    page = page.section(
        "Verdict",
        paragraph(headline(twin), "verdict"),
        tiles(axis_tiles(twin)),
        paragraph(
            "Large print: error on data not fitted, relative to the standard deviation of the axis' effort.",
            "lead",
        ),
        *_cautions(twin),
    )
    if validate:
        page = page.section(
            "Validation",
            Plot(effort_figure(evidence(twin, validate))),
            intro="Measured and predicted effort on a log that was not used to fit.",
        )
    page = page.section(
        "Effort",
        Plot(effort_figure(given)),
        intro="Measured and predicted effort on the data that were fitted, both after the same "
        "zero-phase filter. Rows slower than the speed threshold are not fitted: at standstill dry "
        "friction is not a function of the velocity. Drag to zoom: all axes follow; double-click "
        "to go back.",
    )
    page = page.section(
        "Causes",
        Plot(shares_figure(split)),
        intro="What the effort is made of: the RMS of each effect as a share of the sum of all. "
        "Coupling is what the other axes' motion adds.",
    )
    page = page.section("Axis by axis", Tabs(axis_panels(twin, given, split)))
    page = _with_loop(page, twin, logs, validate)
    page = page.section(
        "Parameters",
        parameter_table(twin.parameters, list(twin.machine.axes)),
        intro="Values in SI with 95 % intervals that allow for coloured residuals. Click a heading "
        "to sort. Weak: the interval is wide against the value. A parameter that these data do not "
        "determine shows no number: whatever the twin "
        "uses for it comes from the URDF, not from the machine.",
    )
    page = page.section("Limits of these data", *_limits(twin))
    return page.section("Data", *_data(twin, given))


def _with_loop(page: Page, twin: Twin, logs: Log | Sequence[Log], validate: Sequence[Log]) -> Page:
    """Add the closed loop, judged on the first log that was not fitted, if the twin has one."""
    given = [logs] if isinstance(logs, Log) else list(logs)
    blocks = closed_loop_blocks(twin, next(iter([*validate, *given])))
    if not blocks:
        return page
    seen = "a log that was not used to fit" if validate else "the log that was fitted"
    page = page.section(
        "Closed loop",
        *blocks,
        intro="Tracking error and effort that the twin predicts when it is given nothing but the "
        f"command of {seen}.",
    )
    bent = flexible_blocks(twin, next(iter([*validate, *given])))
    return page.section("Structural flexibility", *bent) if bent else page


def subtitle(given: Evidence) -> str:
    """Return the line below the title: where the data came from and how much of it there is."""
    count = int(sum(given.use[:, j].sum() for j in given.measured))
    length = display.seconds(float(given.t[-1] - given.t[0]))
    return f"{display.elided(given.source)} · {length} · {count} rows compared"


def _cautions(twin: Twin) -> tuple[Block, ...]:
    lines = cautions(twin)
    return (heading("Be careful with"), notes(lines)) if lines else ()


def axis_panels(twin: Twin, given: Evidence, split: Evidence) -> Mapping[str, Sequence[Block]]:
    """Return the detailed plots of every axis, by its name."""
    return {given.names[j]: axis_panel(twin, given, split, j) for j in given.measured}


def axis_panel(twin: Twin, given: Evidence, split: Evidence, j: int) -> list[Block]:
    """Return the detailed plots of one axis."""
    out: list[Block] = [
        Plot(
            breakdown_figure(split, j),
            f"{given.names[j]}: contribution of each effect",
            "Click a name in the legend to hide or show it.",
        ),
        *_overlays(twin, given, j),
        Group(
            (
                Plot(
                    residual_figure(given, j, "velocity"),
                    "Residual against velocity",
                    "A curve in the median is friction that the model does not have.",
                ),
                Plot(
                    residual_figure(given, j, "position"),
                    "Residual against position",
                    "A curve or a wave in the median is ripple, cable or guideway.",
                ),
            )
        ),
    ]
    if can_correlate(given, j):
        spectrum = Plot(
            spectrum_figure(given, j),
            "Spectrum",
            "A peak in the residual is a resonance or a ripple at steady speed.",
        )
        correlation = Plot(
            correlation_figure(given, j),
            "Autocorrelation of the residual",
            "White noise stays within the grey band; the intervals allow for what does not.",
        )
        out.append(Group((spectrum, correlation)))
    return out


def _overlays(twin: Twin, given: Evidence, j: int) -> list[Block]:
    name = given.names[j]
    out: list[Block] = []
    wanted = (
        (FRICTION, "velocity", "Friction"),
        (RIPPLE, "position", "Ripple"),
        (TABLE, "position", "Position-dependent effort"),
    )
    for names, against, title in wanted:
        if not effect_keys_of(twin, name, names) or not given.use[:, j].any():
            continue
        found = overlay(twin, given, name, names, against)  # type: ignore[arg-type]
        note = (
            "Points: measured effort minus all other effects of the twin; line: the model, which "
            f"explains {display.percent(max(found.explained, 0.0))} of their power."
        )
        out.append(Plot(overlay_figure(found), f"{title} of {name}", note))
    return out


def _limits(twin: Twin) -> list[Block]:
    """Return the groups that cannot be told apart and the parameters nothing excites."""
    out: list[Block] = []
    if twin.groups:
        out.append(
            paragraph(
                "These parameters are known only in combination; on these data no "
                "method can tell the members of a group apart:"
            )
        )
        out.append(bullets(", ".join(str(name) for name in group) for group in twin.groups))
    tied = {name for group in twin.groups for name in group}
    alone = [row for row in twin.parameters if not row.determined and row.name not in tied]
    if alone:
        out.append(paragraph("Not determined:"))
        out.append(bullets(f"{row.name}: {_why(row.verdict)}" for row in alone))
    if not out:
        out.append(paragraph("Every parameter of the model is determined by these data."))
    return out


def _why(verdict: str) -> str:
    return verdict.removeprefix("not determined: ") if ":" in verdict else "no information"


def _data(twin: Twin, given: Evidence) -> list[Block]:
    rows = [
        [
            display.elided(str(item.get("source", "")), 80),
            item.get("samples", ""),
            f"{float(item['rate']):.6g} Hz" if item.get("rate") else "",
            item.get("fingerprint", ""),
        ]
        for item in twin.data
    ]
    out: list[Block] = []
    if rows:
        out.append(table(("file", "samples", "rate", "fingerprint"), rows, numeric=(1, 2)))
    said = [f"{item.get('source')}: {note}" for item in twin.data for note in item.get("notes", ())]
    out.append(bullets([*_settings(twin, given), *said]))
    return out


def _settings(twin: Twin, given: Evidence) -> list[str]:
    cutoff, step = twin.settings.get("cutoff"), twin.settings.get("decimate")
    used = ", ".join(f"{given.names[j]} {int(given.use[:, j].sum())}" for j in given.measured)
    lines = [
        "low-pass corner: " + (f"{float(cutoff):.4g} Hz, zero phase" if cutoff else "none"),
        f"one row in {step or 1} fitted, {given.rate:.4g} rows a second",
        f"rows above the speed threshold of each axis: {used}",
    ]
    quality: Mapping[str, Any] = twin.quality
    condition = known(quality, "condition")
    if np.isfinite(condition):
        lines.append(
            f"scaled condition number {condition:.3g}, rank {quality.get('rank', '?')} "
            f"of {quality.get('parameters', len(twin.theta))}"
        )
    if quality.get("validation_source"):
        lines.append(f"validated on {quality['validation_source']}")
    return lines
