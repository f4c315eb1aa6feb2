"""Which column of a log is which channel of a machine, with the reason for every guess.

Names and units first (:mod:`.names`), then the numbers: which columns follow, which push, in which sense. What neither
says is left open and listed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import yaml
from scipy.ndimage import uniform_filter1d

from pinotwin.arrays import Floats
from pinotwin.columns import bind, is_contract_name
from pinotwin.errors import LogError
from pinotwin.log import Log
from pinotwin.logs.files.cells import is_clock
from pinotwin.logs.quality.values import has_more_values
from pinotwin.scaffold.names import family, is_set_value, read_label
from pinotwin.signals import autocorrelation
from pinotwin.units import COUNTS, ELECTRICAL, SI_FACTOR


def moves(x: Floats) -> bool:
    """Whether a column is a motion: it varies, and its neighbours are alike."""
    good = x[np.isfinite(x)]
    return len(good) > 20 and has_more_values(good, 1) and float(autocorrelation(good, 1)[1]) > 0.9


def is_counter(x: Floats) -> bool:
    """Whether a column, shape (n,), only counts its rows."""
    steps = np.diff(x[np.isfinite(x)])
    return len(steps) > 5 and bool(np.all(steps == steps[0])) and steps[0] != 0.0


def distance(x: Floats, y: Floats) -> float:
    """Return how far two columns are apart, as a share of the motion of the first (0: equal)."""
    both = np.isfinite(x) & np.isfinite(y)
    size = float(np.std(x[both])) if both.any() else 0.0
    return float(np.std((x - y)[both])) / size if size > 0.0 else np.inf


def smoothness(x: Floats) -> float:
    """Return the share of a column that changes from sample to sample: less for a command than for an encoder."""
    good = x[np.isfinite(x)]
    size = float(np.std(good))
    return float(np.std(np.diff(good, 3))) / size if size > 0.0 and len(good) > 4 else np.inf


def lead(x: Floats, y: Floats) -> tuple[float, float]:
    """Return by how many samples ``x`` (n,) is ahead of ``y``, and the share of their difference that explains."""
    both = np.isfinite(x) & np.isfinite(y)
    speed = np.gradient(x[both])
    speed, apart = speed - speed.mean(), (x - y)[both] - np.mean((x - y)[both])
    power = float(speed @ speed) * float(apart @ apart)
    ahead = float(speed @ apart)
    return (ahead / float(speed @ speed), ahead**2 / power) if power > 0.0 else (0.0, 0.0)


def push(q: Floats, u: Floats, step: float, longest: int = 60_000) -> tuple[float, bool]:
    """Return how well a column ``u`` (n,) is explained as the effort of an axis that moves as ``q`` (n,).

    That is the share of its variance that inertia, friction, position and a constant explain in ``longest`` rows, and
    whether both inertia and dry friction come out negative: the column's sign is turned.
    """
    keep = slice(0, longest)
    position, effort = q[keep].astype(float), u[keep].astype(float)
    good = np.isfinite(position) & np.isfinite(effort)
    if good.sum() < 50 or np.ptp(effort[good]) == 0.0:
        return 0.0, False
    position = np.interp(np.arange(len(position)), np.flatnonzero(good), position[good])
    width = max(3, int(0.02 / step) | 1) if step > 0.0 else 5
    v = np.gradient(uniform_filter1d(position, width, mode="nearest"), step)
    a = np.gradient(uniform_filter1d(v, width, mode="nearest"), step)
    slow = 0.02 * float(np.abs(v).max())
    columns = np.column_stack([a, np.tanh(v / slow) if slow > 0 else v, v, position, np.ones(len(v))])
    columns /= np.maximum(np.std(columns, axis=0), 1e-12) + (np.std(columns, axis=0) == 0)
    theta, *_ = np.linalg.lstsq(columns[good], effort[good], rcond=None)
    left = effort[good] - columns[good] @ theta
    share = 1.0 - float(np.var(left)) / float(np.var(effort[good]))
    power = float(np.mean((effort * v)[good]))
    return share, bool(theta[0] < 0.0 and theta[1] + theta[2] < 0.0 and power < 0.0)


_TIME_UNITS = ("s", "ms", "us", "µs", "ns", "min", "sec", "Sek", "msec")


@dataclass(frozen=True)
class Guess:
    """One channel and the column it comes from."""

    channel: str  # name of the contract
    column: str | None  # name in the log; None for a clock made from ``rate``
    reason: str  # why
    unit: str = ""  # unit to write into the YAML, "" where the file states it
    factor: float = 1.0  # remaining factor
    rate: float | None = None  # sampling rate [Hz] of a clock without a column

    @property
    def entry(self) -> dict[str, Any]:
        """What a machine.yaml says of the channel under ``columns``."""
        if self.rate is not None:
            return {"rate": float(self.rate)}
        stated = {"column": self.column, "unit": self.unit, "factor": float(self.factor)}
        return {key: value for key, value in stated.items() if value not in ("", 1.0)}

    @property
    def yaml(self) -> str:
        """The line under ``columns`` of a machine.yaml, its reason as comment."""
        return f"{in_one_line({self.channel: self.entry})}  # {self.reason}"


def in_one_line(entry: Mapping[str, Any]) -> str:
    """Return an entry of a mapping as YAML has it in one line."""
    text = yaml.safe_dump(
        dict(entry), default_flow_style=True, sort_keys=False, allow_unicode=True, width=np.inf
    )
    return str(text).strip()[1:-1]


@dataclass(frozen=True)
class Guesses:
    """The columns of a log."""

    found: tuple[Guess, ...] = ()  # channel by channel
    open: tuple[str, ...] = ()  # what a person has to decide, one sentence each
    named: tuple[str, ...] = ()  # channels that the log already has under the contract's names
    unused: tuple[str, ...] = ()  # columns that no channel comes from

    def __contains__(self, channel: str) -> bool:
        return channel in self.named or any(g.channel == channel for g in self.found)


@dataclass
class _Table:
    """The log's columns while they are given away; an effort must be explained to a share by its axis' motion."""

    log: Log
    axes: Mapping[str, tuple[str, bool]]
    step: float
    named: Sequence[str]
    taken: dict[str, Guess] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    explained: float = 0.5

    def give(self, channel: str, column: str, reason: str) -> None:
        if channel not in self.taken and channel not in self.named:
            self.taken[channel] = Guess(channel, column, reason)
            self.used.add(column)

    def amend(self, guess: Guess, said: str, **changes: Any) -> None:
        """Change a guess, and say why."""
        self.taken[guess.channel] = replace(guess, reason=f"{guess.reason}; {said}", **changes)

    def values(self, channel: str) -> Floats | None:
        """Return the numbers of a channel that is given or named."""
        guess = self.taken.get(channel)
        return self.log.channels.get(channel if guess is None else guess.column or "")

    def free(self) -> list[str]:
        return [c for c in self.log.channels if c not in self.used]


def guess_columns(log: Log, axes: Mapping[str, tuple[str, bool]], rate: float | None = None) -> Guesses:
    """Return which column is which channel; ``axes``: joint, whether it turns; ``rate`` [Hz] for want of a clock."""
    try:
        named = tuple(bind(log, {}).channels)  # they need no mapping, ROS' joint names among them
    except LogError:
        named = ()
    clock, step, questions = _clock(log, rate, "t" in named)
    table = _Table(log, axes, step, named)
    if clock is not None:
        table.taken["t"] = clock
        table.used.add(clock.column or "")
    table.used.update(c for c in log.channels if is_contract_name(c))
    _by_name(table)
    _by_number(table)
    if not any(f"{axis}.q" in table.taken or f"{axis}.q" in named for axis in axes):
        _by_behaviour(table)
    _swapped(table)
    questions += _units(table) + _efforts(table) + _missing(table)
    order = ["t", *(f"{axis}.{s}" for axis in axes for s in ("qr", "q", "v", "u", "e"))]
    found = sorted(table.taken.values(), key=lambda g: order.index(g.channel) if g.channel in order else 999)
    return Guesses(tuple(found), tuple(questions), named, tuple(table.free()))


def _clock(log: Log, rate: float | None, named: bool) -> tuple[Guess | None, float, list[str]]:
    """Return the guess for ``t``, the step [s], and what is open about it."""
    if named:
        return None, _step(log["t"]) * SI_FACTOR[log.units.get("t", "s")], []
    if rate is not None:
        return Guess("t", None, "as given by --rate", rate=rate), 1.0 / rate, []
    finite = {c: x[np.isfinite(x)] for c, x in log.channels.items()}
    rising = [c for c, x in finite.items() if len(x) > 2 and (np.diff(x) >= 0).all() and x[-1] > x[0]]
    called = [c for c in rising if is_clock(c) or log.units.get(c) in _TIME_UNITS]
    if called:
        column = called[0]
        unit = log.units.get(column)
        step = _step(log[column])
        if unit in _TIME_UNITS:
            return Guess("t", column, f"it rises and is in {unit}"), step * SI_FACTOR[unit], []
        guess = "s" if step < 0.5 else "ms" if step < 500 else "us" if step < 5e5 else "ns"
        said = f"it rises by {step:g}; taken as {guess}"
        return Guess("t", column, said, unit="" if guess == "s" else guess), step * SI_FACTOR[guess], []
    return None, 0.0, ["t: no time column; give the sampling rate: `pinotwin new ... --rate HZ`"]


def _step(t: Floats) -> float:
    good = t[np.isfinite(t)]
    return float(np.median(np.diff(good))) if len(good) > 1 else 0.0


def _by_name(table: _Table) -> None:
    """Give columns whose name says axis and signal; measured efforts and speeds before commanded ones."""
    joints = [joint for joint, _ in table.axes.values()]
    labels = {
        c: read_label(c, table.log.units.get(c), list(table.axes), joints)
        for c in table.free()
        if not is_contract_name(c)
    }
    only = next(iter(table.axes)) if len(table.axes) == 1 else None
    for column, (named, signal, why) in sorted(labels.items(), key=lambda item: is_set_value(item[0])):
        axis = named or only
        if axis and signal and np.isfinite(table.log[column]).any():
            table.give(f"{axis}.{signal}", column, why)


def _by_number(table: _Table) -> None:
    """Give numbered families (``position[0]``, ``position[1]``...) to the axes in their order."""
    families: dict[str, list[tuple[int, str]]] = {}
    for column in table.free():
        found = family(column)
        if found:
            families.setdefault(found[0], []).append((found[1], column))
    for stem, members in sorted(families.items(), key=lambda item: is_set_value(item[0])):
        _, signal, why = read_label(stem.replace("#", " "), table.log.units.get(members[0][1]))
        if signal is None or len(members) < 2:
            continue
        for axis, (number, column) in zip(table.axes, sorted(members), strict=False):
            table.give(f"{axis}.{signal}", column, f"{why}, number {number} taken as {axis}: order guessed")


def _by_behaviour(table: _Table) -> None:
    """Give nameless columns by what their numbers do."""
    free = [c for c in table.free() if has_more_values(table.log[c], 1) and not is_counter(table.log[c])]
    moving = [c for c in free if moves(table.log[c])]
    alike: set[str] = set()
    for axis, columns in zip(table.axes, _following(table.log, moving), strict=False):
        alike.update(columns)
        command, position, why = _command_first(table.log, columns)
        apart = distance(table.log[position], table.log[command])
        said = f"the two follow each other within {apart:.2%}"
        table.give(f"{axis}.qr", command, f"{said}, and this {why}; axis by order: guessed")
        table.give(f"{axis}.q", position, f"{said}; axis by order: guessed")
    held = [(a, q) for a in table.axes if (q := table.values(f"{a}.q")) is not None]
    for column in (c for c in free if c not in table.used | alike):
        shares = {axis: push(q, table.log[column], table.step or 1.0)[0] for axis, q in held}
        best = max(shares, key=lambda a: shares[a], default=None)
        if best is not None and shares[best] > table.explained:
            said = f"inertia and friction of {best} explain {shares[best]:.0%} of it"
            table.give(f"{best}.u", column, said)
    _by_place(table)


def _by_place(table: _Table) -> None:
    """Give an effort that stands where the other axes have theirs: so many columns behind the position."""
    place = {column: i for i, column in enumerate(table.log.channels)}
    held = {g.channel: place[g.column] for g in table.taken.values() if g.column in place}
    steps = {held[f"{a}.u"] - held[f"{a}.q"] for a in table.axes if {f"{a}.u", f"{a}.q"} <= set(held)}
    if len(steps) != 1:
        return
    step = steps.pop()
    for axis in table.axes:
        at = held.get(f"{axis}.q", -1) + step
        column = next((c for c, i in place.items() if i == at and c not in table.used), None)
        if f"{axis}.u" not in held and f"{axis}.q" in held and column is not None:
            table.give(f"{axis}.u", column, "it stands where the other axes have theirs: guessed")


def _following(log: Log, columns: Sequence[str], follows: float = 0.02) -> Iterable[list[str]]:
    """Yield groups of columns that differ, at their own lag, by less than a share of their motion: of one axis."""
    free = list(columns)
    while free:
        one, *others = free
        a = log[one]
        away = {x: distance(a, log[x]) * np.sqrt(1.0 - min(lead(a, log[x])[1], 1.0)) for x in others}
        group = [one, *(x for x, d in away.items() if d <= follows)]
        free = [c for c in free if c not in group]
        if len(group) > 1:
            yield group


def _command_first(log: Log, columns: Sequence[str], explained: float = 0.5) -> tuple[str, str, str]:
    """Return command and position of an axis, and why: the command leads, or is the smoothest of them."""
    ahead = {}
    for one in columns:
        pairs = [lead(log[one], log[other]) for other in columns if other != one]
        ahead[one] = min((samples for samples, share in pairs if share > explained), default=0.0)
    command = max(columns, key=lambda c: ahead[c])
    why = f"leads by {ahead[command]:.2g} samples"
    if ahead[command] <= 0.0:
        command, why = min(columns, key=lambda c: smoothness(log[c])), "is the smoother"
    return command, next(c for c in columns if c != command), why


def _swapped(table: _Table) -> None:
    """Say how well command and position agree."""
    for axis in table.axes:
        q, qr = table.taken.get(f"{axis}.q"), table.taken.get(f"{axis}.qr")
        if q and qr and q.column and qr.column and "follow" not in q.reason:
            apart = distance(table.log[q.column], table.log[qr.column])
            if apart < 0.5:
                table.amend(q, f"follows {axis}.qr within {apart:.2%}")


def _units(table: _Table) -> list[str]:
    """Write the unit of positions that state none, and say what cannot be known."""
    questions = []
    for axis, (_, rotary) in table.axes.items():
        unit = ""
        for signal in ("q", "qr"):
            guess = table.taken.get(f"{axis}.{signal}")
            if guess is None or guess.column is None:
                continue
            stated = table.log.units.get(guess.column)
            if stated in COUNTS:
                questions.append(
                    f"{guess.channel}: is in {stated}; give columns a `factor`: metres or radians of one"
                )
            elif stated is None:
                if not unit:
                    far = float(np.nanmax(np.abs(table.log[guess.column])))
                    unit = ("deg" if far > 13.0 else "rad") if rotary else ("mm" if far > 5.0 else "m")
                written = "" if unit in ("m", "rad") else unit
                table.amend(guess, f"no unit stated, {unit} by its size", unit=written)
        _unit_of_speed(table, axis)
    return questions


def _unit_of_speed(table: _Table, axis: str) -> None:
    """Write the unit of a speed that states none: that of its position by the time that fits their numbers."""
    q, v = table.taken.get(f"{axis}.q"), table.taken.get(f"{axis}.v")
    if q is None or v is None or not q.column or not v.column or table.log.units.get(v.column):
        return
    unit = q.unit or table.log.units.get(q.column) or ("rad" if table.axes[axis][1] else "m")
    if not table.step or unit in COUNTS or f"{unit}/s" not in SI_FACTOR:
        return
    moved, speed = np.gradient(table.log[q.column], table.step), table.log[v.column]
    both = np.isfinite(moved) & np.isfinite(speed)
    slope = float(speed[both] @ moved[both]) / max(float(moved[both] @ moved[both]), 1e-300)
    times = {f"{unit}/s": 1.0, f"{unit}/min": 60.0, "rpm": 60.0 * SI_FACTOR[unit] / SI_FACTOR["rev"]}
    known = {name: factor for name, factor in times.items() if name in SI_FACTOR}
    best = min(known, key=lambda name: abs(np.log(max(abs(slope), 1e-12) / known[name])))
    table.amend(v, f"no unit stated, {best} by its size", unit="" if SI_FACTOR[best] == 1.0 else best)


def _efforts(table: _Table) -> list[str]:
    """Turn efforts that come with the wrong sign, and ask for the size of electrical ones."""
    questions = []
    for axis in table.axes:
        guess, q = table.taken.get(f"{axis}.u"), table.values(f"{axis}.q")
        if guess is None or guess.column is None:
            continue
        column = guess.column
        if q is not None and table.step > 0.0:
            share, negative = push(q, table.log[column], table.step)
            if negative and share > table.explained:
                table.amend(guess, "it falls with acceleration and speed: sign turned", factor=-1.0)
        if is_set_value(column):
            questions.append(
                f"{axis}.u: {column} is a set value of the controller or computed by it; "
                "name the measured effort if there is one"
            )
        unit = table.log.units.get(column)
        if unit in ELECTRICAL or unit is None:
            what = f"is in {unit}" if unit else "states no unit"
            questions.append(
                f"{axis}.u: {what}; give columns.{axis}.u a `factor` to N or N·m (torque constant x gear) if known"
            )
    return questions


def _missing(table: _Table) -> list[str]:
    """Say which signals of the axes were not found, and of which axes nothing was."""
    means = {
        "q": "no column found for the position; add it under `columns`",
        "u": "no column found for the effort; without it nothing of the axis is identified",
        "qr": "no command found; the plant is still identified, the closed loop is not",
    }
    there = {*table.taken, *table.named}
    unknown = [axis for axis in table.axes if not any(f"{axis}.{signal}" in there for signal in means)]
    said = []
    for signal, words in means.items():
        channels = [f"{axis}.{signal}" for axis in table.axes if axis not in unknown]
        lacking = [channel for channel in channels if channel not in there]
        said += [f"{', '.join(lacking)}: {words}"] if lacking else []
    return said + ([f"{', '.join(unknown)}: no column found; add them under `columns`"] if unknown else [])
