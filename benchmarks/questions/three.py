"""Three changes at once in one log: friction of an axis, play behind its motor, a number of a controller.

The machines over days of ``../foreign/shop.py`` that have a second encoder, its own laws put together; a twin of their
healthy days is asked. Each case is one machine and one number of the controller.
"""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.questions.healthy import read_logs, twin_of
from benchmarks.questions.other_machines import Elsewhere
from pinotwin.diagnosis import diagnose

NUMBERS = ("kv", "ffv", "ffa")
KINDS = tuple(f"three+{x}" for x in NUMBERS)
MACHINES = 10


def made(shop: Any, one: Any, kind: str, m: Any, soft: int = 0, among: Any = None) -> Any:
    """Return a change as ``one`` makes it; of a case its three changes together, of any axis, but for the play."""
    if kind not in KINDS:
        return one(kind, m, soft, among)
    rng, number = m.rng(7, KINDS.index(kind)), kind.partition("+")[2]
    any_axis = [j.name for j in m.spec.actuated()]
    parts = [
        one("friction_up", m, soft, [str(rng.choice(m.felt()))]),
        one("lost_motion", m, soft),
        one(number, m, soft, [str(rng.choice(any_axis))]),
    ]
    out = shop.Change([c for x in parts for c in x.causes])
    for x in parts:
        out.friction |= x.friction
        out.second |= x.second
        out.gains |= x.gains
    return out


def cases(e: Elsewhere, seeds: Sequence[int]) -> list[Path]:
    """Return the folders of all cases of the first machines that have a second encoder; each is made once."""
    sys.path.insert(0, str(e.scripts))
    shop: Any = importlib.import_module("shop")
    shop.KINDS = (*shop.KINDS, *KINDS)
    shop.make = partial(made, shop, shop.make)
    fit = [s for s in seeds if shop.machine(f"random:{s}", s).second][:MACHINES]
    out = []
    for seed in fit:
        base = e.work / f"three-{seed}"
        base.mkdir(parents=True, exist_ok=True)
        shop.write_base(base, f"random:{seed}", seed)
        for kind in KINDS:
            done = base / kind / "answer.json"
            if done.exists() or shop.write_case(base / kind, kind, f"random:{seed}", seed, base):
                out.append(base / kind)
    return out


def asked(case: Path) -> dict[str, Any]:
    """Return a case's causes with whether each is named, whether the first name is right, and wrong ones."""
    causes: list[Mapping[str, Any]] = json.loads((case / "answer.json").read_text(encoding="utf-8"))["causes"]
    days = tuple(sorted(case.parent.glob("healthy_*.csv")))
    logs = read_logs([case / f"{k}.csv" for k in ("train", "repeat", "valid")])
    twin = twin_of(case.parent / "machine", days, loop=True)
    found = diagnose(twin, logs[:2], validate=logs[2:])
    names = [(x.effect, x.axis) for x in found.effects]
    right = [[n[0] in c["names"] and n[1] == c["axis"] for n in names] for c in causes]
    wrong = [n for n, *each in zip(names, *right, strict=True) if not any(each)]
    named = {c["kind"]: any(x) for c, x in zip(causes, right, strict=True)}
    return {"case": case, "named": named, "first": bool(names) and names[0] not in wrong, "wrong": wrong}


def told(e: Elsewhere, seeds: Sequence[int]) -> int:
    """Print every case, and how often each kind is named; return 1 if a first name is wrong."""
    rows = []
    for case in cases(e, seeds):
        rows.append(asked(case))
        missed = [k for k, x in rows[-1]["named"].items() if not x]
        print(f"{case.parent.name} {case.name}: missed {missed}, wrong {rows[-1]['wrong']}", flush=True)
    for kinds in (("friction_up",), ("lost_motion",), NUMBERS):
        each = [x for row in rows for k, x in row["named"].items() if k in kinds]
        print(f"{' or '.join(kinds)}: {sum(each)} of {len(each)} named")
    false = sum(bool(r["named"]) and not r["first"] for r in rows)
    print(
        f"{len(rows)} cases; first name wrong in {false}; wrong names in {sum(bool(r['wrong']) for r in rows)}"
    )
    return int(false > 0)
