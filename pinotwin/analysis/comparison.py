"""Twins of one machine side by side: which parameters moved, and how each predicts the same log.

The weighted sum of squares of a constant parameter about its mean is chi-squared with one degree of freedom fewer than
twins (Cochran 1937); the accepted changes hold a false discovery rate (Benjamini & Hochberg 1995,
10.1111/j.2517-6161.1995.tb02031.x). What a model leaves out moves its parameters from one trajectory to the next, too,
so standard errors are widened by the worst twin's ratio of held-out to fitted error. Knots of a table lean on their
neighbours: what it does as a whole is its change of effort along a log.
"""

from __future__ import annotations

from abc import abstractmethod
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from pinotwin.arrays import Floats, plain
from pinotwin.effects import effect_name, known
from pinotwin.errors import InputError
from pinotwin.logs.files import LogLike, as_log
from pinotwin.loop.servo import FOLLOWING, LOST
from pinotwin.notebook import Drawn, Shown
from pinotwin.simulation import compare as score
from pinotwin.simulation import simulate
from pinotwin.system.writing import as_path, whole_folder, write_json
from pinotwin.twin import Twin
from pinotwin.twin.twin import TwinLike, as_twin
from pinotwin.units import in_log_unit, rounded

Z90 = 1.6449  # Half width of a 90 % interval in standard errors


@dataclass(frozen=True)
class Row:
    """One parameter in every twin."""

    name: str  # full name
    effect: str  # key of its effect
    unit: str  # SI unit
    values: tuple[float, ...]  # in the order of the twins, NaN where a twin does not determine it
    errors: tuple[float, ...]  # standard errors, likewise, widened by what the model leaves out
    p: float  # probability of so much scatter by chance; NaN where fewer than two determine it, or of a table
    moved: bool = False  # whether it moved, all parameters considered

    @property
    def change(self) -> float:
        """Last value minus first [unit]."""
        return self.values[-1] - self.values[0]

    @property
    def change_error(self) -> float:
        """Standard error of the change [unit]."""
        return float(np.hypot(self.errors[0], self.errors[-1]))

    @property
    def words(self) -> str:
        """From what to what it moved, with 90 % intervals."""
        before, after = self.values[0], self.values[-1]
        share = f" ({after / before - 1.0:+.0%})" if before else ""
        first, *_, last = map(with_interval, self.values, self.errors)
        return f"{self.name} {first} → {last} {self.unit}".strip() + share

    def as_dict(self, labels: Sequence[str]) -> dict[str, Any]:
        """Return the row for JSON."""
        half = Z90 * self.change_error
        row = {
            "name": self.name,
            "effect": self.effect,
            "unit": self.unit,
            "values": {
                label: {"value": x, "interval90": [x - Z90 * e, x + Z90 * e]} if np.isfinite(x) else None
                for label, x, e in zip(labels, self.values, self.errors, strict=True)
            },
            "change": self.change,
            "change_interval90": [self.change - half, self.change + half] if np.isfinite(half) else None,
            "p": self.p,
            "moved": self.moved,
        }
        return plain(row)


def with_interval(x: float, error: float) -> str:
    """Return a number, any unit, and half its 90 % interval, by its standard error."""
    return " ± ".join(filter(None, rounded(x, Z90 * error)))


class Compared(Drawn):
    """Results side by side, with a page."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return the content of compare.json."""

    def save(self, folder: str | Path) -> Path:
        """Write compare.json and compare.html into a folder and return it."""
        with whole_folder(target := as_path(folder, "folder")) as part:
            write_json(part / "compare.json", self.to_dict())
            self.report(part / "compare.html")
        return target


@dataclass(frozen=True, repr=False)
class Comparison(Compared):
    """Twins of one machine side by side."""

    machine: str  # name of the machine
    labels: tuple[str, ...]  # name of each twin
    widening: Mapping[str, float]  # axis -> factor by which the standard errors were widened
    rows: tuple[Row, ...]  # every parameter that two twins have, in the order of the first
    only: Mapping[str, tuple[str, ...]]  # label -> parameters that no other twin has
    controller: tuple[Row, ...] = ()  # what the drives are set to, see Servo.service
    # axis -> signal -> label -> ``rms``, ``nrmse``, on the same log; empty without one
    errors: Mapping[str, Mapping[str, Mapping[str, Mapping[str, float]]]] = field(default_factory=dict)
    # effect key -> its axis, RMS change of its effort along the log, last twin against first, and unit
    shifts: Mapping[str, tuple[str, float, str]] = field(default_factory=dict)
    log: str = ""  # source of that log
    notes: tuple[str, ...] = ()  # what deserves attention
    # label -> the logs that the twin was identified from
    data: Mapping[str, Sequence[Mapping[str, Any]]] = field(default_factory=dict)
    false_discoveries: float = 0.05  # share of the parameters said to have moved that may be chance

    @property
    def moved(self) -> tuple[Row, ...]:
        """Parameters that moved, most significant first."""
        return tuple(sorted((row for row in self.rows if row.moved), key=lambda row: row.p))

    @property
    def retuned(self) -> tuple[Row, ...]:
        """Numbers of the controllers that moved."""
        return tuple(row for row in self.controller if row.moved)

    @property
    def causes(self) -> tuple[tuple[str, str, int], ...]:
        """Effects of which parameters moved: key, title, and how many; most significant first."""
        count = Counter(row.effect for row in self.moved)
        return tuple((key, effect_title(key), n) for key, n in count.items())

    @property
    def sentence(self) -> str:
        """The result in one sentence."""
        asked = sum(np.isfinite(row.p) for row in self.rows)
        drives = "; ".join(row.words for row in self.retuned)
        told = f" Controller: {drives}." if drives else ""
        if not self.moved:
            return f"None of {asked} parameters moved beyond chance.{told}"
        named = "; ".join(row.words for row in self.moved[:3])
        more = f"; and {len(self.moved) - 3} more" if len(self.moved) > 3 else ""
        return f"{len(self.moved)} of {asked} parameters moved: {named}{more}.{told}"

    def _shown(self) -> Shown:
        """Return what moved, for a notebook and for ``repr``."""
        rows = [(r.name, r.unit, *(f"{x:.4g}" for x in r.values)) for r in self.moved]
        heads = ("moved", "unit", *self.labels)
        return (f"Comparison of {self.machine}", heads if rows else (), rows, self.sentence)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of compare.json."""
        return {
            "kind": "twins",
            "machine": self.machine,
            "labels": list(self.labels),
            "sentence": self.sentence,
            "false_discovery_rate": self.false_discoveries,
            "widening": self.widening,
            "moved": [row.name for row in self.moved],
            "causes": [{"effect": k, "title": title, "parameters": n} for k, title, n in self.causes],
            "parameters": [row.as_dict(self.labels) for row in self.rows],
            "controller": [row.as_dict(self.labels) for row in self.controller],
            "only_in": {label: list(names) for label, names in self.only.items()},
            "log": self.log or None,
            "errors": self.errors,
            "effort_change": {
                key: {"axis": axis, "rms": rms, "unit": unit}
                for key, (axis, rms, unit) in self.shifts.items()
            },
            "notes": list(self.notes),
            "identified_from": {label: [dict(row) for row in rows] for label, rows in self.data.items()},
        }


def compare(*twins: TwinLike, labels: Sequence[str] | None = None, log: LogLike | None = None) -> Comparison:
    """Put twins side by side, see :func:`pinotwin.compare`."""
    given = [as_twin(one) for one in twins]
    names = tuple(labels) if labels is not None else tuple(str(k + 1) for k in range(len(given)))
    if len(given) < 2:
        raise InputError("compare: give two twins or more")
    machines = {twin.machine.name for twin in given}
    if len(machines) > 1:
        raise InputError(f"compare: twins of different machines ({', '.join(sorted(machines))})")
    factors = {axis: max(_overfit(twin, axis) for twin in given) for axis in given[0].machine.names}
    widening = factors | {"rigid_body": max(factors.values())}
    rows, only = _rows(given, names, widening)
    found = Comparison(
        machines.pop(),
        names,
        widening,
        _discoveries(rows),
        only,
        _discoveries(tuple(_drives(given))),
        data={name: tuple(twin.data) for name, twin in zip(names, given, strict=True)},
    )
    if log is None:
        return found
    held = as_log(log)
    errors, notes = _errors(given, names, held)
    shifts = _shifts(given[0], given[-1], held)
    return replace(found, errors=errors, shifts=shifts, log=held.source, notes=notes)


def effect_title(key: str) -> str:
    """Return what an effect is called in a heading, from its key ``Y.ripple#2``."""
    name = effect_name(key)
    kind = known().get(name)
    return name if kind is None else kind.title


def _rows(
    twins: Sequence[Twin], labels: Sequence[str], widening: Mapping[str, float], knots: int = 12
) -> tuple[tuple[Row, ...], dict[str, tuple[str, ...]]]:
    """Return the parameters that two twins have, with widened errors, and those that only one has.

    An effect of more than so many ``knots`` is a table.
    """
    tables = [{row.name: row for row in twin.parameters} for twin in twins]
    held = Counter(name for table in tables for name in table)
    size = Counter(next(t[name] for t in tables if name in t).effect for name, n in held.items() if n > 1)
    rows = []
    for name in (name for name, n in held.items() if n > 1):
        found = [table.get(name) for table in tables]
        first = next(row for row in found if row is not None)
        alike = (None if row is None or row.unit != first.unit else row for row in found)
        known = [row if row is not None and row.determined and row.error > 0.0 else None for row in alike]
        wider = widening.get(first.effect.split(".")[0], widening["rigid_body"])
        values = tuple(row.value if row is not None else np.nan for row in known)
        errors = tuple(wider * row.error if row is not None else np.nan for row in known)
        asked = size[first.effect] <= knots or first.effect.startswith("rigid_body")
        p = _chance(np.array(values), np.array(errors)) if asked else float("nan")
        rows.append(Row(name, first.effect, first.unit, values, errors, p))
    only = {
        label: own
        for label, table in zip(labels, tables, strict=True)
        if (own := tuple(name for name in table if held[name] == 1))
    }
    return tuple(rows), only


def _drives(twins: Sequence[Twin], unknown: tuple[float, ...] = (np.nan,) * 3) -> Iterator[Row]:
    """Yield what the drives of every axis are set to; Kv is tested by its inverse, which has no pole."""
    for name, axis in twins[0].machine.axes.items():
        servos = [twin.servos.get(name) for twin in twins]
        told = [{} if servo is None else servo.service() for servo in servos]
        sizes = [twin.quality.get("sizes", {}).get(name, {}) for twin in twins]
        gain, mass = ("N·m·s/rad", "N·m·s²/rad") if axis.rotary else ("N·s/m", "N·s²/m")
        for what, unit in {
            "Kv": "1/s",
            "kv": gain,
            "reset time": "s",
            "ffv": "",
            "ffa": mass,
            LOST: "rad" if axis.rotary else "m",
        }.items():
            (unit, _), *_ = units = [in_log_unit(unit, axis.rotary, row) for row in sizes]
            size = np.array([x if one == unit else np.nan for one, x in units])
            x = np.array([row.get(what, unknown)[0] for row in told]) / size
            asked = np.array([row.get(FOLLOWING if what == "Kv" else what, unknown) for row in told])
            asked = asked / size[:, None]
            errors = (asked[:, 2] - asked[:, 1]) / (2.0 * Z90)
            p = _chance(asked[:, 0], np.where(errors > 0.0, errors, np.nan))
            errors = errors * x**2 if what == "Kv" else errors
            if not np.isnan(x).all():
                yield Row(f"{name}.{what}", f"{name}.servo", unit, tuple(x), tuple(errors), p)


def _overfit(twin: Twin, axis: str) -> float:
    """Return the held-out error of an axis over its fitted one, 1 where that is not known."""
    row = twin.quality.get("axes", {}).get(axis, {})
    fitted, held = row.get("fit"), row.get("held_out", {}).get("nrmse")
    return max(float(held / fitted), 1.0) if fitted and held else 1.0


def _chance(values: Floats, errors: Floats) -> float:
    """Return the probability of so much scatter of a constant, NaN for fewer than two values."""
    known = np.isfinite(values) & np.isfinite(errors)
    if known.sum() < 2:
        return float("nan")
    x, weight = values[known], 1.0 / errors[known] ** 2
    mean = np.sum(weight * x) / np.sum(weight)
    return float(scipy.stats.chi2.sf(np.sum(weight * (x - mean) ** 2), known.sum() - 1))


def _discoveries(rows: Sequence[Row]) -> tuple[Row, ...]:
    """Mark the rows that moved, at a rate of false discoveries."""
    asked = [k for k, row in enumerate(rows) if np.isfinite(row.p)]
    rate = scipy.stats.false_discovery_control([rows[k].p for k in asked]) if asked else []
    moved = {k for k, value in zip(asked, rate, strict=True) if value <= Comparison.false_discoveries}
    return tuple(replace(row, moved=k in moved) for k, row in enumerate(rows))


def _errors(twins: Sequence[Twin], labels: Sequence[str], log: Any) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return each twin's errors: effort from the measured motion, e and u from the command alone."""
    out: dict[str, Any] = {}
    notes = []
    for twin, label in zip(twins, labels, strict=True):
        motion = twin.motion(log)
        effort = twin.effort(motion)
        for name, axis in twin.machine.axes.items():
            rows = motion.use[:, axis.index] & np.isfinite(motion.u[:, axis.index])
            if rows.any():
                u = motion.u[rows, axis.index]
                rms = float(np.sqrt(np.mean((u - effort[rows, axis.index]) ** 2)))
                own: Mapping[str, Any] = {} if twin.misfit is None else twin.misfit.summary.get(name, {})
                row = {"rms": rms, "nrmse": rms / float(np.sqrt(np.mean(u**2))), "misfit": own.get("moving")}
                out.setdefault(name, {}).setdefault("effort", {})[label] = row
        if not twin.loops:
            continue
        try:
            found = score(twin.machine, log, simulate(twin, log))
        except InputError as error:
            notes.append(f"{label}: not simulated: {error}")
            continue
        for name, signals in found.items():
            for signal, errors in signals.items():
                out.setdefault(name, {}).setdefault(f"simulated {signal}", {})[label] = dict(errors)
    return out, tuple(notes)


def _shifts(first: Twin, last: Twin, log: Any) -> dict[str, tuple[str, float, str]]:
    """Return by how much each effect's effort differs between two twins along one motion, RMS."""
    motion = first.motion(log)
    before, after = first.parts(motion), last.parts(motion)
    out = {}
    for key in dict.fromkeys([*before, *after]):
        zero = np.zeros(motion.q.shape)
        difference = after.get(key, zero) - before.get(key, zero)
        for name, axis in first.machine.axes.items():
            rms = float(np.sqrt(np.mean(difference[:, axis.index] ** 2)))
            if rms > 0.0:
                label = key if not key.startswith("rigid_body") else f"rigid_body on {name}"
                out[label] = (name, rms, "N·m" if axis.rotary else "N")
    return dict(sorted(out.items(), key=lambda item: -item[1][1]))
