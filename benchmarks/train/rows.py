"""Evidence rows of cases whose changes are known, and of recordings that were spoilt.

A folder of cases is what ``score.py shop`` of the benches of other machines keeps: a machine, healthy days, the twin of
them, and one folder a case with train.csv, repeat.csv, valid.csv and answer.json (its causes).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from scipy.interpolate import CubicSpline

import pinotwin as pt
from pinotwin.arrays import Floats
from pinotwin.bench.cases import MACHINES, draw_cases, truth_of
from pinotwin.bench.cases import Case as BenchCase
from pinotwin.bench.catalogue import EXACT
from pinotwin.bench.produce import healthy_twin, produce
from pinotwin.diagnosis.data.comparison import compare
from pinotwin.diagnosis.days.causes import EFFECT
from pinotwin.diagnosis.days.judge import evidence
from pinotwin.diagnosis.days.reference import Reference, reference
from pinotwin.diagnosis.days.row import Question, Row
from pinotwin.diagnosis.days.stretch import Stretch, stretches
from pinotwin.effects.scene import with_model_effort
from pinotwin.errors import PinotwinError
from pinotwin.log import Log
from pinotwin.motion import Motion
from pinotwin.virtual import VirtualMachine, random_trajectory

MOST, SHORT = 45, 7.0
VIRTUAL = (*MACHINES[:3], *(f"random:{k}" for k in range(101, 113)))
"""Virtual machines of the withheld bench that weights are trained on: none of its own random ones."""
HEALTHY: Mapping[str, Any] = {"causes": [], "kind": "none"}
NAMES = {**EFFECT, "friction_at_start": "brake", "inertia": "inertial_coupling"}
"""Row -> name that the answers of cases use; others keep theirs."""
STRICT = {
    "push": ("push",),
    "cut": ("cut", "push"),
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


FORMED = ("ripple", "position_table", "viscous_thermal", "stribeck", "quadratic_drag", "push")


def formed(logs: Sequence[Stretch], kind: str, axis: str, rng: np.random.Generator) -> list[Stretch]:
    """Return logs with an effort of a form like those of the catalogue: the machine needs it, or it is misread."""
    j = logs[0].motion.names.index(axis)
    q, v = (np.concatenate([getattr(s.motion, k)[:, j] for s in logs]) for k in ("q", "v"))
    low, span, top = q.min(), max(float(np.ptp(q)), 1e-12), float(np.quantile(np.abs(v), 0.99))
    share, phase, knots = rng.random(), 6.0 * rng.random(), rng.normal(size=8)

    def course(s: Stretch) -> Floats:
        q, v, t = s.motion.q[:, j], s.motion.v[:, j], s.motion.t - s.motion.t[0]
        turn = 2.0 * np.pi * q / (span * (0.03 + 0.17 * share)) + phase
        x = {
            "ripple": np.sin(turn) + 0.2 * np.sin(2.0 * turn),
            "position_table": CubicSpline(np.linspace(low, low + span, 8), knots)(q),
            "viscous_thermal": v * np.exp(-t / ((0.2 + 0.4 * share) * t[-1])),
            "stribeck": np.tanh(v / (0.003 * top))
            * np.exp(-((np.abs(v) / ((0.04 + 0.1 * share) * top)) ** 1.3)),
            "quadratic_drag": np.sign(v) * np.abs(v) ** 2.1,
            "push": pushed(t, s.log),
        }[kind]
        return np.asarray(x)

    def pushed(t: Floats, run: int) -> Floats:
        """Return rectangular pushes at other times in every run, (m,)."""
        start = np.random.default_rng([int(1e9 * share), run]).uniform(0.05, 0.9, int(1 + 6 * share)) * t[-1]
        return np.asarray(np.sum([(t >= a) & (t < a + 0.3 + share) for a in start], axis=0, dtype=float))

    each = [course(s) for s in logs]
    taken = [s.taken(x) for s, x in zip(logs, each, strict=True)]
    effort = float(np.std(np.concatenate([s.axes[axis]["u"] for s in logs])))
    size = max(float(np.std(np.concatenate(taken))), 1e-300)
    scale = np.exp(rng.uniform(np.log(0.04), np.log(0.5))) * effort / size
    channels = ("left", "u") if rng.random() < 0.3 else ("left",)
    out = []
    for s, x, y in zip(logs, each, taken, strict=True):
        c, u = s.axes[axis], s.motion.u.copy()
        u[:, j] += scale * x
        axes = {**s.axes, axis: {**c, **{k: c[k] + scale * y for k in channels}}}
        out.append(replace(s, axes=axes, motion=replace(s.motion, u=u)))
    return out


def stretches_of(r: Reference, logs: Sequence[Log | Motion]) -> list[Stretch]:
    """Return the stretches of some logs beside healthy days."""
    out = []
    for k, log in enumerate(logs):
        m = r.twin.motion(log) if isinstance(log, Log) else log
        m = with_model_effort(m, r.twin.effects, r.twin.theta)
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

    line = {
        **what,
        "days": q.reference.days,
        "open": dict(case.open),
        "noise": dict(case.noise),
        "rows": kept(rows),
    }
    good = [x for x in case.causes if is_right(x) and x.group not in ("recording", "limit")]
    second = []
    if good:
        beside, more, _ = evidence(q, good[:1])
        one = {"beside": [good[0].name, good[0].axis], "touched": sorted(beside.touched)}
        second = [{**one, "open": dict(beside.open), "rows": kept(more)}]
    return {**line, "second": second}


def lines(base: Path, *, single: bool = False) -> list[dict[str, Any]]:
    """Return the questions of one machine: of two runs and one unseen, or of a ``single`` run."""
    twin = pt.Twin.load(base / "twin")
    r = reference(twin, list(twin.machine.names))
    if r is None:
        return []
    out = []
    runs = ("train",) if single else ("train", "repeat", "valid")
    for d in sorted(p for p in base.iterdir() if (p / "answer.json").exists()):
        answer = json.loads((d / "answer.json").read_text(encoding="utf-8"))
        if answer["kind"] == "held_rows":
            continue  # `check` proves it
        logs = [pt.read(d / f"{k}.csv") for k in runs]
        q = Question.of(r, stretches_of(r, logs[:2]), stretches_of(r, logs[2:]))
        causes = answer["causes"]
        what = {"machine": twin.machine.name, "case": d.name, "kind": answer["kind"]}
        out.append(_line(q, lambda row, causes=causes: right(causes, row), **what))
    rng = np.random.default_rng(sum(map(ord, base.name)))
    for n, kind in enumerate(FORMED):
        d, axis = base / ("none_2", "none_3")[n % 2], str(rng.choice(r.axes))
        if (d / "answer.json").exists():
            each = [stretches_of(r, [pt.read(d / f"{k}.csv")]) for k in runs]
            logs = [replace(s, log=k) for k, s in enumerate(s for x in each for s in x)]
            logs, seen = formed(logs, kind, axis, rng), sum(map(len, each[:2]))
            q = Question.of(r, logs[:seen], logs[seen:])
            what = {"machine": twin.machine.name, "case": f"formed_{kind}", "kind": f"formed_{kind}"}
            names = ("push", "cut") if kind == "push" else (kind,)
            out.append(_line(q, lambda row, k=names, axis=axis: row.name in k and row.axis == axis, **what))
    for n, (kind, name) in enumerate(SPOILT.items()):
        d, axis = base / ("none_2", "none_3")[n % 2], str(rng.choice(r.axes))
        if (d / "answer.json").exists():
            bad = [spoilt(pt.read(d / f"{k}.csv"), kind, axis, rng) for k in runs[:2]]
            q = Question.of(r, stretches_of(r, bad))
            what = {"machine": twin.machine.name, "case": f"spoilt_{kind}", "kind": f"spoil_{kind}"}
            out.append(
                _line(
                    q, lambda row, name=name, axis=axis: row.name == name and row.axis in (axis, "*"), **what
                )
            )
    return out


def cut(log: Log, start: float, seconds: float = SHORT) -> Log:
    """Return so many seconds [s] of a log from a time after its first row [s]."""
    t = np.array(log["t"])
    keep = (t >= t[0] + start) & (t < t[0] + start + seconds)
    return Log({k: np.array(log[k])[keep] for k in log.channels}, source=log.source)


Case = tuple[str, Mapping[str, Any], Sequence[Log], Sequence[Log]]
"""Name of a question, its answer, the logs in question, and unseen ones."""


def short(twin: pt.Twin, asked: Iterable[Case]) -> list[dict[str, Any]]:
    """Return the questions to a twin of few short logs, asked as a diagnosis does: where the twin knows itself."""
    out, known = [], dict[tuple[str, ...], Reference | None]()
    for case, answer, logs, unseen in asked:
        what = {"machine": twin.machine.name, "case": case, "kind": answer["kind"]}
        try:
            c = compare(twin, logs, unseen)
            axes = tuple(twin.machine.names[j] for j in c.new.joints)
            if axes not in known:
                known[axes] = reference(twin, axes)
            r, causes, many = known[axes], answer["causes"], len(c.logs)
            if r is None or not r.laws:
                continue  # nothing is said of it
            q = Question.of(r, stretches_of(r, c.motions[:many]), stretches_of(r, c.motions[many:]))
            if q.logs and all("e" in s.axes[k] for s in q.logs for k in r.laws):
                out.append(_line(q, lambda row, causes=causes: right(causes, row), **what))
        except (PinotwinError, np.linalg.LinAlgError) as error:
            print(*what.values(), error, file=sys.stderr)
    return out


def of_days(base: Path, faults: int = 6) -> list[dict[str, Any]]:
    """Return the questions of healthy days, whole and in parts, and of some changes to a twin of one short log."""

    def asked() -> Iterator[Case]:
        for case, run in [("none", "train"), ("none_2", "train"), ("none_2", "valid"), ("none_3", "valid")]:
            if (base / case).exists():
                yield f"{case}_{run}", HEALTHY, [pt.read(base / case / f"{run}.csv")], []
        for k, start in ((2, 0.0), (3, 4.0), (4, SHORT)):
            yield f"healthy_{k}", HEALTHY, [cut(pt.read(base / f"healthy_{k}.csv"), start)], []
        every = [p for p in base.iterdir() if (p / "answer.json").exists() and "+" not in p.name]
        plain = [p for p in every if not p.name.startswith(("none", "command_jitter", "held_rows"))]
        for d in sorted(plain, key=lambda p: crc32((base.name + p.name).encode()))[:faults]:
            yield (
                d.name,
                json.loads((d / "answer.json").read_text(encoding="utf-8")),
                [pt.read(d / "train.csv")],
                [],
            )

    log = cut(pt.read(base / "healthy_1.csv"), 0.0)
    return short(pt.identify(pt.Machine.load(base / "machine"), log), asked())


def of_motions(name: str, seeds: range = range(100, 140, 5)) -> list[dict[str, Any]]:
    """Return the questions of healthy motions of a machine of the package to twins of one short log each."""
    virtual = VirtualMachine.load(pt.machines()[name])

    def moved(seed: int) -> Log:
        return virtual.record(random_trajectory(virtual, SHORT - 1.0, seed), seed=seed).to_log()

    out = []
    for seed in seeds:
        twin = pt.identify(pt.Machine.load(name), moved(seed), loop=False)
        out += short(twin, (("none", HEALTHY, [moved(k)], []) for k in range(seed + 1, seed + 5)))
    return out


def of_bench(machine: str, folder: Path) -> list[dict[str, Any]]:
    """Return the questions of changes of one virtual machine of the withheld bench, and of none."""
    cases = draw_cases([machine], 1, situations=["change"], seed=crc32(machine.encode()))
    cases = [x for x in cases if x.kind in ("healthy", "single", "outside", "form")]

    def asked(twin: int) -> Iterator[Case]:
        for case in cases:
            if case.twin == twin:
                sealed = produce(case).sealed
                yield f"bench_{case.number}", _answer(case), sealed.logs, sealed.validation

    return [x for k in (0, 1) for x in short(healthy_twin(folder, machine, k), asked(k))]


def _answer(case: BenchCase) -> dict[str, Any]:
    """Return the answer of a case as :func:`right` reads it: a body may be named on any axis."""
    causes = []
    for name, axis in truth_of(case):
        names = sorted({name}.union(*(x for x in EXACT if name in x)))
        causes.append({"axis": "*" if "payload" in names else axis, "kind": name, "names": names})
    return {"kind": f"bench_{case.effects[0][0]}", "causes": causes} if causes else HEALTHY


def main(words: Sequence[str]) -> None:
    """Write ``MACHINE.jsonl`` into OUT for every machine folder of CASES; old ones are kept. ``--single``: one run.

    ``--short``: of twins of one short log, of these machines and of those of the package. ``--bench``: of virtual
    machines of the withheld bench instead.
    """
    cases, out = map(Path, words[:2])
    bases = sorted(p for p in cases.iterdir() if (p / "twin" / "twin.json").exists())
    wanted = {p.name: partial(lines, p, single="--single" in words) for p in bases}
    if "--short" in words:
        wanted = {p.name: partial(of_days, p) for p in bases} | {
            k: partial(of_motions, k) for k in pt.machines()
        }
    if "--bench" in words:
        wanted = {k.replace(":", "_"): partial(of_bench, k, out / "twins") for k in VIRTUAL}
    out.mkdir(parents=True, exist_ok=True)
    for name, made in wanted.items():
        path = out / f"{name}.jsonl"
        if not path.exists():
            text = "".join(json.dumps(x, default=float) + "\n" for x in made())
            path.write_text(text, encoding="utf-8")
            print(name, flush=True, file=sys.stderr)
