"""``diagnosis.json``: the public form of a diagnosis (DESIGN section 3)."""

from __future__ import annotations

from typing import Any

from pinotwin.arrays import plain
from pinotwin.diagnosis.result import Diagnosis, Found, Gap, Region, Shrink


def document(d: Diagnosis) -> dict[str, Any]:
    """Return the diagnosis in JSON's own types."""
    content = {
        "verdict": d.verdict,
        "sentence": d.sentence,
        "gap": {a: {s: _gap(g) for s, g in row.items()} for a, row in d.gap.items()},
        "where": [_region(r) for r in d.where],
        "effects": [_effect(e) for e in d.effects],
        "confusable": [list(group) for group in d.confusable],
        "unexplained": {a: dict(row) for a, row in d.unexplained.items()},
        "remains": dict(d.remains),
        "noise": d.noise,
        "confidence_calibrated": not d.quick,
        "advice": list(d.advice),
        "situation": d.situation,
        "shrink": {a: {s: _shrink(x) for s, x in row.items()} for a, row in d.shrink.items()},
        "isolability": {
            _label(true): {_label(k): p for k, p in row.items()} for true, row in d.isolability.items()
        },
        "quick": d.quick,
        "machine": d.machine,
    }
    out = plain(content)
    assert isinstance(out, dict)
    return out


def _label(key: tuple[str, str | None]) -> str:
    effect, axis = key
    return effect if axis is None else f"{axis}.{effect}"


def _gap(g: Gap) -> dict[str, float]:
    return {"rms": g.rms, "nrmse": g.nrmse, "noise": g.noise, "after": g.after}


def _region(r: Region) -> dict[str, Any]:
    row = {
        "axis": r.axis,
        "signal": r.signal,
        "kind": r.kind,
        "range": list(r.range),
        "unit": r.unit,
        "share": r.share,
        "time_share": r.time_share,
        "p_value": r.p_value,
    }
    return row if r.other is None else {**row, "other": r.other}


def _effect(e: Found) -> dict[str, Any]:
    return {
        "effect": e.effect,
        "axis": e.axis,
        "confidence": e.confidence,
        "shape": dict(e.shape),
        "theta": dict(e.theta),
        "shrink": _shrinks(e),
        "alternatives": [dict(a) for a in e.alternatives],
        "moves": {k: list(v) for k, v in e.moves.items()},
        "gain": e.gain,
    }


def _shrinks(e: Found) -> dict[str, Any]:
    out: dict[str, Any] = {s: _shrink(x) for s, x in e.shrink.items()}
    on = {x.on for x in e.shrink.values()}
    return {**out, "on": on.pop() if len(on) == 1 else "held-out blocks"}


def _shrink(x: Shrink) -> dict[str, Any]:
    return {
        "before": x.before,
        "after": x.after,
        "share": x.share,
        "interval90": list(x.interval),
        "promised": x.promised,
        "promised_interval": None if x.promised_interval is None else list(x.promised_interval),
    }
