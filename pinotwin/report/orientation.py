"""The report of an orientation: where an IMU pointed over time, and what says how far that can be trusted.

No interval is known without a reference. Two things are known from the log alone: a second method of another kind
on the same log, and the acceleration that is left once gravity is taken out, whose mean is zero for a sensor that
stays in the room: what it is not, over g, is a tilt that the accelerometer and the result do not agree on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from pinotwin.arrays import Floats
from pinotwin.diagnosis.conclusion.provenance import log_facts
from pinotwin.imu import rotation as rot
from pinotwin.log import Log
from pinotwin.reconstruction.orientation import Orientation
from pinotwin.report import display
from pinotwin.report.blocks import Block, Plot, Tile, paragraph, table, tiles
from pinotwin.report.figures import ACCENT, MEASURED, RESIDUAL, line, style, visible_rows
from pinotwin.report.page import Page, files_block, provenance_blocks

METHODS = {
    "offline": "smoother over the whole record",
    "vqf": "VQF, offline",
    "smoother": "adaptive Kalman filter, both ways",
    "ekf": "adaptive Kalman filter",
}
"""Method -> its name."""

_STEEP = 80.0  # deg of pitch, from which roll and heading are no longer told apart
_G = 9.81


def orientation_page(
    found: Orientation,
    log: Log,
    method: str,
    other: tuple[str, Orientation],
    files: Sequence[tuple[str, str]] = (),
) -> Page:
    """Return the page about an orientation.

    Args:
        found: over the log.
        log: the IMU's log.
        method: that it was found with.
        other: another method, and what it finds.
        files: name and content of what lies beside the page, to link to.
    """
    said = f"{len(found.t)} rows at {found.rate:.4g} Hz · {METHODS[method]}"
    page = Page("Orientation of an IMU", f"{display.elided(log.source)} · {said}")
    angles = roll_pitch_heading(found.q)
    page = page.section("Answer", *_answer(found, angles))
    page = page.section("Over time", *_over_time(found, angles))
    page = page.section("How far to trust it", *_trust(found, log, other))
    page = page.section("Files", *files_block(files))
    return page.section("How this was made", *provenance_blocks(_provenance(log, method)))


def roll_pitch_heading(q: Floats) -> Floats:
    """Return roll about x, pitch about y and heading about the vertical [deg], shape (n, 3).

    R = Rz(heading) Ry(pitch) Rx(roll); the heading is counted from the first sample, whole turns added up.

    Args:
        q: quaternions, sensor to earth, shape (n, 4).
    """
    R = rot.to_matrix(q)
    roll = np.unwrap(np.arctan2(R[:, 2, 1], R[:, 2, 2]))
    pitch = -np.arcsin(np.clip(R[:, 2, 0], -1.0, 1.0))
    heading = np.unwrap(np.arctan2(R[:, 1, 0], R[:, 0, 0]))
    return np.degrees(np.stack([roll, pitch, heading - heading[0]], axis=1))


def free_acceleration(found: Orientation) -> Floats:
    """Return the acceleration without gravity along the earth's axes [m/s²], shape (n, 3).

    Gravity is the mean of the vertical, which takes the accelerometer's scale with it.
    """
    force = rot.rotate(found.q, found.force)
    return force - np.array([0.0, 0.0, force[:, 2].mean()])


def _answer(found: Orientation, angles: Floats) -> list[Block]:
    z = np.degrees(found.inclination)
    span = f"{found.t[-1] - found.t[0]:.4g} s"
    out: list[Block] = [
        paragraph(
            f"The sensor's z axis was inclined by {z.min():.2f} to {z.max():.2f}° over {span}.",
            "verdict",
        ),
        tiles(
            [
                Tile("inclination, mean", f"{z.mean():.2f}°", f"varies by {z.std():.3g}° RMS"),
                *(
                    Tile(name, f"{x.min():.1f} to {x.max():.1f}°".replace("-", "−"), note)
                    for name, x, note in zip(NAMES, angles.T, NOTES, strict=True)
                ),
            ]
        ),
    ]
    if np.abs(angles[:, 1]).max() > _STEEP:
        text = "The x axis comes close to the vertical: roll and heading can hardly be separated there."
        out.append(paragraph(f"{text} Use the quaternions."))
    return out


NAMES = ("roll", "pitch", "heading")
NOTES = ("about the sensor's x", "about y", "from the start; no magnetometer: it drifts with the gyro")


def _over_time(found: Orientation, angles: Floats) -> list[Block]:
    z = np.degrees(found.inclination)
    rows = visible_rows([z, *angles.T])
    t = found.t[rows]
    figure = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.05)
    add = figure.add_trace
    add(line(t, z[rows], "inclination", ACCENT, legend=False, unit="°"), 1, 1)
    for k, colour in ((0, RESIDUAL), (1, MEASURED)):
        add(line(t, angles[rows, k], NAMES[k], colour, unit="°"), 2, 1)
    add(line(t, angles[rows, 2], "heading", ACCENT, legend=False, unit="°"), 3, 1)
    for row, title in enumerate(("inclination [°]", "roll, pitch [°]", "heading [°]"), 1):
        figure.update_yaxes(title_text=title, row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=3, col=1)
    note = "Time is the sensor's. Drag to zoom: all follow; double-click to go back."
    return [
        Plot(style(figure, 640), "Angles", note),
        Plot(
            _free(found), "Acceleration without gravity", "Along the earth's axes, heading as at the start."
        ),
    ]


def _free(found: Orientation) -> go.Figure:
    a = free_acceleration(found)
    rows = visible_rows(list(a.T))
    figure = go.Figure()
    for k, (name, colour) in enumerate((("x", RESIDUAL), ("y", MEASURED), ("up", ACCENT))):
        figure.add_trace(line(found.t[rows], a[rows, k], name, colour, width=0.9, unit="m/s²"))
    figure.update_xaxes(title_text="time [s]")
    figure.update_yaxes(title_text="acceleration [m/s²]")
    return style(figure, 300)


def _trust(found: Orientation, log: Log, other: tuple[str, Orientation]) -> list[Block]:
    a = free_acceleration(found)
    tilt = float(np.degrees(np.linalg.norm(a[:, :2].mean(axis=0)) / _G))
    apart = np.degrees(rot.inclination_error(found.q, other[1].q))
    moving = float(np.sqrt(np.mean(np.sum(a**2, axis=1))))
    share = f"{100.0 * found.missing:.2g} %" if found.missing else "none"
    clock = f"interpolated to an even one from {len(log)} rows" if found.remade else "as recorded"
    differ = f"{np.sqrt(np.mean(apart**2)):.2g}° RMS, {apart.max():.2g}° at most"
    rows = [
        ("inclination, against the other method", differ, METHODS[other[0]]),
        (
            "mean horizontal acceleration, as a tilt",
            f"{tilt:.2g}°",
            "zero for a sensor that stays in its place",
        ),
        (
            "acceleration without gravity",
            f"{moving:.3g} m/s² RMS",
            "the motion: the vertical is found beside it",
        ),
        ("samples made up over holes", share, "linear"),
        ("clock", clock, ""),
    ]
    return [
        paragraph(
            "There is no reference in the log, so no error can be stated. On real recordings with an optical one the "
            "default method was 0.26 to 0.95° RMS off in inclination, more the faster the motion (docs, vibration)."
        ),
        table(("what", "size", "what it means"), rows),
    ]


def _provenance(log: Log, method: str) -> dict[str, Any]:
    from pinotwin import __version__

    return {
        "version": __version__,
        "machine": "none is needed",
        "options": {"method": method},
        "logs": [log_facts(log, "IMU")],
    }
