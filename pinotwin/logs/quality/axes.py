"""What the axes do in a log: which move, how fast, how far, and whether efforts come in time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.errors import nearest
from pinotwin.log import Log
from pinotwin.logs.quality.lead import Causes, effort_lead
from pinotwin.logs.quality.results import AxisQuality, ChannelQuality, Finding, Limits
from pinotwin.logs.quality.sampling import SLOW
from pinotwin.logs.quality.values import has_more_values, quantisation_step
from pinotwin.signals import (
    Clock,
    autocorrelation,
    derivatives,
    edge_samples,
    interior,
    low_pass,
    runs,
    segments,
    suggest_cutoff,
)

_SHORTEST = 40  # samples; below this a stretch has no interior after filtering
_CRAWL = 0.05  # share of the top speed below which friction is no function of speed (presliding)
_WIDER = 3.0  # corner for leads over that of the motion
_GAIN = 0.05  # fall of the residual's power below which a lead is not worth telling
_SAME = 0.99  # share of equal numbers that no two measurements have while they change
_LEVELS = 100  # distinct values below which numbers may well be equal
_RESCALED = 0.02  # by which the size of a position differs from its command's, whatever the controller
_SURE = 5.0  # standard errors by which that is known
_STANDS = 1e-3  # of its top speed, below which a command stands
_STAY = 20  # rows that it stands at least: its position has come to rest in the second half
_PLACES = 4  # at which it must have rested
_FAR = {False: 50.0, True: 500.0}  # m, rad
FOLLOWS = 0.5
"""[of the position's variation] Tracking error up to which command and position agree."""
HUNTS = 3.0
"""[1/s] Swings between efforts of either sign, beyond those of the command, from which a loop is unstable: 18 virtual
machines that are stable reach 0.75, one that is not 6.9."""
_AT_TOP = 0.9  # of the largest effort, from which a swing counts
_ASKED = 0.1  # of the command's largest acceleration, the same


def inspect_axes(
    log: Log, axes: Mapping[str, bool], ticks: Clock | None
) -> tuple[dict[str, AxisQuality], float]:
    """Return the table of the axes with a position, and the corner that these suggest."""
    present = [name for name in axes if f"{name}.q" in log and np.isfinite(log[f"{name}.q"]).any()]
    table = {name: _still(log, name, axes[name]) for name in present}
    moving = [name for name in present if table[name].moves]
    if ticks is None or not moving:
        return table, np.inf
    q = np.column_stack([log[f"{name}.q"] for name in moving])
    stretches = [
        s
        for s in segments(log.t, valid=np.asarray(np.isfinite(q).all(axis=1)))
        if s.stop - s.start >= _SHORTEST
    ]
    if not stretches:
        return table, np.inf
    cutoff = suggest_cutoff(q, ticks.rate, stretches)
    q, v, a = derivatives(q, ticks.rate, cutoff, segments=stretches)
    inside = _inside(len(q), cutoff, ticks.rate, stretches)
    for i, name in enumerate(moving):
        table[name] = replace(
            table[name],
            speed=float(np.abs(v[inside, i]).max()),
            acceleration=float(np.abs(a[inside, i]).max()),
        )
    if ticks.rate >= SLOW:
        # Reversals of dry friction tell a lead above the band of the motion.
        raw = np.column_stack([log[f"{name}.q"] for name in moving])
        cutoff_lead = min(_WIDER * cutoff, 0.45 * ticks.rate)
        rows = inside[:, None] & (np.abs(v) > _CRAWL * np.abs(v[inside]).max(axis=0))
        del q, v, a  # of a long log there is room for one set only
        causes = Causes(*derivatives(raw, ticks.rate, cutoff_lead, segments=stretches))
        for i, name in enumerate(moving):
            table[name] = _with_lead(table[name], log, name, causes, (ticks.rate, cutoff_lead, rows[:, i]))
    return table, cutoff


def _inside(n: int, cutoff: float, rate: float, stretches: Sequence[slice]) -> Mask:
    longest = max(s.stop - s.start for s in stretches)
    edge = min(edge_samples(cutoff, rate), longest // 4)
    return interior(n, edge, stretches)


def _still(log: Log, name: str, rotary: bool) -> AxisQuality:
    q = log[f"{name}.q"]
    good = q[np.isfinite(q)]
    low, high = float(good.min()), float(good.max())
    step = quantisation_step(good) or 0.0
    moves = high - low > max(10.0 * step, 1e-6) and len(good) > 10
    # Noise about a held position has no memory; any motion has, even at ten samples a stroke.
    moves = moves and bool(autocorrelation(good, 1)[1] > 0.5)
    return AxisQuality(rotary, moves, low, high, 0.0, 0.0)


def _with_lead(
    axis: AxisQuality, log: Log, name: str, causes: Causes, how: tuple[float, float, Mask]
) -> AxisQuality:
    rate, cutoff, usable = how
    if f"{name}.u" not in log:
        return axis
    u = log[f"{name}.u"]
    if not np.isfinite(u).all() or np.ptp(u) == 0 or len(u) < _SHORTEST:
        return axis
    rows = np.flatnonzero(usable)
    lead = effort_lead(low_pass(u, rate, cutoff), causes, rate, rows)
    if lead is None or lead.gain < _GAIN:
        return axis
    return replace(axis, lead=lead.seconds, lead_error=lead.error)


def axis_findings(
    log: Log,
    axes: Mapping[str, bool],
    table: Mapping[str, AxisQuality],
    channels: Mapping[str, ChannelQuality],
    limits: Mapping[str, Limits],
    ticks: Clock | None,
) -> Iterator[Finding]:
    """Say what is wrong with, or missing from, the axes."""
    for name in axes:
        if name not in table:
            hint = nearest(f"{name}.q", log.channels)
            remedy = f"map it under columns in machine.yaml, or take the axis out of axes; {hint}"
            yield Finding("error", name, f"no position {name}.q; {remedy}", "position_missing")
            continue
        axis = table[name]
        if f"{name}.u" not in log:
            yield Finding(
                "warning",
                name,
                f"no effort {name}.u: its parameters cannot be identified; log it",
                "effort_missing",
            )
        if not axis.moves:
            yield Finding("warning", name, "does not move: nothing of it can be identified", "axis_still")
        if not _turns_freely(axis, limits.get(name)):
            yield from _unit_findings(name, axis)
        yield from _limit_findings(name, axis, channels.get(f"{name}.u"), limits.get(name))
        yield from _agreement(log, name)
        if axis.moves and ticks is not None:
            yield from _hunting(log, name, ticks)
        yield from _second_encoder(log, name, axes[name])
    yield from _lead_findings(table, limits, ticks.step if ticks else np.inf)
    if table and not any(axis.moves for axis in table.values()):
        yield Finding("error", "", "no axis moves; record a motion", "no_motion")


def _turns_freely(axis: AxisQuality, limits: Limits | None) -> bool:
    """Whether any angle may be: a joint without limits, or a motor ahead of a gear."""
    return axis.rotary and limits is not None and limits.position is None


def _unit_findings(name: str, axis: AxisQuality) -> Iterator[Finding]:
    far = max(abs(axis.low), abs(axis.high))
    if far > _FAR[axis.rotary]:
        reached, unit = ("rad", "deg") if axis.rotary else ("m", "mm")
        yield Finding(
            "warning",
            f"{name}.q",
            f"reaches {far:.4g} {reached}: looks like {unit}, set unit: {unit} under columns in "
            f"machine.yaml if so",
            "position_unit",
        )


def _lead_findings(
    table: Mapping[str, AxisQuality], limits: Mapping[str, Limits], step: float
) -> Iterator[Finding]:
    """Say in one sentence by how much the efforts are ahead of, or behind, the positions.

    Up to one step of the clock is the sampling of any digital controller and not worth a word; nor is what
    machine.yaml states already.
    """
    sure = {
        name: (axis.lead, axis.lead_error)
        for name, axis in table.items()
        if axis.lead is not None
        and axis.lead_error is not None
        and abs(axis.lead - limits.get(name, Limits()).lead) > max(3.0 * axis.lead_error, step)
    }
    for sign, how in ((1, "leads"), (-1, "lags")):
        leads = {name: 1e3 * x for name, (x, _) in sure.items() if x * sign > 0}
        if leads:
            each = ", ".join(f"{k} {abs(x):.1f} ± {1e3 * sure[k][1]:.1f}" for k, x in leads.items())
            first, lead = next(iter(leads.items()))
            yield Finding(
                "warning",
                ", ".join(f"{name}.u" for name in leads),
                f"effort {how} the position by about {np.median(np.abs(list(leads.values()))):.1f} ms (by "
                f"axis: {each}): the channels are not taken at the same instant; `identify` finds such a lead and "
                f"says so, or state it in machine.yaml (axes.{first}: `lead: {lead:.1f} ms`)",
                "effort_lead",
            )


def _limit_findings(
    name: str, axis: AxisQuality, effort: ChannelQuality | None, limits: Limits | None
) -> Iterator[Finding]:
    if limits is None:
        return
    if limits.position is not None:
        low, high = limits.position
        slack = 0.01 * (high - low)
        if axis.low < low - slack or axis.high > high + slack:
            yield Finding(
                "warning",
                f"{name}.q",
                f"ranges from {axis.low:.4g} to {axis.high:.4g}, outside the URDF's limits "
                f"{low:.4g} to {high:.4g}: check unit and zero under columns in machine.yaml",
                "position_limit",
            )
    if limits.velocity is not None and axis.speed > 1.05 * limits.velocity:
        yield Finding(
            "warning",
            f"{name}.q",
            f"reaches the speed {axis.speed:.4g}, above the URDF's limit {limits.velocity:.4g}",
            "speed_limit",
        )
    top = 0.0 if effort is None else max(abs(effort.low), abs(effort.high))
    if limits.effort is not None and top > 1.05 * limits.effort:
        yield Finding(
            "warning",
            f"{name}.u",
            f"reaches {top:.4g}, above the URDF's limit {limits.effort:.4g}: check its factor",
            "effort_limit",
        )


def _hunting(log: Log, name: str, ticks: Clock) -> Iterator[Finding]:
    """Say of a loop that swings from one limit of its drive to the other, unasked."""
    if not {f"{name}.u", f"{name}.qr"} <= set(log.channels):
        return
    u, command = (x[np.isfinite(x)] for x in (log[f"{name}.u"], log[f"{name}.qr"]))
    if not has_more_values(u, _LEVELS):
        return
    seconds = len(log.t) * ticks.step
    rate = (_swings(u, _AT_TOP) - _swings(np.diff(command, 2), _ASKED)) / seconds
    if rate > HUNTS:
        yield Finding(
            "warning",
            f"{name}.u",
            f"swings {rate:.0f} times a second between its largest efforts either way, unasked by the command: its "
            "loop is unstable; lower its gains, or leave those seconds out (data: leave_out in machine.yaml)",
            "loop_unstable",
        )


def _swings(x: Floats, least: float) -> int:
    """Return how often a signal goes from one sign to the other, by rows of that share of its largest size."""
    side = np.sign(x) * (np.abs(x) > least * np.max(np.abs(x), initial=0.0))
    return int(np.count_nonzero(np.diff(side[side != 0.0])))


def _agreement(log: Log, name: str) -> Iterator[Finding]:
    """Compare position with command and with velocity: other units or other axes show at once."""
    q = log[f"{name}.q"]
    if f"{name}.qr" in log:
        command = log[f"{name}.qr"]
        both = np.isfinite(q) & np.isfinite(command)
        fine = has_more_values(q[both], _LEVELS)
        if fine and np.mean(q[both] == command[both]) > _SAME:
            yield Finding(
                "warning",
                f"{name}.q",
                f"holds the same numbers as {name}.qr: a command was logged twice; map the measured position",
                "command_is_position",
            )
        yield from _follows(name, q[both], command[both])
    if f"{name}.v" in log and "t" in log:
        good = np.isfinite(q) & np.isfinite(log[f"{name}.v"]) & np.isfinite(log.t)
        rise, t = np.diff(q[good]), np.diff(log.t[good])
        v = log[f"{name}.v"][good]
        moved = (v[1:] + v[:-1]) / 2.0 * t
        power = float(moved @ moved)
        ratio = float(rise @ moved) / power if power > 0 else 1.0
        fits = power > 0 and float(rise @ moved) ** 2 > 0.5 * power * float(rise @ rise)
        if fits and not 0.8 < ratio < 1.25:
            yield Finding(
                "warning",
                f"{name}.v",
                f"the position changes {ratio:.4g} times as fast as this velocity says: check both units",
                "velocity_disagrees",
            )


def _follows(name: str, q: Floats, command: Floats) -> Iterator[Finding]:
    """Compare the size of position and command."""
    if not len(q) or not np.ptp(q) > 0.0:
        return
    factor, error = _factor_at_rest(q, command)
    sure = abs(factor - 1.0) > max(_SURE * error, _RESCALED)
    if np.std(q - command) > FOLLOWS * np.std(q):
        times = f": at rest the position goes {factor:.4g} times as far" if sure else ""
        yield Finding(
            "warning",
            f"{name}.qr",
            f"command and position do not agree{times}; another unit, sign or axis? check columns",
            "command_disagrees",
        )
    elif sure:
        yield Finding(
            "warning",
            f"{name}.q",
            f"goes {factor:.4g} times as far as its command, where it rests: another gear, lead or unit? set factor "
            "under columns in machine.yaml",
            "position_scale",
        )


def _factor_at_rest(q: Floats, command: Floats) -> tuple[float, float]:
    """Return how many times as far as its command a position goes, and the error, from the places where it rests.

    In motion a controller may overshoot by a tenth: only where the command stands does its size show.
    """
    speed = np.abs(np.diff(command, prepend=command[:1]))
    rests = [s for s in runs(speed <= _STANDS * speed.max(initial=0.0)) if s.stop - s.start >= _STAY]
    if len(rests) < _PLACES:
        return 1.0, np.inf
    high = np.array([s.stop for s in rests])
    low = (np.array([s.start for s in rests]) + high) // 2
    rows = np.column_stack([low, high - 1]).ravel()  # reduceat sums from low to the row before the last
    x, y = (np.add.reduceat(z, rows)[::2] / (high - 1 - low) for z in (command, q))
    if not np.ptp(x) > 0.1 * np.ptp(command):
        return 1.0, np.inf
    x, y = x - x.mean(), y - y.mean()
    factor = float(x @ y) / float(x @ x)
    away = y - factor * x
    weight = x**2 / float(x @ x) + 1.0 / len(x)  # what leaving one out moves the factor by
    moved = x * away / (float(x @ x) * (1.0 - np.minimum(weight, 0.999)))
    return factor, float(np.sqrt((len(x) - 1) / len(x) * np.sum(moved**2)))


def _second_encoder(log: Log, name: str, rotary: bool) -> Iterator[Finding]:
    """Compare the position at the load with that at the motor, in one line."""
    if f"{name}.ql" not in log:
        return
    q, ql = log[f"{name}.q"], log[f"{name}.ql"]
    good = np.isfinite(q) & np.isfinite(ql)
    if good.sum() < _SHORTEST or np.std(q[good]) == 0.0:
        return
    if np.std(ql[good]) == 0.0:
        yield Finding("warning", f"{name}.ql", "is constant: no encoder at the load? drop it from columns")
        return
    q, ql = q[good], ql[good]
    slope, offset = np.polyfit(q - q.mean(), ql - q.mean(), 1)
    away = ql - q.mean() - offset - slope * (q - q.mean())
    speed = np.gradient(q)
    fast = np.abs(speed) > 0.1 * np.abs(speed).max()
    up, down = fast & (speed > 0.0), fast & (speed < 0.0)
    lost = float(abs(away[up].mean() - away[down].mean())) if up.any() and down.any() else 0.0
    scale, unit = (1e6, "µrad") if rotary else (1e6, "µm")
    correlation = float(np.corrcoef(q, ql)[0, 1])
    said = (
        f"at the load against the motor: offset {scale * offset:.4g} {unit}, difference "
        f"{scale * float(away.std()):.3g} {unit} rms, lost motion between the directions {scale * lost:.3g} "
        f"{unit}, correlation {correlation:.7f}"
    )
    wrong = not 0.8 < slope < 1.25 or correlation < 0.9
    remedy = (
        f"; it moves {slope:.4g} times as far: another unit, sign or axis? check columns" if wrong else ""
    )
    yield Finding("warning" if wrong else "info", f"{name}.ql", said + remedy)
