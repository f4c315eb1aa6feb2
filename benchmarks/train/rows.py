"""Evidence rows of cases whose changes are known, and of recordings that were spoilt.

A folder of cases is what ``score.py shop`` of the benches of other machines keeps: a machine, healthy days, the twin of
them, and one folder a case with train.csv, repeat.csv, valid.csv and answer.json (its causes).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import pinotwin as pt
from pinotwin.arrays import Floats
from pinotwin.diagnosis.days.causes import EFFECT
from pinotwin.diagnosis.days.judge import evidence
from pinotwin.diagnosis.days.reference import Reference, reference
from pinotwin.diagnosis.days.row import Question, Row
from pinotwin.diagnosis.days.stretch import Stretch, stretches
from pinotwin.effects.scene import with_model_effort
from pinotwin.log import Log

MOST = 45
NAMES = {**EFFECT, "friction_at_start": "brake", "inertia": "inertial_coupling"}
"""Row -> name that the answers of cases use; others keep theirs."""
STRICT = {
    "push": ("push",),
    "cut": ("cut",),
    "tooth": ("tooth",),
    "snag": ("snag",),
    "cross": ("cross_friction",),
    "onset": ("friction_since",),
    "drift": ("drift", "offset"),
    "brake_late": ("friction_at_start",),
    "zero_off": ("zero",),
    "zero_slip": ("zero_since",),
    "tooth_jump": ("encoder_step",),
    "screw_growth": ("encoder_grows", "encoder_scale"),
    "hot_kt": ("torque_fades", "torque_constant", "effort_scale"),
    "counterbalance": ("offset", "drift"),
}
"""Kind of case -> the rows that describe it; any accepted name would do for the contract, but not for the training."""
SPOILT = {
    "late": "command_late",
    "frozen": "effort_frozen",
    "clock": "clock_scale",
    "other_run": "effort_of_another_run",
}


def right(causes: Sequence[Mapping[str, Any]], row: Row) -> bool:
    """Whether a row describes one of the causes of a case."""
    for c in causes:
        if row.axis == c["axis"] or (c["axis"] == "*" and row.name in ("payload", "inertia")):
            name = NAMES.get(row.name, row.name)
            if row.name in STRICT.get(c["kind"], ()) or (c["kind"] not in STRICT and name in c["names"]):
                return True
    return False


def spoilt(log: Log, kind: str, axis: str, rng: np.random.Generator) -> Log:
    """Return a log with a fault of the recording put into an axis."""
    c = {k: np.array(log[k]) for k in log.channels}
    n, u = len(log), f"{axis}.u"
    if kind == "late":
        late = int(rng.choice([1, 4, 12]))
        c[f"{axis}.qr"] = np.r_[np.full(late, c[f"{axis}.qr"][0]), c[f"{axis}.qr"][:-late]]
    elif kind == "frozen":
        start = int(rng.uniform(0.2, 0.6) * n)
        c[u][start : start + n // 4] = c[u][start]
    elif kind == "clock":
        c["t"] = c["t"] * 1.01
    else:
        c[u] = np.roll(c[u], n // 2)
    return Log(c, source=log.source)


def _stretches(r: Reference, logs: Sequence[Log]) -> list[Stretch]:
    out = []
    for k, log in enumerate(logs):
        m = with_model_effort(r.twin.motion(log), r.twin.effects, r.twin.theta)
        left: Floats = m.u - r.twin.effort(m)
        out += stretches(r.twin, m, left, k, r.axes, r.top)
    return out


def _line(q: Question, is_right: Callable[[Row], bool], **what: Any) -> dict[str, Any]:
    """Return the rows of a question, and those beside its best right cause."""
    case, rows, _ = evidence(q)

    def kept(rows: Sequence[Row]) -> list[dict[str, Any]]:
        return [{**r.plain(), "right": is_right(r)} for k, r in enumerate(rows) if r.score > -5.0 or k < 12][
            :MOST
        ]

    line = {**what, "open": dict(case.open), "noise": dict(case.noise), "logs": case.logs, "rows": kept(rows)}
    good = [x for x in case.causes if is_right(x) and x.group not in ("recording", "limit")]
    second = []
    if good:
        beside, more, _ = evidence(q, good[:1])
        second = [{"beside": [good[0].name, good[0].axis], "open": dict(beside.open), "rows": kept(more)}]
    return {**line, "second": second}


def lines(base: Path) -> list[dict[str, Any]]:
    """Return the questions of one machine."""
    twin = pt.Twin.load(base / "twin")
    r = reference(twin, list(twin.machine.names))
    if r is None:
        return []
    out = []
    for d in sorted(p for p in base.iterdir() if (p / "answer.json").exists()):
        answer = json.loads((d / "answer.json").read_text(encoding="utf-8"))
        if answer["kind"] == "held_rows":
            continue  # `check` proves it
        logs = [pt.read(d / f"{k}.csv") for k in ("train", "repeat", "valid")]
        q = Question.of(r, _stretches(r, logs[:2]), _stretches(r, logs[2:]))
        causes = answer["causes"]
        what = {"machine": base.name, "case": d.name, "kind": answer["kind"]}
        out.append(_line(q, lambda row, causes=causes: right(causes, row), **what))
    rng = np.random.default_rng(sum(map(ord, base.name)))
    for n, (kind, name) in enumerate(SPOILT.items()):
        d, axis = base / ("none_2", "none_3")[n % 2], str(rng.choice(r.axes))
        if (d / "answer.json").exists():
            bad = [spoilt(pt.read(d / f"{k}.csv"), kind, axis, rng) for k in ("train", "repeat")]
            q = Question.of(r, _stretches(r, bad))
            what = {"machine": base.name, "case": f"spoilt_{kind}", "kind": f"spoil_{kind}"}
            out.append(
                _line(
                    q, lambda row, name=name, axis=axis: row.name == name and row.axis in (axis, "*"), **what
                )
            )
    return out


def main(words: Sequence[str]) -> None:
    """Write ``MACHINE.jsonl`` into OUT for every machine folder of CASES; what is there is kept."""
    cases, out = map(Path, words[:2])
    out.mkdir(parents=True, exist_ok=True)
    for base in sorted(p for p in cases.iterdir() if (p / "twin" / "twin.json").exists()):
        path = out / f"{base.name}.jsonl"
        if not path.exists():
            text = "".join(json.dumps(x, default=float) + "\n" for x in lines(base))
            path.write_text(text, encoding="utf-8")
            print(base.name, flush=True, file=sys.stderr)
