"""The report of a reconstructed vibration, as Fig. 6-13 to 6-23 of the source show theirs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
from scipy.signal import welch

from pinotwin.reconstruction.document import size
from pinotwin.reconstruction.result import Motion3, Vibration
from pinotwin.report.blocks import Page, Tile, tiles
from pinotwin.report.display import DEGREES
from pinotwin.report.figures import ACCENT, MEASURED, RESIDUAL, SOFT, Line, Panel, line, over_time, style
from pinotwin.units import rounded

_SHOWN = {  # Signal -> its name and scale
    "q": ("angle", DEGREES),
    "v": ("velocity", replace(DEGREES, unit="°/s")),
    "a": ("acceleration", replace(DEGREES, unit="°/s²")),
}


def vibration_report(found: Vibration) -> str:
    """Return a self-contained HTML page about a reconstruction."""
    counts = {"run": len(found.runs), "IMU": len(found.sensors)}
    said = ", ".join(f"{n} {word}{'s' if n > 1 else ''}" for word, n in counts.items())
    given = {
        "found": found,
        "doubt": _degrees(size(found.motion.sd_q)),
        "tiles_": tiles(_tiles(found)),
        "deflection": _series(found.motion),
        "repeats": _runs(found) if max(counts.values()) > 1 else None,
        "spectrum": _spectrum(found),
        "degrees": np.degrees,
        "parasitic": _parasitic(found),
    }
    title = f"{found.machine}: vibration of {found.joint}"
    return Page(title, said, template="vibration", given=given).html()


def _degrees(x: float, digits: int = 2) -> str:
    return f"{np.degrees(x):.{digits}g}"


def _tiles(found: Vibration) -> list[Tile]:
    m = found.motion
    out = []
    for k, (word, scale) in _SHOWN.items():
        rms, doubt = _degrees(float(np.nanstd(getattr(m, k))), 3), _degrees(size(getattr(m, f"sd_{k}")))
        out.append(Tile(f"{word} of {found.joint}", f"{rms} {scale.unit} RMS", f"± {doubt} {scale.unit}"))
    (f, f_se), (zeta, zeta_se) = found.frequency, found.damping
    mode, error = rounded(f, f_se)
    out.append(Tile("mode, motors held", f"{mode} Hz", f"± {error} Hz"))
    return [*out, Tile("damping ratio", f"{zeta:.4f}", f"± {zeta_se:.4f}")]


def _series(m: Motion3) -> go.Figure:
    panels = []
    for k, (word, scale) in _SHOWN.items():
        x, sd = getattr(m, k), getattr(m, f"sd_{k}")
        ends = [Line("95 %", end, SOFT, 0.7, legend=False) for end in (x - 2 * sd, x + 2 * sd)]
        panels.append(Panel(word, [*ends, Line(word, x, ACCENT, legend=False)], scale))
    return over_time(m.t, panels, 620)


def _runs(found: Vibration, most: int = 6) -> go.Figure:
    """Return the velocity of every run, of ``most`` runs at most, and of the mean."""
    runs = zip(found.runs[:most], found.delays, strict=False)
    lines = [Line(f"run {k}", run.v, SOFT, 0.8, t=run.t - delay) for k, (run, delay) in enumerate(runs, 1)]
    lines.append(Line("mean", found.motion.v, ACCENT, 1.2))
    return over_time(found.motion.t, [Panel("velocity", lines, _SHOWN["v"][1])], 320)


def _spectrum(found: Vibration) -> go.Figure:
    m, mode = found.motion, found.frequency[0]
    v, rate = np.degrees(np.nan_to_num(m.v)), 1.0 / float(np.median(np.diff(m.t)))
    f, power = welch(v, rate, nperseg=min(len(v), 2048))
    figure = go.Figure(line(f[1:], np.sqrt(power[1:]), "velocity", ACCENT, legend=False))
    figure.add_vline(x=mode, line={"color": MEASURED, "dash": "dot"}, annotation_text=f"{mode:.1f} Hz")
    style(figure, 300, x="frequency [Hz]", y="amplitude density [deg/s/√Hz]", legend=False)
    figure.update_xaxes(range=[0, min(0.5 * rate, 6 * mode)])
    return figure.update_yaxes(type="log")


def _parasitic(found: Vibration) -> go.Figure:
    part = found.sensors[0].runs[0].found
    lines = [Line("second axis", part.parasitic[:, 0], MEASURED, 0.8)]
    lines.append(Line("third axis", part.parasitic[:, 1], RESIDUAL, 0.8))
    lines.append(Line(found.joint, part.velocity, ACCENT))
    return over_time(part.t, [Panel("rate", lines, _SHOWN["v"][1])], 300)
