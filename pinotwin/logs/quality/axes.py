"""What the axes do in a log: which move, how fast, how far, and whether efforts come in time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from pinotwin import signals
from pinotwin.arrays import Floats, Ints, Mask
from pinotwin.errors import nearest
from pinotwin.log import Log
from pinotwin.logs.quality.results import AxisQuality, ChannelQuality, Finding, Limits, finding
from pinotwin.logs.quality.values import has_more_values, quantisation_step
from pinotwin.logs.settings import USUAL, Settings
from pinotwin.solve.lead import lag

_SHORTEST = 40  # samples; below this a stretch has no interior after filtering
_TURNS = 0.02  # of a motor's travel, RMS: what another joint must turn of it to be worth a word
_LEVELS = 100  # distinct values below which numbers may well be equal


def inspect_axes(
    log: Log, axes: Mapping[str, bool], ticks: signals.Clock | None, settings: Settings = USUAL
) -> tuple[dict[str, AxisQuality], float]:
    """Return the table of the axes with a position, and the corner that these suggest."""
    present = [name for name in axes if f"{name}.q" in log and np.isfinite(log[f"{name}.q"]).any()]
    reach = {name: float(np.nanmax(log[f"{name}.q"]) - np.nanmin(log[f"{name}.q"])) for name in present}
    widest = {
        kind: max((reach[k] for k in present if axes[k] == kind), default=0.0) for kind in (False, True)
    }
    table = {name: _still(log, name, axes[name], widest[axes[name]]) for name in present}
    moving = [name for name in present if table[name].moves]
    if ticks is None or not moving:
        return table, np.inf
    raw = np.column_stack([log[f"{name}.q"] for name in moving])
    good = np.asarray(np.isfinite(raw).all(axis=1))
    stretches = [s for s in signals.segments(log.t, valid=good) if s.stop - s.start >= _SHORTEST]
    if not stretches:
        return table, np.inf
    cutoff = signals.suggest_cutoff(raw, ticks.rate, stretches)
    q, v, a = signals.derivatives(raw, ticks.rate, cutoff, segments=stretches)
    longest = max(s.stop - s.start for s in stretches)
    edge = min(signals.edge_samples(cutoff, ticks.rate), longest // 4)
    inside = signals.interior(len(raw), edge, stretches)
    top, sharpest = np.abs(v[inside]).max(axis=0), np.abs(a[inside]).max(axis=0)
    for name, speed, acceleration in zip(moving, top.tolist(), sharpest.tolist(), strict=True):
        table[name] = replace(table[name], speed=speed, acceleration=acceleration)
    if ticks.rate >= settings.slow_rate:
        # Reversals of dry friction tell a lead above the band of the motion; at a crawl it is no function of speed.
        corner = min(3.0 * cutoff, 0.45 * ticks.rate)
        usable = inside[:, None] & (np.abs(v) > 0.05 * top)
        del q, v, a  # of a long log there is room for one set only
        causes = signals.derivatives(raw, ticks.rate, corner, segments=stretches)
        for i, name in enumerate(moving):
            u = log.channels.get(f"{name}.u", np.zeros(0))
            if np.isfinite(u).all() and len(u) >= _SHORTEST and np.ptp(u) > 0:
                smooth = signals.low_pass(u, ticks.rate, corner)
                seconds, error = _lead(smooth, causes, ticks.rate, np.flatnonzero(usable[:, i]), settings)
                table[name] = replace(table[name], lead=seconds, lead_error=error)
    return table, cutoff


def _lead(
    u: Floats, causes: tuple[Floats, Floats, Floats], rate: float, rows: Ints, settings: Settings
) -> tuple[float, float] | tuple[None, None]:
    """Return by how much an effort is ahead of the motion of all axes, and the error [s]; None where nothing tells."""
    reach = max(3, int(np.ceil(settings.lead_reach * rate)))
    rows = rows[(rows >= reach) & (rows < len(u) - reach)]
    rows = rows[:: max(1, len(rows) // 8000)]
    q, v, a = causes
    place = (q[rows] - q.mean(axis=0)) / q.std(axis=0)
    columns = np.column_stack([a[rows], v[rows], np.sign(v[rows]), place, place**2, np.ones(len(rows))])
    if len(rows) < 20 * columns.shape[1]:
        return None, None
    basis = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))[0]
    found = lag(u, rows, basis, reach, most=41, blocks=6)
    if not np.isfinite(found.error) or found.left > (1.0 - settings.lead_gain) * found.left_now:
        return None, None
    return -found.part / rate, found.error / rate


def _still(log: Log, name: str, rotary: bool, widest: float) -> AxisQuality:
    q = log[f"{name}.q"]
    good = q[np.isfinite(q)]
    low, high = float(good.min()), float(good.max())
    step = quantisation_step(good) or 0.0
    moves = high - low > max(10.0 * step, min(40.0 * step, 1e-3 * widest), 1e-6) and len(good) > 10
    # A few steps beside an axis that goes a thousand times as far are its shaking.
    # Noise about a held position has no memory; any motion has, even at ten samples a stroke.
    moves = moves and bool(signals.autocorrelation(good, 1)[1] > 0.5)
    return AxisQuality(rotary, moves, low, high, 0.0, 0.0)


def axis_findings(
    log: Log,
    axes: Mapping[str, bool],
    table: Mapping[str, AxisQuality],
    channels: Mapping[str, ChannelQuality],
    limits: Mapping[str, Limits],
    ticks: signals.Clock | None,
    settings: Settings = USUAL,
) -> Iterator[Finding]:
    """Say what is wrong with, or missing from, the axes."""
    for name in axes:
        if name not in table:
            yield finding("position_missing", name, axis=name, hint=nearest(f"{name}.q", log.channels))
            continue
        axis, own = table[name], limits.get(name, Limits())
        if f"{name}.u" not in log:
            yield finding("effort_missing", name, axis=name)
        if not axis.moves:
            yield finding("axis_still", name)
        if not (axis.rotary and name in limits and limits[name].position is None):
            yield from _unit_findings(name, axis)
        yield from _limit_findings(name, axis, channels.get(f"{name}.u"), own)
        yield from _agreement(log, name, settings, rotary=axes[name])
        if axis.moves and ticks is not None:
            yield from _unstable(log, name, ticks, settings)
            yield from _hunting(log, name, axes, ticks)
        yield from _second_encoder(log, name, axes[name])
    yield from _lead_findings(table, limits, ticks.step if ticks else np.inf)
    if table and not any(axis.moves for axis in table.values()):
        yield finding("no_motion")


def _unit_findings(name: str, axis: AxisQuality) -> Iterator[Finding]:
    far = max(abs(axis.low), abs(axis.high))
    if far > (500.0 if axis.rotary else 50.0):  # rad, m
        unit, other = ("rad", "deg") if axis.rotary else ("m", "mm")
        yield finding("position_unit", f"{name}.q", far=far, unit=unit, other=other)


def _lead_findings(
    table: Mapping[str, AxisQuality], limits: Mapping[str, Limits], step: float, sure: float = 5.5
) -> Iterator[Finding]:
    """Say in one sentence by how much efforts lead: so many errors of six blocks are as sure as three of a normal."""
    known = {
        name: (axis.lead, axis.lead_error)
        for name, axis in table.items()
        if axis.lead is not None
        and axis.lead_error is not None
        and abs(axis.lead - limits.get(name, Limits()).lead) > max(sure * axis.lead_error, step)
    }
    for sign, how in ((1, "leads"), (-1, "lags")):
        leads = {name: 1e3 * x for name, (x, _) in known.items() if x * sign > 0}
        if leads:
            each = ", ".join(f"{k} {abs(x):.1f} ± {1e3 * known[k][1]:.1f}" for k, x in leads.items())
            axis, lead = next(iter(leads.items()))
            usual = np.median(np.abs(list(leads.values())))
            channels = ", ".join(f"{name}.u" for name in leads)
            yield finding("effort_lead", channels, how=how, usual=usual, each=each, axis=axis, lead=lead)


def _limit_findings(
    name: str, axis: AxisQuality, effort: ChannelQuality | None, limits: Limits
) -> Iterator[Finding]:
    if limits.position is not None:
        low, high = limits.position
        slack = 0.01 * (high - low)
        if axis.low < low - slack or axis.high > high + slack:
            reached = {"low": axis.low, "high": axis.high}
            yield finding("position_limit", f"{name}.q", **reached, least=low, most=high)
    if limits.velocity is not None and axis.speed > 1.05 * limits.velocity:
        yield finding("speed_limit", f"{name}.q", speed=axis.speed, limit=limits.velocity)
    top = 0.0 if effort is None else max(abs(effort.low), abs(effort.high))
    if limits.effort is not None and top > 1.05 * limits.effort:
        yield finding("effort_limit", f"{name}.u", top=top, limit=limits.effort)


def _hunting(log: Log, name: str, axes: Mapping[str, bool], ticks: signals.Clock) -> Iterator[Finding]:
    """Say of a position that swings about a command which stands, faster than any other axis is told to move."""
    if f"{name}.qr" not in log or not np.isfinite(log[f"{name}.q"]).all():
        return
    q, orders = log[f"{name}.q"], {k: log[f"{k}.qr"] for k in axes if f"{k}.qr" in log}
    stands = np.abs(np.diff(orders[name], prepend=orders[name][:1])) <= 1e-9 * np.ptp(q)
    least = max(10.0 * (quantisation_step(q) or 0.0), 1e-3 * float(np.ptp(q)))
    found = []
    for rows in (rows for rows in signals.runs(stands) if np.ptp(q[rows]) > least):
        period, size = _wave(q[rows])
        asked = max(_swings(np.diff(order[rows]), least=0.1) for order in orders.values())
        if period and size > least and len(q[rows]) > max(3.0, 1.5 * asked) * period:
            found.append((rows, period, size))
    if found:
        rows, period, size = max(found, key=lambda one: one[2])
        spans = {"start": log.t[found[0][0].start], "end": log.t[found[-1][0].stop - 1]}
        total = sum(rows.stop - rows.start for rows, _, _ in found) * ticks.step
        said = {"size": 1e3 * size, "unit": "mrad" if axes[name] else "mm", "rate": ticks.rate / period}
        yield finding("loop_hunts", f"{name}.q", **said, **spans, total=total)


def _wave(x: Floats, alike: float = 0.6) -> tuple[int, float]:
    """Return the period of a wave that does not die away [rows], and its amplitude; 0 where there is none."""
    if len(x) < _SHORTEST:
        return 0, 0.0
    x = x - np.polyval(np.polyfit(np.arange(len(x)), x, 1), np.arange(len(x)))
    memory = signals.autocorrelation(x, len(x) // 3)
    turned = int(np.argmax(memory < 0.0))
    first, last = np.std(x[: len(x) // 2]), np.std(x[len(x) // 2 :])
    if not turned or last < 0.7 * first or memory[turned:].max() < alike:
        return 0, 0.0
    return turned + int(np.argmax(memory[turned:])), float(np.sqrt(2.0) * last)


def _unstable(log: Log, name: str, ticks: signals.Clock, settings: Settings) -> Iterator[Finding]:
    """Say of a loop that swings from one limit of its drive to the other, unasked."""
    if not {f"{name}.u", f"{name}.qr"} <= set(log.channels):
        return
    u, command = (x[np.isfinite(x)] for x in (log[f"{name}.u"], log[f"{name}.qr"]))
    if not has_more_values(u, _LEVELS):
        return
    seconds = len(log.t) * ticks.step
    rate = (_swings(u, least=0.9) - _swings(np.diff(command, 2), least=0.1)) / seconds
    if rate > settings.hunts:
        yield finding("loop_unstable", f"{name}.u", rate=rate)


def _swings(x: Floats, least: float) -> int:
    """Return how often a signal goes from one sign to the other, by rows of that share of its largest size."""
    side = np.sign(x) * (np.abs(x) > least * np.max(np.abs(x), initial=0.0))
    return int(np.count_nonzero(np.diff(side[side != 0.0])))


def _agreement(log: Log, name: str, settings: Settings, *, rotary: bool) -> Iterator[Finding]:
    """Compare position with command and with velocity: other units or other axes show at once."""
    q = log[f"{name}.q"]
    if f"{name}.qr" in log:
        command = log[f"{name}.qr"]
        both = np.isfinite(q) & np.isfinite(command)
        fine = has_more_values(q[both], _LEVELS)
        if fine and np.mean(q[both] == command[both]) > settings.twice:
            yield finding("command_is_position", f"{name}.q", axis=name)
        rests, at = _rests(q[both], command[both])
        yield from _follows(name, q[both], command[both], at, settings)
        if "t" in log:
            begins = log.t[both][[s.start for s in rests]]
            yield from _slipped(name, q[both], begins, at, settings, rotary=rotary)
    if f"{name}.v" in log and "t" in log:
        good = np.isfinite(q) & np.isfinite(log[f"{name}.v"]) & np.isfinite(log.t)
        rise, t = np.diff(q[good]), np.diff(log.t[good])
        v = log[f"{name}.v"][good]
        moved = (v[1:] + v[:-1]) / 2.0 * t
        power = float(moved @ moved)
        ratio = float(rise @ moved) / power if power > 0 else 1.0
        fits = power > 0 and float(rise @ moved) ** 2 > 0.5 * power * float(rise @ rise)
        if fits and not 0.8 < ratio < 1.25:
            yield finding("velocity_disagrees", f"{name}.v", ratio=ratio)


def _follows(name: str, q: Floats, command: Floats, at: Floats, settings: Settings) -> Iterator[Finding]:
    if not len(q) or not np.ptp(q) > 0.0:
        return
    factor, error = _factor_at_rest(at, float(np.ptp(command)))
    sure = abs(factor - 1.0) > max(settings.rescaled_sure * error, settings.rescaled)
    if np.std(q - command) > settings.follows * np.std(q):
        times = f": at rest the position goes {factor:.4g} times as far" if sure else ""
        yield finding("command_disagrees", f"{name}.qr", times=times)
    elif sure:
        yield finding("position_scale", f"{name}.q", factor=factor)


def _rests(q: Floats, command: Floats, stay: int = 20) -> tuple[list[slice], Floats]:
    """Return where a command rests; command and position there, and from which side it came, (3, k)."""
    speed = np.abs(np.diff(command, prepend=command[:1]))
    rests = [s for s in signals.runs(speed <= 1e-3 * speed.max(initial=0.0)) if s.stop - s.start >= stay]
    x, y = ([z[(s.start + s.stop) // 2 : s.stop - 1].mean() for s in rests] for z in (command, q))
    return rests, np.array([x, y, np.sign(np.diff(x, prepend=command[:1]))])


def _factor_at_rest(at: Floats, travel: float, places: int = 4) -> tuple[float, float]:
    """Return how many times as far as its command a position goes, and the error, from the places where it rests."""
    x, y, _ = at
    if len(x) < places or not np.ptp(x) > 0.1 * travel:
        return 1.0, np.inf
    x, y = x - x.mean(), y - y.mean()
    factor = float(x @ y) / float(x @ x)
    away = y - factor * x
    weight = x**2 / float(x @ x) + 1.0 / len(x)  # what leaving one out moves the factor by
    moved = x * away / (float(x @ x) * (1.0 - np.minimum(weight, 0.999)))
    return factor, float(np.sqrt((len(x) - 1) / len(x) * np.sum(moved**2)))


def _slipped(
    name: str, q: Floats, begins: Floats, at: Floats, settings: Settings, *, rotary: bool
) -> Iterator[Finding]:
    """Say since when a position rests off its command by as much wherever it is, from whichever side it came.

    ``begins``: of each rest [s], (k,); ``at``: see :func:`_rests` [m or rad].
    """
    x, y, side = at
    away = y - x
    change = np.abs(np.diff(away))
    late = np.flatnonzero(change > 0.5 * change.max(initial=0.0)) + 1
    parts = np.diff([0, *late, len(x)])
    if not len(late) or parts.min() < 2 or len(x) < len(late) + 9:
        return  # what comes and goes has not slipped, and of few places chance may have chosen the best
    since = (np.arange(len(x))[:, None] >= late).astype(float)
    X = np.column_stack([since, np.ones(len(x)), x - x.mean(), side])
    size = np.linalg.lstsq(X, away, rcond=None)[0]
    left = signals.rms(away - X @ size) * np.sqrt(len(x) / max(len(x) - X.shape[1], 1))
    least = max(settings.rescaled_sure * max(left, quantisation_step(q) or 0.0), settings.slipped * np.ptp(x))
    steps = size[: len(late)]
    if np.abs([steps, np.cumsum(steps)]).min() > least:
        unit, pairs = "mrad" if rotary else "mm", zip(np.cumsum(steps), begins[late], strict=True)
        words = " and ".join(f"by {1e3 * x:.3g} {unit} from {start:.6g} s on" for x, start in pairs)
        yield finding("slipped", f"{name}.q", words=words)


def lost_motion(away: Floats, speed: Floats) -> float:
    """Return by how much the load lags between the directions, from load less motor and speed in motion, (n,) each."""
    fast = np.abs(speed) > 0.1 * np.abs(speed).max()
    up, down = fast & (speed > 0.0), fast & (speed < 0.0)
    return float(abs(away[up].mean() - away[down].mean())) if up.any() and down.any() else 0.0


def _geared(log: Log, name: str, rows: Mask) -> str:
    """Return the row of a transmission by which a motor turns several joints; "" where it follows from none."""
    others = [k for k in log.channels if k.endswith(".q") and k != f"{name}.q"]
    moved = [log[k][rows] for k in (f"{name}.ql", *others)]
    y = log[f"{name}.q"][rows] - np.mean(log[f"{name}.q"][rows])
    X = np.array([x - np.mean(x) for x in moved]).T
    if not others or not np.isfinite(X).all():
        return ""
    ratio = np.linalg.lstsq(X, y, rcond=None)[0]
    turns = np.abs(ratio) * X.std(axis=0) > _TURNS * y.std()
    if np.std(y - X @ ratio) > 0.1 * _TURNS * y.std() or not turns[0] or not turns[1:].any():
        return ""
    owners = [k.rpartition(".")[0] for k in (f"{name}.q", *others)]
    return ", ".join(f"{k}: {x:.4g}" for k, x, on in zip(owners, ratio, turns, strict=True) if on)


def _second_encoder(log: Log, name: str, rotary: bool) -> Iterator[Finding]:
    if f"{name}.ql" not in log:
        return
    q, ql = log[f"{name}.q"], log[f"{name}.ql"]
    good = np.isfinite(q) & np.isfinite(ql)
    if good.sum() < _SHORTEST or np.std(q[good]) == 0.0:
        return
    if np.std(ql[good]) == 0.0:
        yield finding("load_constant", f"{name}.ql")
        return
    q, ql = q[good], ql[good]
    slope, offset = np.polyfit(q - q.mean(), ql - q.mean(), 1)
    away = ql - q.mean() - offset - slope * (q - q.mean())
    lost = lost_motion(away, np.gradient(q))
    correlation = float(np.corrcoef(q, ql)[0, 1])
    wrong = not 0.8 < slope < 1.25 or correlation < 0.9
    if wrong and away.std() > _TURNS * ql.std() and (row := _geared(log, name, good)):
        yield finding("motor_turns_several", f"{name}.ql", axis=name, row=row)
        return
    remedy = (
        f"; it moves {slope:.4g} times as far: another unit, sign or axis? check columns" if wrong else ""
    )
    sizes = {"offset": 1e6 * offset, "rms": 1e6 * float(away.std()), "lost": 1e6 * lost}
    said = {"unit": "µrad" if rotary else "µm", "correlation": correlation, "remedy": remedy}
    yield finding("load_position", f"{name}.ql", "warning" if wrong else "info", **sizes, **said)
