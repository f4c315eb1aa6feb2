"""How answers of the diagnosis are counted: rows of the scripts beside the recordings, and what each row is worth."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from benchmarks.evidence.answers import Row, effects
from pinotwin.bench.statistics import calibration

OUTSIDE = ("hum", "speed_ripple")
"""Kinds of the other simulator that nobody's catalogue holds."""
HEALTHY = ("none", "none_2", "none_3")
"""Days of a machine on which nothing has changed."""
SERVICE = ("preload_lost", "lost_motion", "kv", "ffv", "tooth", "cut")
"""Kinds of change that must be told each, not only on average."""
OPEN = ("not explained", "partly explained")
"""Grades of a signal that no verdict may call explained."""
RIGHT = {
    "effort_scale": ("hot_kt", "gear_side"),
    "external_force": ("push", "cut", "snag", "drift", "brake_late"),
}
"""Name that sends one to the motor or to the process -> the kinds of change of which it is right."""
SEEN = "… of those that an oracle sees while the axis moves"
UNKNOWN = "outside the catalogue recognised"
ACCUSED = "healthy machine accused of anything"
"""Rows of the own bench."""


@dataclass(frozen=True)
class Measured:
    """What was measured of a line.

    Attributes:
        value: the figure; NaN where nothing was asked.
        counts: what is behind it, such as ``37 of 40``.
        which: of several groups the one that it is of.
    """

    value: float
    counts: str = ""
    which: str = ""


def share(flags: Sequence[bool]) -> Measured:
    """Return how many flags are set, of how many."""
    hits, of = sum(map(bool, flags)), len(flags)
    return Measured(hits / of if of else math.nan, f"{hits} of {of}")


def each(key: str, among: Callable[[Row], bool] | None = None) -> Callable[[Sequence[Row]], Measured]:
    """Return what counts the rows of which something is so, among all or some."""
    return lambda rows: share([row[key] for row in rows if among is None or among(row)])


def worst(groups: Mapping[str, Sequence[bool]]) -> Measured:
    """Return the smallest share of several groups and whose it is."""
    shares = {name: share(flags) for name, flags in groups.items() if flags}
    if not shares:
        return share([])
    which = min(shares, key=lambda name: shares[name].value)
    return replace(shares[which], which=f"{which}, of {len(shares)}")


def inside(row: Row) -> bool:
    """Return whether a kind of the other simulator is one of the catalogue."""
    return row["kind"] not in OUTSIDE


def outside(row: Row) -> bool:
    """Return whether it is none."""
    return not inside(row)


def changed(row: Row) -> bool:
    """Return whether something of the machine has changed; a fault of the recording is none."""
    return bool(row["axis"])


def storied(row: Row) -> bool:
    """Return whether there is more to tell than a name and an axis."""
    return row.get("story") is not None


def accused(row: Row) -> bool:
    """Return whether a machine is said to be other than healthy."""
    return bool(row["named"]) or row["verdict"] != "none"


def accused_days(rows: Sequence[Row]) -> Measured:
    """Return on how many healthy days a machine is accused."""
    return share([accused(row) for row in rows if row["kind"] in HEALTHY])


def accused_again(rows: Sequence[Row]) -> Measured:
    """Return how many machines are accused on two of their healthy days or more."""
    days = [row for row in rows if row["kind"] in HEALTHY]
    times = Counter(row["machine"] for row in days if accused(row))
    return share([times[machine] > 1 for machine in {row["machine"] for row in days}])


def astray(rows: Sequence[Row]) -> Measured:
    """Return how many changes are put on the motor or on the process that are not theirs."""
    return share([any(_astray(row, *name) for name in row["named"]) for row in rows if changed(row)])


def _astray(row: Row, name: str, axis: str, probability: float) -> bool:
    del probability
    return name in RIGHT and not (row["kind"] in RIGHT[name] and axis in row["axis"])


def worst_service(rows: Sequence[Row]) -> Measured:
    """Return the share of first names that are right, of the kind of :data:`SERVICE` that is told worst."""
    return worst({kind: [row["first"] for row in rows if row["kind"] == kind] for kind in SERVICE})


def right(row: Row) -> bool:
    """Return whether the first name is right; where nothing has changed, any name is wrong."""
    return bool(row.get("axis_right", row.get("first", row.get("right"))))


def first_names(rows: Sequence[Row]) -> list[tuple[float, bool]]:
    """Return the stated probability of every first name, and whether the name is right."""
    return [(row["named"][0][2], right(row)) for row in rows if row["named"]]


def calibrated(rows: Sequence[Row]) -> Measured:
    """Return the expected calibration error of first names."""
    names = first_names(rows)
    found = calibration([p for p, _ in names], [x for _, x in names])
    return Measured(math.nan if found is None else found.error, f"{len(names)} answers")


def discriminated(rows: Sequence[Row]) -> Measured:
    """Return how often a right first name is surer than a wrong one, a tie one half."""
    names = first_names(rows)
    good, bad = ([p for p, x in names if x is wanted] for wanted in (True, False))
    pairs = [0.5 * ((p > q) + (p >= q)) for p in good for q in bad]
    value = statistics.fmean(pairs) if pairs else math.nan
    return Measured(value, f"{len(good)} right, {len(bad)} wrong")


def kept_promise(rows: Sequence[Row]) -> Measured:
    """Return the median difference of the promised and the delivered share of u and e of right first names.

    A promise that is the delivered share itself was measured on the same rows: it says nothing, and is not counted.
    """
    firsts = [effects(row)[:1] for row in rows if row["named"] and right(row)]
    told = [e["shrink"].get(signal) for found in firsts for e in found for signal in ("u", "e")]
    off = [abs(x["promised"] - x["share"]) for x in told if x and x["promised"] != x["share"]]
    return Measured(statistics.median(off) if off else math.nan, f"{len(off)} promises")


def worst_of_three(rows: Sequence[Row]) -> Measured:
    """Return how often a change is named, of the one that is named least."""
    groups: dict[str, list[bool]] = {}
    for row in rows:
        for kind, found in row["named"].items():
            name = kind if kind in ("friction_up", "lost_motion") else "number of the controller"
            groups.setdefault(name, []).append(found)
    return worst(groups)


def false_first(rows: Sequence[Row]) -> Measured:
    """Return how often the first name is none of the changes."""
    return share([row["wrong"] and not row["first"] for row in rows])


def contradicts(document: Row) -> bool:
    """Return whether the verdict of a diagnosis is not what its grades and its names say."""
    opened = any(g["grade"] in OPEN for row in document["gap"].values() for g in row.values())
    closed = document["verdict"] in ("none", "explained")
    named = document["verdict"] in ("explained", "partly_explained")
    return (opened and closed) or named != bool(document["effects"])


def own(name: str) -> Callable[[Sequence[Row]], Measured]:
    """Return what finds a share of the own bench."""

    def found(rows: Sequence[Row]) -> Measured:
        hits, of = next((row["share"]["hits"], row["share"]["of"]) for row in rows if row["name"] == name)
        return Measured(hits / of if of else math.nan, f"{hits} of {of}")

    return found


def seconds(case: str) -> Callable[[Sequence[Row]], Measured]:
    """Return what finds the time of a case [s]."""
    return lambda rows: Measured(next(row["seconds"] for row in rows if row["case"] == case))
