"""The words of a diagnosis: names of effects, regions, and the direction of a change."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from pinotwin.diagnosis.result import Found, Region, Size
from pinotwin.effects import known
from pinotwin.system.phrases import CAUSES, OTHERWISE, REGIONS, joined
from pinotwin.units import shown


def effect_words(name: str) -> str:
    """Return an effect's title as it stands inside a sentence."""
    title = known()[name].title if name in known() else CAUSES.get(name, (name.replace("_", " "),))[0]
    return title[:1].lower() + title[1:]


def on_axis(name: str, axis: str | None) -> str:
    """Return an effect with where it acts, e.g. ``quadratic drag on axis Y``."""
    return effect_words(name) if axis is None else f"{effect_words(name)} on axis {axis}"


def rivals(found: Found, named: Sequence[Found]) -> dict[str, tuple[float, str]]:
    """Return what else a cause could be -> probability [1] and reason: forms of an effect together, none ``named``."""
    out: dict[str, tuple[float, str]] = {}
    for a in found.alternatives:
        what = OTHERWISE.get(a["effect"]) or on_axis(a["effect"], a.get("axis"))
        if any((x.effect, x.axis) == (a["effect"], a.get("axis")) for x in named):
            continue
        p, why = out.get(what, (0.0, str(a.get("why", ""))))
        out[what] = p + float(a.get("probability", 0.0)), why
    return out


def moved(sizes: Sequence[Size]) -> str:
    """Return which way the numbers of a cause went: rose, fell, appeared, or changed where they disagree."""
    ways = {_way(abs(s.before), abs(s.after)) for s in sizes}
    return ways.pop() if len(ways) == 1 else "changed"


def _way(before: float, after: float) -> str:
    if before == 0.0 or math.isinf(before):
        return "appeared"
    return "rose" if after > before else "fell" if after < before else "changed"


def seen_words(detectable: Sequence[Mapping[str, Any]]) -> str:
    """Return what friction these logs would have shown, in a sentence; empty where nothing is known of that."""
    seen = [f"{x['size']:.0%} on {x['axis']}" for x in detectable if x["effect"] == "friction_scale"]
    return f"A friction change of {joined(seen)} would have been visible" if seen else ""


def recording_words(recording: Sequence[Mapping[str, Any]]) -> str:
    """Return the faults of a recording in words, with their numbers."""
    scale = {"command_late": (1e3, " by {:.3g} ms"), "clock_scale": (1.0, " by a factor of {:.3g}")}
    out = []
    for x in recording:
        factor, text = scale.get(x["fault"], (1.0, ""))
        number = "" if x["size"] is None else text.format(factor * x["size"])
        out.append(on_axis(x["fault"], x["axis"]) + number)
    return joined(list(dict.fromkeys(out)))


def label_words(label: str) -> str:
    """Return a label of a confusable group, ``Y.coulomb`` -> ``dry friction on axis Y``."""
    if label == "base model":
        return "the reference model"
    axis, dot, name = label.partition(".")
    return on_axis(name, axis) if dot else effect_words(label)


def explanation(name: str) -> str:
    """Return what an effect is on the machine; empty for one that is not listed."""
    return known()[name].words if name in known() else CAUSES.get(name, ("", ""))[1]


def remedy(name: str) -> str:
    """Return what a person can do about a cause; empty for one that is not listed."""
    return known()[name].remedy if name in known() else CAUSES.get(name, ("", "", ""))[2]


def plain_sentence(text: str) -> str:
    """Return a sentence of a diagnosis with the titles of effects in place of their names."""
    names = "|".join(name for name in known() if "_" in name)
    return re.sub(rf"\b({names})\b", lambda found: effect_words(found[0]), text)


def region_words(region: Region) -> str:
    """Return where a region lies in a sentence's words, in units of the shop floor."""
    low, high, unit = shop_range(region)
    span, kind = f"{low} to {high} {unit}", region.kind
    if kind == "velocity" and region.range[0] == -region.range[1]:
        kind = "reversal"
    elif kind == "velocity":
        kind = "backward" if region.range[1] <= 0 else "forward" if region.range[0] >= 0 else kind
    elif kind == "frequency" and region.range[0] == 0.0:
        kind = "slow"
    return REGIONS.get(kind, f"{kind} {{span}}").format(span=span, end=f"{high} {unit}", other=region.other)


def shop_range(region: Region) -> tuple[str, str, str]:
    """Return lowest and highest value and the unit: millimetres and degrees instead of SI."""
    factor, unit = shown(region.unit, max(abs(x) for x in region.range))
    low, high = (factor * x for x in region.range)
    places = max(0, 2 - math.floor(math.log10(max(abs(low), abs(high), 1e-9))))
    first, last = (f"{round(x, places) + 0.0:.3g}" for x in (low, high))
    return first, last, unit


def follows(name: str, what: str, course: Mapping[str, Any]) -> str:
    """Return what a cause follows, in words; empty for what acts always. ``course``: that of its effect."""
    long = f"{course.get('time_constant', 0.0):.2g} s"
    courses = {
        "after": f"it acts for {long} after every start, like a brake that releases late",
        "since": "it begins within the run",
        "growing": "it grows with time",
    }
    words = {
        "told": "the controllers know of it: their gains follow",
        "read": "the controller did not ask for it: the effort may be misread",
        "encoder_period": "it repeats along the stroke",
        "encoder_along": "it goes with the place along the stroke",
        "cross_friction": f"it is dry friction that changes with the position of {what}",
        **dict.fromkeys(("motor_coulomb", "motor_viscous"), "it is friction of the motor, not of one axis"),
        "cut": "it comes at the same instants of every run: a process force",
        "push": "it comes at other instants in every run",
        "snag": "it drags at one place on some passes only",
        "tooth": "it comes at one place, whatever the direction",
    }
    return words.get(what) or courses.get(course.get("kind", "")) or words.get(name, "")


def described(what: str) -> str:
    """Return the description of what no cause explains."""
    kind = "dry friction" if what.startswith("dry ") else "an effort"
    what = what.removeprefix("dry ")
    words = {"time": "time, otherwise in every run", "program": "the instants of the command"}
    return f"follows {kind} that changes with {words.get(what, f'the {what}').replace('place', 'position')}"
