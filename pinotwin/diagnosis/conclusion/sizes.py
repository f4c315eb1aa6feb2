"""The size of a cause in words: from what to what, few numbers where it has many."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.diagnosis.payload import UNKNOWN, centre_of
from pinotwin.diagnosis.phrases import effect_words
from pinotwin.diagnosis.result import Found, Size
from pinotwin.dynamics.parameters import BODY_NAMES, BODY_UNITS
from pinotwin.effects.position import PositionTable
from pinotwin.system.phrases import CHANGED, NUMBERS
from pinotwin.units import shown

FEW = 4  # So many numbers are shown one by one


def told(sizes: Sequence[Size]) -> list[Size]:
    """Return what a person reads: amplitudes for sine and cosine (first-order interval), ends of tables, factors."""
    sizes = [_factor(s) if s.name == "effort_scale.share" else s for s in sizes]
    waves = [s for s in sizes if re.fullmatch(r".*\.[ab](\d*|_mod)", s.name)]
    if waves and len(waves) % 2 == 0:
        pairs = zip(waves[::2], waves[1::2], strict=True)
        return [_amplitude(a, b) for a, b in pairs] + [s for s in sizes if s not in waves]
    if len(sizes) > FEW and len({s.unit for s in sizes}) == 1:
        lowest, *_, highest = sorted(sizes, key=lambda s: s.after)
        family, ends = lowest.name.partition(".")[0], {"highest": highest, "lowest": lowest}
        return [replace(s, name=f"{family}.{word} of {len(sizes)} points") for word, s in ends.items()]
    return list(sizes)


def _factor(share: Size) -> Size:
    """Return the factor on an effort from its error; below zero the effort has the other sign."""
    low, high, before, after = (1.0 + x for x in (*share.interval, share.before, share.after))
    return replace(share, name="effort_scale.factor", before=before, after=after, interval=(low, high))


def _amplitude(a: Size, b: Size) -> Size:
    family, _, part = a.name.rpartition(".")
    order = part[1:].lstrip("_")
    word = {"": "amplitude", "1": "amplitude", "mod": "amplitude of the modulation"}.get(
        order, f"amplitude of order {order}"
    )
    after, before = math.hypot(a.after, b.after), math.hypot(a.before, b.before)
    halves = [(s.interval[1] - s.interval[0]) / 2.0 for s in (a, b)]
    half = math.hypot(a.after * halves[0], b.after * halves[1]) / max(after, 1e-300)
    return Size(f"{family}.{word}", before, after, a.unit, (max(after - half, 0.0), after + half))


def name_words(size: Size) -> str:
    """Return what a number is, in words."""
    family, _, last = size.name.partition(".")
    text = (last or family).replace("_", " ")  # a place in it in the unit in which people read it
    place = re.sub(r"(?<=at )(-?[\d.e-]+) (m|rad)$", lambda x: _along(float(x[1]), x[2]), text)
    return NUMBERS.get(size.name) or place


def size_text(size: Size, digits: int = 4) -> str:
    """Return a size in words: from what to what where the model held a number, or an effort had no limit."""
    if np.isnan(size.before) or size.before == 0.0:
        return f"{name_words(size)} {now_text(size, digits)}"
    one = in_shown_unit(size)
    before = _number(one.before, digits) if np.isfinite(one.before) else "none"
    return f"{name_words(size)} {before} -> {now_text(size, digits)}"


def in_shown_unit(size: Size) -> Size:
    """Return a size in the unit in which people read it, all its numbers in the same."""
    low, high = size.interval
    factor, unit = shown(size.unit, max(abs(x) if np.isfinite(x) else 0.0 for x in (size.before, size.after)))
    before, after = factor * size.before, factor * size.after
    return replace(size, before=before, after=after, unit=unit, interval=(factor * low, factor * high))


def now_text(size: Size, digits: int = 4) -> str:
    """Return what these logs give, with its unit."""
    one = in_shown_unit(size)
    return f"{_number(one.after, digits)} {one.unit}".strip()


def before_text(size: Size) -> str:
    """Return what the model held, with its unit; a dash for what is no number of the model."""
    if np.isnan(size.before):
        return "–"
    one = in_shown_unit(size)
    none = np.isinf(size.before) or size.before == 0.0
    return "none" if none else f"{_number(one.before, 4)} {one.unit}".strip()


def _number(x: float, digits: int) -> str:
    return f"{float(f'{x:.{digits}g}'):g}"


def interval_text(size: Size, digits: int = 4) -> str:
    """Return the 90 % interval in the unit of :func:`now_text`; a dash for none."""
    low, high = in_shown_unit(size).interval
    if np.isnan(low) or np.isnan(high):
        return "–"
    digits = next((k for k in range(digits, 7) if f"{low:.{k}g}" != f"{high:.{k}g}"), digits)
    return f"{low:.{digits}g} to {high:.{digits}g}" if np.isfinite(high) else f"{low:.{digits}g} and more"


def times_text(size: Size) -> str:
    """Return how far a number moved, as a factor or in per cent; empty where there was none before."""
    if not np.isfinite(size.before) or size.before == 0.0 or not np.isfinite(size.after):
        return ""
    ratio = size.after / size.before
    if ratio >= 2.0:
        return f"× {ratio:.2g}"
    per_cent = 100.0 * (ratio - 1.0)
    return f"{per_cent:{'+.0f' if abs(per_cent) >= 10.0 else '+.2g'}} %" if ratio > 0.0 else ""


def _pitch(found: Found) -> str:
    """Return the pitch of a cause that returns along the travel."""
    shapes = () if found.listed is None else found.listed.shapes()
    unit = next((s.unit for s in shapes if s.name == "period"), "")
    return f", pitch {_along(found.shape['period'], unit)}" if unit and "period" in found.shape else ""


def _place(found: Found) -> str:
    """Return where along the travel a table is largest."""
    place = place_of(found)
    turns = isinstance(found.listed, PositionTable) and found.listed.rotary
    return "" if place is None else f" at {_along(place, 'rad' if turns else 'm')}"


def place_of(found: Found) -> float | None:
    """Return where along the travel a table is largest [m or rad]; None for another cause."""
    table = found.listed
    if not isinstance(table, PositionTable) or len(table.knots) != len(found.size):
        return None
    return float(table.knots[max(range(len(found.size)), key=lambda k: abs(found.size[k].after))])


def _along(x: float, unit: str) -> str:
    factor, read = shown(unit, x)
    return f"{factor * x:.4g} {read}"


def change_text(found: Found) -> str:
    """Return the change of a cause for a sentence: from what to what, its interval, its pitch or place."""
    sizes = told(found.size)
    if not sizes:
        return ""
    table = "points" in sizes[0].name
    first = max(sizes, key=lambda s: abs(s.after)) if table else sizes[0]
    span, times = interval_text(first, 3), times_text(first)
    about = [f"90 %: {span}"] * (span != "–") + [times] * (first.unit != "-" and bool(times))
    rest = (f" ({', '.join(about)})" if about else "") + (_place(found) if table else _pitch(found))
    was, now = _number(in_shown_unit(first).before, 3), now_text(first, 3)
    if not np.isfinite(first.before) or first.before == 0.0:
        name = "" if name_words(first) == effect_words(found.effect) else f"{name_words(first)} "
        return f": {name}{now}{rest}"
    form = CHANGED["times" if first.unit == "-" and first.before == 1.0 else "from"]
    name = f", {name_words(first)}" if len(sizes) > 1 else ""
    return f"{name} {form.format(before=was, after=now)}{rest}"


def sized(name: str, before: float, after: float, unit: str, error: float) -> Size:
    """Return a size [unit] with its 90 % interval, from its standard error."""
    x, half = float(after), 1.645 * float(error)
    return Size(name, before, x, unit, (x - half, x + half))


def body_sizes(pi: Floats, covariance: Floats) -> list[Size]:
    """Return mass and centre of mass of a body, from its ten parameters; what turns it where these do not tell."""
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    centre = zip("xyz", *centre_of(pi, covariance), strict=True)
    mass = sized("payload.mass", 0.0, pi[0], "kg", errors[0])
    known = [sized(f"payload.c{k}", np.nan, x, "m", error) for k, x, error in centre if error < UNKNOWN]
    turns = [k for k in range(1, 10) if abs(pi[k]) > 4.0 * errors[k] and not known]
    turned = [sized(f"payload.{BODY_NAMES[k]}", 0.0, pi[k], BODY_UNITS[k], errors[k]) for k in turns]
    return [*turned, mass, *known]


def largest(name: str, course: Floats, numbers: Floats, errors: Floats, unit: str) -> Size:
    """Return the largest of a course (n,) [unit], as sure as the surest of its numbers, by their errors, (p,) each."""
    most = float(course[np.argmax(np.abs(course))])
    half = 1.645 * abs(most) * float(np.min(errors / np.maximum(np.abs(numbers), 1e-300)))
    return Size(name, 0.0, most, unit, (most - half, most + half))


def undetermined(sizes: Sequence[Size]) -> list[str]:
    """Return what of a payload's mass and centre these logs do not tell."""
    known = {s.name for s in sizes}
    mass = next(s for s in sizes if s.name == "payload.mass")
    out = ["mass"] if mass.interval[0] < 0.0 < mass.interval[1] else []
    places = [x for x in "xyz" if f"payload.c{x}" not in known]
    return [*out, *([f"centre of mass along {', '.join(places)}"] if places else [])]
