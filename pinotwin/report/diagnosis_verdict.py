"""The answer of a diagnosis in plain words: what changed, how far the residual falls, a card per axis."""

from __future__ import annotations

import math
from pathlib import Path

from pinotwin.diagnosis import phrases
from pinotwin.diagnosis.conclusion.sizes import change_text, told
from pinotwin.diagnosis.conclusion.where import along
from pinotwin.diagnosis.grade import OPEN, Grade, printed
from pinotwin.diagnosis.phrases import effect_words, moved, on_axis, plain_sentence, region_words
from pinotwin.diagnosis.result import Diagnosis, Found, Region, Shrink
from pinotwin.machine import Machine
from pinotwin.report import display
from pinotwin.report.blocks import Html, Tile, tiles
from pinotwin.report.display import scale_of
from pinotwin.system.phrases import DIAGNOSED, MEANING, SIGNALS, STATES, joined
from pinotwin.twin import Twin

SERIOUS: tuple[Grade, ...] = ("not explained", "partly explained", "gap explained", "above misfit")
"""From the grade that matters most on."""
ACTS: tuple[Grade, ...] = ("gap explained", "partly explained")
"""Grades of a signal that a named cause acts on."""


def grade_of(d: Diagnosis, axis: str) -> Grade:
    """Return the grade of an axis' first signal, the motor effort where there is one."""
    row = d.gap.get(axis)
    if not row:
        return "not judged"
    return d.grade(axis, "u" if "u" in row else next(iter(row)))


def headline(d: Diagnosis, most: int = 3) -> list[str]:
    """Return the answer in a few sentences, the most important first, of ``most`` causes and axes."""
    rest = [*_possible(d), *_stays(d, most), *_errors(d)]
    if d.recording:
        return [DIAGNOSED["recording"].format(faults=phrases.recording_words(d.recording))]
    if d.verdict == "none":
        first = DIAGNOSED["agree_change" if d.situation == "change" else "agree_structure"]
        seen = phrases.seen_words(d.detectable)
        return [first, *([f"{seen}."] if seen else []), *_stays(d, most), *_errors(d)]
    if not d.effects:
        open_axes = [a for a in d.remains or d.unexplained if grade_of(d, a) != "not judged"]
        where = joined([f"axis {a}" for a in open_axes or d.unexplained] or ["this machine"])
        word = "unsure" if d.possible else "unknown" if open_axes or not d.unexplained else "unjudged"
        reference = "twin" if d.situation == "change" else "model"
        said = DIAGNOSED[word].format(where=where, reference=reference)
        return [*([said] if open_axes or not d.remains else []), *rest]
    lines = [_cause(d, e) for e in d.effects[:most]]
    if len(d.effects) > most:
        others = joined([on_axis(e.effect, e.axis) for e in d.effects[most:]])
        lines.append(DIAGNOSED["also"].format(others=others))
    return [*lines, *rest]


def _possible(d: Diagnosis) -> list[str]:
    """Return the causes that are not sure enough to be named, in one sentence."""
    names = [
        f"{on_axis(e.effect, e.axis)}{change_text(e)} (confidence {e.confidence:.0%})" for e in d.possible
    ]
    return [DIAGNOSED["possible"].format(names=joined(names))] if names else []


def _cause(d: Diagnosis, e: Found) -> str:
    """Return a cause with its size and what it explains of the residual."""
    sizes = told(e.size)
    factor = any(s.unit == "-" and s.before == 1.0 for s in sizes[:1])
    did = moved(sizes) if d.situation == "change" else DIAGNOSED["factor" if factor else "missing"]
    time = event(d, e)
    when = "".join(f", {region_words(r)}" for r in (time, along(e, d.where)) if r)
    if time and len({r.range for r in d.where if r.kind == "time" and r.axis == e.axis}) > 1:
        when += DIAGNOSED["again"]
    said = (
        f"{e.axis or d.machine}: {effect_words(e.effect)} {did}{change_text(e)}{_position_gain(d, e)}{when}."
    )
    logged = _logged(d, e)
    signal = next((x for x in ("u", "v", "ql", "e") if x in e.shrink), "u")
    shrink = e.shrink.get(signal)
    if shrink is None:
        return said + logged
    data = named_data(d, shrink)
    if shrink.share <= 0.0:
        return f"{said} {DIAGNOSED['hint'].format(data=data)}{logged}"
    axis = shrink.axis or e.axis or ""
    scale = scale_of(signal, rotary_axes(d).get(axis, False), shrink.before)
    others = any(x is not e and (axis in x.acts or x.axis == axis) for x in d.effects)
    which = "all" if signal == "e" and len(d.effects) > 1 else "alone" if others else "modelled"
    falls = DIAGNOSED["falls"].format(
        modelled=DIAGNOSED[which],
        residual=DIAGNOSED["residual" if signal == "u" else "signal"].format(signal=SIGNALS[signal])
        + ("" if axis == e.axis else f" of {axis}"),
        before=display.number(shrink.before * scale.factor),
        after=scale.text(shrink.after),
        data=data,
    )
    return f"{said} {falls}{logged}"


PER = {"": (1.0, ""), "·s/m": (1e-3, " per mm/s"), "·s/rad": (math.pi / 180.0, " per °/s")}
"""What follows the unit of the effort -> factor and words of the same beside the unit of the log."""


def _logged(d: Diagnosis, e: Found) -> str:
    """Return the first number in the unit of the log, where the twin found what that is in N or N·m from masses."""
    row = d.subject.quality.get("sizes", {}).get(e.axis) if isinstance(d.subject, Twin) else None
    effort = "N·m" if rotary_axes(d).get(str(e.axis)) else "N"
    rest = e.size[0].unit.removeprefix(effort) if e.size else "-"
    if not row or rest not in PER or row["source"] != "URDF":
        return ""
    factor, per = PER[rest]
    was, now = (display.number(x * factor / row["size"]) for x in (e.size[0].before, e.size[0].after))
    same = {"of": row["unit"], "size": row["size"], "ends": row["interval95"], "effort": effort}
    return DIAGNOSED["logged"].format(was=was, now=now, unit=row["unit"] + per, **same)


def _position_gain(d: Diagnosis, e: Found) -> str:
    """Return the position gain before and now, where a factor of it was found and the twin knows the gain."""
    servo = d.subject.servos.get(str(e.axis)) if isinstance(d.subject, Twin) else None
    if e.effect != "position_gain" or servo is None or servo.form == "pid" or not e.size:
        return ""
    kp = servo.named()["kp"]
    return DIAGNOSED["gain"].format(before=kp, after=kp * e.size[0].after)


def event(d: Diagnosis, e: Found) -> Region | None:
    """Return when a cause took place that was an event: one that no other stretch holds; None for another."""
    once = e.effect == "external_force" or any(x.on == "fitted logs" for x in e.shrink.values())
    return next((r for r in d.where if once and r.kind == "time" and r.axis == e.axis), None)


def named_data(d: Diagnosis, x: Shrink) -> str:
    """Return how a reduction was measured and on which data, by the names of their files."""
    logs = d.provenance.get("logs", ())
    role = "validation" if x.on == "validation" else "diagnosed"
    names = [Path(str(row["source"])).name for row in logs if row.get("role") == role] or ["the log"]
    files = joined(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
    if x.on == "validation":
        return f"validated on {files}"
    return f"{'fitted to' if x.on == 'fitted logs' else 'cross-validated on'} {files}"


def _stays(d: Diagnosis, most: int) -> list[str]:
    """Return what is left, axis by axis, as the grades have it, of ``most`` axes; why, once for those that share it."""
    out, told = list[str](), set[str]()
    for axis, row in d.gap.items():
        if "u" not in row or len(out) >= most:
            continue
        word, g = d.grade(axis, "u"), row["u"]
        if word == "not judged" and axis not in d.remains:
            continue
        scale, why = scale_of("u", rotary_axes(d).get(axis, False), g.rms), d.remains.get(axis, "")
        times = g.rms / g.level if g.level else math.nan
        sizes = {"rms": scale.text(g.rms), "after": display.number(g.after * scale.factor), "times": times}
        looks = f" It {plain_sentence(why).removeprefix('it ')}." if why and why not in told else ""
        told.add(why)
        # no larger than expected, its size is no sign: the pattern is
        form = "pattern" if word == "not explained" and 0.0 < g.rms <= g.level else word
        if form in DIAGNOSED:
            out.append(DIAGNOSED[form].format(axis=axis, why=why, looks=looks, **sizes))
    return out


def _errors(d: Diagnosis) -> list[str]:
    """Return which tracking errors differ although the effort of the axis agrees, or is explained."""
    told = {e.axis for e in d.effects}
    rows = [a for a, row in d.gap.items() if "e" in row and a not in told]
    worse = [a for a in rows if d.grade(a, "e") == "not explained"]
    axes = [a for a in worse if d.grade(a, "u") in ("agrees", "within misfit")]
    left = [a for a in d.gap if a in told and "e" in d.gap[a] and d.grade(a, "e") in OPEN]
    said = [("tracking left", left), ("tracking", axes)]
    return [DIAGNOSED[word].format(axes=joined(names)) for word, names in said if names]


def axis_cards(d: Diagnosis) -> Html:
    """Return one card per axis: every signal with its grade, the residual without and with the causes."""
    cards = []
    for axis, row in d.gap.items():
        parts, (word, kind) = tuple(_card(d, axis, signal) for signal in row), _state(d, axis)
        cards.append(Tile(heading=f"Axis {axis}", parts=parts, label=word, kind=kind))
    return tiles(cards)


def _state(d: Diagnosis, axis: str) -> tuple[str, str]:
    """Return word and colour of the state of an axis."""
    state = d.state(axis)
    return STATES[d.situation][state], {"changed": "bad", "unchanged": "good"}.get(state, "")


def states(d: Diagnosis, most: int = 12) -> list[tuple[str, str]]:
    """Return words and colour of the state of every axis, the changed first; of many the others together."""
    order = ("changed", "cannot say", "unchanged")
    rows = sorted(dict.fromkeys([*d.gap, *rotary_axes(d)]), key=lambda axis: order.index(d.state(axis)))
    said = [(f"{axis} {word}", kind) for axis in rows[:most] for word, kind in [_state(d, axis)]]
    return said + ([(f"{len(rows) - most} more", "")] if len(rows) > most else [])


def _card(d: Diagnosis, axis: str, signal: str) -> Tile:
    g, word = d.gap[axis][signal], d.grade(axis, signal)
    scale = scale_of(signal, rotary_axes(d).get(axis, False), g.rms)
    now = scale.text(g.rms)
    if word in ACTS or (signal == "e" and g.after < g.rms):
        now = f"{display.number(g.rms * scale.factor)} → {scale.text(g.after)}"
    beside = [printed(word), f"{display.percent(g.nrmse)} of the signal"]
    if g.noise > 0.0:
        beside.append(f"noise {scale.text(g.noise)}")
    if g.misfit == g.misfit:
        beside.append(f"validation error {scale.text(g.misfit)}")
    if g.level > g.misfit and scale.text(g.level) != scale.text(g.misfit):
        beside.append(f"expected here {scale.text(g.level)}")
    name, small = SIGNALS.get(signal, signal), signal != "u"
    return Tile(name, now, " · ".join(beside), hint=MEANING[word], small=small)


def machine_of(d: Diagnosis) -> Machine | None:
    """Return the machine that was diagnosed, None where the diagnosis does not hold it."""
    subject = d.subject.machine if isinstance(d.subject, Twin) else d.subject
    return subject if isinstance(subject, Machine) else None


def rotary_axes(d: Diagnosis) -> dict[str, bool]:
    """Return whether each axis turns; from the regions' units where the machine is not known."""
    machine = machine_of(d)
    if machine is not None:
        return dict(zip(machine.names, machine.rotary, strict=True))
    turning = {"rad", "rad/s", "rad/s²", "N·m"}
    return {r.axis: r.unit in turning for r in d.where if r.kind not in ("time", "frequency", "other_axis")}
