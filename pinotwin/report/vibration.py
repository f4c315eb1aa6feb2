"""The report of a reconstructed vibration, as Fig. 6-13 to 6-23 of the source show theirs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots
from scipy.signal import welch

from pinotwin.arrays import Floats
from pinotwin.reconstruction.result import Motion3, Vibration
from pinotwin.report.blocks import Block, Plot, Tile, notes, paragraph, table, tiles
from pinotwin.report.figures import ACCENT, MEASURED, RESIDUAL, SOFT, line, style, visible_rows
from pinotwin.report.page import Page

_SHARED = 6  # runs drawn one by one
_UNITS = {"q": "deg", "v": "deg/s", "a": "deg/s²"}
_WORDS = {"q": "angle", "v": "velocity", "a": "acceleration"}


def vibration_report(found: Vibration) -> str:
    """Return a self-contained HTML page about a reconstruction."""
    return vibration_page(found).html()


def vibration_page(found: Vibration) -> Page:
    """Return the same as a :class:`Page`, to which further sections can be added."""
    count = len(found.runs)
    page = Page(
        f"{found.machine}: vibration of {found.joint}",
        f"{count} run{'s' if count > 1 else ''}, {len(found.sensors)} IMU"
        f"{'s' if len(found.sensors) > 1 else ''}",
    )
    page = page.section(
        "Verdict",
        paragraph(
            f"The angle above 0.5 Hz is known to "
            f"{_degrees(_size(found.motion.sd_q))} deg. Below: {found.verdict}.",
            "verdict",
        ),
        tiles(_tiles(found)),
        *_notes(found),
    )
    page = page.section(
        "Deflection",
        Plot(_series(found.motion)),
        intro="Angle, velocity and acceleration of the passive joint on the servo clock. The "
        "angle's slow part is the load over the stiffness, not an integral of the gyro. Drag to "
        "zoom.",
    )
    if count > 1 or len(found.sensors) > 1:
        page = page.section(
            "Repeats and sensors",
            Plot(_runs(found)),
            intro="Velocity of every run on the clock of the first one.",
        )
    page = page.section(
        "Spectrum", Plot(_spectrum(found)), intro="Velocity of the deflection; the peak is the mode."
    )
    page = page.section("The unused IMU", *_unused(found))
    page = page.section("Sensors", *_sensors(found))
    return page.section(
        "Parasitic axes",
        Plot(_parasitic(found)),
        intro="Rates across the joint's axis, up to 50 Hz. Where the joint is "
        "stiff they are the gyro's noise.",
    )


def _notes(found: Vibration) -> tuple[Block, ...]:
    return (notes(found.notes),) if found.notes else ()


def _size(x: Floats) -> float:
    return float(np.sqrt(np.nanmean(np.square(x))))


def _degrees(x: float, digits: int = 2) -> str:
    return f"{np.degrees(x):.{digits}g}"


def _tiles(found: Vibration) -> list[Tile]:
    m = found.motion
    out = [
        Tile(
            f"{_WORDS[k]} of {found.joint}",
            f"{_degrees(float(np.nanstd(getattr(m, k))), 3)} {_UNITS[k]} RMS",
            f"± {_degrees(_size(getattr(m, f'sd_{k}')))} {_UNITS[k]}",
        )
        for k in "qva"
    ]
    (f, f_se), (zeta, zeta_se) = found.frequency, found.damping
    out.append(Tile("mode, motors held", f"{f:.2f} Hz", f"± {f_se:.2f} Hz"))
    out.append(Tile("damping ratio", f"{zeta:.4f}", f"± {zeta_se:.4f}"))
    return out


def _series(m: Motion3) -> go.Figure:
    figure = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.05)
    for row, k in enumerate("qva", 1):
        x, sd = np.degrees(getattr(m, k)), np.degrees(getattr(m, f"sd_{k}"))
        rows = visible_rows([np.nan_to_num(x)])
        for bound in (x - 2 * sd, x + 2 * sd):
            figure.add_trace(line(m.t[rows], bound[rows], "95 %", SOFT, width=0.7, legend=False), row, 1)
        figure.add_trace(line(m.t[rows], x[rows], _WORDS[k], ACCENT, legend=False, unit=_UNITS[k]), row, 1)
        figure.update_yaxes(title_text=f"{_WORDS[k]} [{_UNITS[k]}]", row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=3, col=1)
    return style(figure, 620, legend=False)


def _runs(found: Vibration) -> go.Figure:
    figure = go.Figure()
    shown = list(zip(found.runs, found.delays, strict=True))[:_SHARED]
    for k, (run, delay) in enumerate(shown):
        rows = visible_rows([np.nan_to_num(run.v)])
        figure.add_trace(line(run.t[rows] - delay, np.degrees(run.v[rows]), f"run {k + 1}", SOFT, width=0.8))
    rows = visible_rows([np.nan_to_num(found.motion.v)])
    figure.add_trace(line(found.motion.t[rows], np.degrees(found.motion.v[rows]), "mean", ACCENT, width=1.2))
    figure.update_xaxes(title_text="time [s]")
    figure.update_yaxes(title_text="velocity [deg/s]")
    return style(figure, 320)


def _spectrum(found: Vibration) -> go.Figure:
    m = found.motion
    v = np.degrees(np.nan_to_num(m.v))
    rate = 1.0 / float(np.median(np.diff(m.t)))
    f, power = welch(v, rate, nperseg=min(len(v), 2048))
    figure = go.Figure(line(f[1:], np.sqrt(power[1:]), "velocity", ACCENT, legend=False))
    mode = found.frequency[0]
    figure.add_vline(x=mode, line={"color": MEASURED, "dash": "dot"}, annotation_text=f"{mode:.1f} Hz")
    figure.update_xaxes(title_text="frequency [Hz]", range=[0, min(0.5 * rate, 6 * mode)])
    figure.update_yaxes(title_text="amplitude density [deg/s/√Hz]", type="log")
    return style(figure, 300, legend=False)


def _unused(found: Vibration) -> list[Block]:
    if not found.unused:
        return []
    rows: list[Sequence[object]] = []
    for u in found.unused:
        label = f"{u.predicted} from {u.fitted}"
        gyro = [_figure(np.degrees(x)) for x in (u.gyro, u.gyro_rigid, u.gyro_noise)]
        rows.append((label, "gyro [deg/s]", *gyro))
        accel = [_figure(x) for x in (u.accel, u.accel_rigid, u.accel_noise)]
        rows.append((label, "accelerometer [m/s²]", *accel))
    return [
        paragraph(
            "Two IMUs fitted to one encoder agree by construction; what one of them finds "
            "must also predict the raw signals of the other. RMS of what is left:"
        ),
        table(("test", "signal", "with the deflection", "without", "noise at rest"), rows, numeric=(2, 3, 4)),
    ]


def _sensors(found: Vibration) -> list[Block]:
    rows = []
    for sensor in found.sensors:
        for part in sensor.runs:
            f, c = part.found, part.found.clock
            scale = ", ".join(f"{100 * s:+.3f}" for s in f.scale)
            bias = ", ".join(f"{np.degrees(b):+.3f}" for b in f.bias.mean(axis=0))
            rows.append(
                (
                    sensor.name,
                    part.run + 1,
                    f"{c.offset:.6f} ± {c.se_offset:.1g}",
                    f"{1e6 * c.skew:+.1f} ± {1e6 * c.se_skew:.1f}",
                    f"{scale} (± {100 * f.scale_se.max():.3f})",
                    bias,
                    f.verdict(),
                )
            )
    header = (
        "IMU",
        "run",
        "clock offset [s]",
        "skew [ppm]",
        "gyro scale [%]",
        "gyro bias [deg/s]",
        "slow angle",
    )
    return [table(header, rows, numeric=(1, 2, 3))]


def _parasitic(found: Vibration) -> go.Figure:
    part = found.sensors[0].runs[0].found
    figure = go.Figure()
    rows = visible_rows(list(part.parasitic.T))
    colours = (MEASURED, RESIDUAL)
    for x, name, colour in zip(part.parasitic.T, ("second axis", "third axis"), colours, strict=True):
        figure.add_trace(line(part.t[rows], np.degrees(x[rows]), name, colour, width=0.8))
    figure.add_trace(line(part.t[rows], np.degrees(part.velocity[rows]), found.joint, ACCENT))
    figure.update_xaxes(title_text="time [s]")
    figure.update_yaxes(title_text="rate [deg/s]")
    return style(figure, 300)


def _figure(x: float) -> str:
    return f"{x:.4f}" if np.isfinite(x) else "no rest"
