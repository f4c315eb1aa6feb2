"""The report of an orientation: where an IMU pointed over time, and what says how far that can be trusted.

Without a reference two things are known: a second method on the same log, and the mean acceleration left once gravity
is taken out, zero for a sensor that stays in the room: over g, it is the tilt on which the two disagree.
"""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from pinotwin.arrays import Floats
from pinotwin.diagnosis.conclusion.provenance import log_facts
from pinotwin.imu import rotation as rot
from pinotwin.log import Log
from pinotwin.reconstruction.orientation import Orientation
from pinotwin.report import display
from pinotwin.report.blocks import Files, Html, Page, Tile, tiles
from pinotwin.report.figures import ACCENT, MEASURED, RESIDUAL, Line, Panel, over_time
from pinotwin.version import __version__

METHODS = {  # Method -> its name
    "offline": "smoother over the whole record",
    "vqf": "VQF, offline",
    "smoother": "adaptive Kalman filter, both ways",
    "ekf": "adaptive Kalman filter",
}
ANGLES = {  # Angle -> what it is
    "roll": "about the sensor's x",
    "pitch": "about y",
    "heading": "from the start; no magnetometer: it drifts with the gyro",
}


def orientation_page(
    found: Orientation, log: Log, method: str, other: tuple[str, Orientation], files: Files
) -> Page:
    """Return the page about an orientation, found by a method, with another method and what that finds."""
    said = f"{len(found.t)} rows at {found.rate:.4g} Hz · {METHODS[method]}"
    angles, z = roll_pitch_heading(found.q), np.degrees(found.inclination)
    given = {
        "span": f"{z.min():.2f} to {z.max():.2f}° over {found.t[-1] - found.t[0]:.4g} s",
        "tiles_": _tiles(z, angles),
        "steep": np.abs(angles[:, 1]).max() > 80.0,  # pitch [deg]: roll and heading are no longer separated
        "angles": _angles(found, z, angles),
        "free": _free(found),
        "trust": _trust(found, other),
        "holes": f"{100.0 * found.missing:.2g} %" if found.missing else "none",
        "clock": f"interpolated to an even one from {len(log)} rows" if found.remade else "as recorded",
    }
    title, subtitle = "Orientation of an IMU", f"{display.elided(log.source)} · {said}"
    facts = {"version": __version__, "machine": "none is needed", "options": {"method": method}}
    made = {**facts, "logs": [log_facts(log, "IMU")]}
    return Page(title, subtitle, template="orientation", given=given, files=files, made=made)


def roll_pitch_heading(q: Floats) -> Floats:
    """Return roll x, pitch y and heading from the first sample on [deg], (n, 3): quaternions (n, 4) of Rz Ry Rx."""
    R = rot.to_matrix(q)
    roll = np.unwrap(np.arctan2(R[:, 2, 1], R[:, 2, 2]))
    pitch = -np.arcsin(np.clip(R[:, 2, 0], -1.0, 1.0))
    heading = np.unwrap(np.arctan2(R[:, 1, 0], R[:, 0, 0]))
    return np.degrees(np.stack([roll, pitch, heading - heading[0]], axis=1))


def free_acceleration(found: Orientation) -> Floats:
    """Return the acceleration along the earth's axes [m/s²] (n, 3) less the mean of the vertical, which is gravity."""
    force = rot.rotate(found.q, found.force)
    return force - np.array([0.0, 0.0, force[:, 2].mean()])


def _tiles(z: Floats, angles: Floats) -> Html:
    out = [Tile("inclination, mean", f"{z.mean():.2f}°", f"varies by {z.std():.3g}° RMS")]
    for (name, note), x in zip(ANGLES.items(), angles.T, strict=True):
        out.append(Tile(name, f"{x.min():.1f} to {x.max():.1f}°".replace("-", "−"), note))
    return tiles(out)


def _angles(found: Orientation, z: Floats, angles: Floats) -> go.Figure:
    degrees = display.Scale(1.0, "°")
    both = [Line("roll", angles[:, 0], RESIDUAL), Line("pitch", angles[:, 1], MEASURED)]
    panels = [
        Panel("inclination", [Line("inclination", z, ACCENT, legend=False)], degrees),
        Panel("roll, pitch", both, degrees),
        Panel("heading", [Line("heading", angles[:, 2], ACCENT, legend=False)], degrees),
    ]
    return over_time(found.t, panels, 640, points=1200)


def _free(found: Orientation) -> go.Figure:
    looks = zip(("x", "y", "up"), free_acceleration(found).T, (RESIDUAL, MEASURED, ACCENT), strict=True)
    lines = [Line(name, x, colour, 0.9) for name, x, colour in looks]
    return over_time(found.t, [Panel("acceleration", lines, display.Scale(1.0, "m/s²"))], 300)


def _trust(found: Orientation, other: tuple[str, Orientation], g: float = 9.81) -> dict[str, str]:
    """Return what the log itself says of how far the result can be trusted."""
    a = free_acceleration(found)
    apart = np.degrees(rot.inclination_error(found.q, other[1].q))
    return {
        "differ": f"{np.sqrt(np.mean(apart**2)):.2g}° RMS, {apart.max():.2g}° at most",
        "method": METHODS[other[0]],
        "tilt": f"{np.degrees(np.linalg.norm(a[:, :2].mean(axis=0)) / g):.2g}°",
        "moving": f"{np.sqrt(np.mean(np.sum(a**2, axis=1))):.3g} m/s² RMS",
    }
