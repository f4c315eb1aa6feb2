"""What holds of the numbers of every diagnosis, whatever was diagnosed: no page shows a number that breaks one."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from pinotwin.effects import EFFECTS
from pinotwin.effects.family import TRANSMISSION
from pinotwin.machine import Machine

OPEN = ("not explained", "partly explained")
NEAR = 1e-6
Document = Mapping[str, Any]


def invariants(document: Document) -> list[str]:
    """Return what is broken in the content of a diagnosis.json, one line each."""
    checks = (_shares, _totals, _gaps, _sizes, _rivals, _verdict, _sentence)
    return [line for check in checks for line in check(document)]


def _close(a: float, b: float) -> bool:
    return abs(a - b) <= NEAR * max(abs(a), abs(b), 1e-12)


def _effects(d: Document) -> list[Document]:
    return [*d["effects"], *d.get("possible", ())]


def _stated(d: Document) -> Iterator[tuple[str, str, str, Document]]:
    """Yield whose it is, axis, signal and shrink of every shrink that is stated."""
    for e in _effects(d):
        who = f"{e['effect']} on {e['axis']}"
        for signal, x in e["shrink"].items():
            if isinstance(x, Mapping):
                yield who, x.get("axis") or e["axis"], signal, x
        for axis, x in e.get("acts", {}).items():
            yield f"{who} at {axis}", axis, "u", x
    for axis, row in d["shrink"].items():
        for signal, x in row.items():
            yield "all causes", axis, signal, x


def _shares(d: Document) -> Iterator[str]:
    for who, axis, signal, x in _stated(d):
        share, (low, high) = x["share"], x["interval90"]
        if not 0.0 <= share <= 1.0:
            yield f"share 0..1: {who}, {signal} {share:.3f}"
        if not 0.0 <= low <= high <= 1.0:
            yield f"interval of a share ordered in 0..1: {who}, {signal} [{low:.3f}, {high:.3f}]"
        if not low - NEAR <= share <= high + NEAR:
            yield f"share in its interval: {who}, {signal} {share:.3f} not in [{low:.3f}, {high:.3f}]"
        if not _close(x["after"], x["before"] * math.sqrt(max(1.0 - share, 0.0))):
            yield f"after = before sqrt(1 - share): {who}, {signal} {x['before']:.4g}, {x['after']:.4g}"
        gap = d["gap"].get(axis, {}).get(signal)
        if gap is not None and not _close(x["before"], gap["rms"]):
            yield f"before is the gap: {who}, {axis}.{signal} {x['before']:.4g} of {gap['rms']:.4g}"


def _totals(d: Document) -> Iterator[str]:
    """What is left of a gap is what the named causes leave of it: a single one leaves as much as all."""
    for axis, row in d["gap"].items():
        for signal, gap in row.items():
            named = [
                x
                for e in d["effects"]
                for a, x in (*e.get("acts", {}).items(), (e["axis"], e["shrink"].get(signal)))
                if a == axis and isinstance(x, Mapping) and (signal != "u" or x in e.get("acts", {}).values())
            ]
            if signal == "u" and not any("acts" in e for e in d["effects"]):
                named = [e["shrink"]["u"] for e in d["effects"] if e["axis"] == axis and "u" in e["shrink"]]
            if signal not in ("u", "ql"):
                continue
            gone = 1.0 - (gap["after"] / gap["rms"]) ** 2 if gap["rms"] else 0.0
            parts = {id(x): x for x in named}.values()
            most = sum(x["share"] for x in parts)
            if gone > most + 1e-3:
                yield f"named causes alone are closed: {axis}.{signal} {gone:.3f} of {most:.3f}"


def _gaps(d: Document) -> Iterator[str]:
    for axis, row in d["gap"].items():
        for signal, gap in row.items():
            if gap["after"] > gap["rms"] * (1.0 + NEAR):
                yield f"after <= gap: {axis}.{signal}"
            stated = d["shrink"].get(axis, {}).get(signal)
            if stated is not None and not _close(stated["after"], gap["after"]):
                yield f"one residual wherever shown: {axis}.{signal} {stated['after']:.4g}, {gap['after']:.4g}"


@functools.cache
def _bounds() -> dict[str, tuple[float, float]]:
    """Return coefficient -> least and largest value that makes sense."""
    machine, out = Machine.load("emps"), {}
    for name, kind in EFFECTS.items():
        try:
            coefficients = kind.on(machine, "X").coefficients()
        except (TypeError, ValueError, KeyError):
            continue
        # Of a machine, whose inertia was fitted without the spring, a share behind it is no bound.
        most = math.inf if kind.family is TRANSMISSION else None
        out |= {f"{name}.{c.name}": (c.lower, c.upper if most is None else most) for c in coefficients}
    # The effort may be counted the other way; what is no factor at all is asked of its interval.
    return out | {"viscous_thermal.b": (0.0, math.inf), "effort_scale.share": (-math.inf, math.inf)}


def _sizes(d: Document) -> Iterator[str]:
    for e in _effects(d):
        for s in e["sizes"]:
            who, after = f"{s['name']} on {e['axis']}", s["after"]
            low, high = s["interval90"]
            if after is None or low is None:
                continue
            high = math.inf if high is None else high
            if not low - NEAR * abs(low) <= after <= high + NEAR * abs(high):
                yield f"size in its interval: {who} {after:.4g} not in [{low:.4g}, {high:.4g}]"
            if s["name"] == "effort_scale.share" and low <= -1.0 <= high:
                yield f"a change that a machine can make: {who} [{low:.4g}, {high:.4g}]"
            least, most = _bounds().get(s["name"], (-math.inf, math.inf))
            if not least - 1e-12 <= after <= most + 1e-12:
                yield f"a change that a machine can make: {who} {after:.4g}"


def _rivals(d: Document) -> Iterator[str]:
    for e in _effects(d):
        for a in e["alternatives"]:
            shares = [int(x) / 100 for x in re.findall(r"explains (-?\d+)\s?%", a.get("why", ""))]
            if not all(0.0 <= x <= 1.0 for x in (a.get("share", 0.0), a.get("probability", 0.0), *shares)):
                yield f"a rival's share 0..1: {a['effect']} on {a['axis']}, {a['why']}"
            own = e["shrink"].get("u")
            if len(shares) == 2 and own and abs(shares[1] - max(own["share"], 0.0)) > 0.0051:
                yield f"a rival's share of the winner's residual: {e['effect']}, {a['why']}; {own['share']:.3f}"


def _verdict(d: Document) -> Iterator[str]:
    left = [(a, s) for a, row in d["gap"].items() for s, g in row.items() if g["grade"] in OPEN]
    for axis, signal in left:
        if signal not in d["unexplained"].get(axis, {}):
            yield f"an open signal is unexplained: {axis}.{signal}, verdict {d['verdict']}"
    words = ("partly_explained", "explained") if d["effects"] else ("unexplained", "none")
    if d["verdict"] != words[0 if d["unexplained"] else 1]:
        yield f"verdict as the grades have it: {d['verdict']}, {d['unexplained']}"


def _sentence(d: Document) -> Iterator[str]:
    """The shares in the sentence are those of the table."""
    if d["verdict"] not in ("explained", "partly_explained"):
        return
    for e in d["effects"][:4]:
        first = next((x for x in e["shrink"].values() if isinstance(x, Mapping)), None)
        if first is not None and f"explains {max(first['share'], 0.0):.0%} of" not in d["sentence"]:
            yield f"the sentence's share: {e['effect']} on {e['axis']} {first['share']:.3f}"
