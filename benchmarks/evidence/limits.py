"""Detection limits: does a diagnosis find nine of ten causes of the size that it says it would have found?

Healthy days of ``../foreign/shop.py`` are asked about; of what the answer lists as `detectable` some causes are drawn.
The other simulator then runs that same day again, same noise and same friction of the day, with one cause of just the
stated size in its own laws, its controllers in the loop. Play and compliance need its second encoder. A size that the
machine cannot have, such as less friction than none, is put in the other way, or is not asked.
"""

from __future__ import annotations

import importlib
import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.evidence import asking
from benchmarks.evidence.answers import Answers, Row, Runs, diagnosis_of

FRICTION = ("friction_scale", "coulomb", "viscous", "coulomb_asymmetric")
NAMES = {
    **dict.fromkeys(("friction_scale", "coulomb", "viscous"), FRICTION),
    "position_gain": ("position_gain", "loop_gain"),
    "velocity_feedforward": ("velocity_feedforward", "feedforward"),
    "acceleration_feedforward": ("acceleration_feedforward", "feedforward"),
    "drive_flexibility": ("drive_flexibility", "joint_flexibility"),
    "zero": ("zero", "encoder_zero"),
}
"""Cause -> names that are right; another has its own alone."""
MOST = 0.9
"""Of friction a cause takes away this share at most, by which a gain or a stiffness rises or falls at most [1]."""


def limits(runs: Runs) -> Answers:
    """Ask about healthy days of machines, then about the same days with causes of the sizes that were stated."""
    days = runs.score("score.py", "shop", "--kinds", "none", "--seeds", runs.seeds).rows
    sys.path.insert(0, str(runs.at.scripts))
    shop: Any = importlib.import_module("shop")
    rows: list[Row] = []
    for k, day in enumerate(days):
        quota = runs.questions * (k + 1) // len(days) - runs.questions * k // len(days)
        told = json.loads((diagnosis_of(day) / "diagnosis.json").read_text(encoding="utf-8"))
        drawn = drawn_of(told["detectable"], day["seed"])
        ask = partial(_asked, shop, diagnosis_of(day).parent, day["seed"], drawn)
        rows += asking.kept(runs.out, "limits", drawn, ask, quota)
    command = f"python -m benchmarks.evidence.diagnosis limits --seed {runs.seed} --machines {runs.machines}"
    return Answers(rows, f"{command} --questions {runs.questions}")


def drawn_of(detectable: Sequence[Row], seed: int) -> dict[str, tuple[Row, int]]:
    """Return all questions of a healthy day in a drawn order: name -> what is stated, and whether it rises or falls."""
    rng = np.random.default_rng(seed)
    order = [detectable[k] for k in rng.permutation(len(detectable))]
    signs = rng.choice([-1, 1], len(order))
    return {f"{seed} {x['effect']} {x['axis']}": (x, int(sign)) for x, sign in zip(order, signs, strict=True)}


def _asked(
    shop: Any, day: Path, seed: int, drawn: Mapping[str, tuple[Row, int]], question: str
) -> Row | None:
    """Run the day again with one cause, and ask about it; None where the machine cannot have that."""
    stated, sign = drawn[question]
    m = shop.machine(f"random:{seed}", seed)
    change = cause(shop, m, stated, sign) or cause(shop, m, stated, -sign)
    if change is None:
        return None
    folder = day.parent / f"limit-{stated['effect']}-{stated['axis']}"
    folder.mkdir(exist_ok=True)
    number = shop.DAYS + 1 + shop.KINDS.index("none")
    try:
        for file, how in shop.RUNS.items():
            shop.foreign.write_csv(folder / f"{file}.csv", shop.simulate(m, number, *how, change, file))
    except RuntimeError:
        return None  # with it the machine is unstable
    logs = (folder / "train.csv", folder / "repeat.csv", "--validate", folder / "valid.csv")
    row = asking.diagnosed(day.parent / "twin", *logs, out=folder / "diagnosis")
    row.pop("detectable", None)
    keys = ("effect", "axis", "size", "unit", "before")
    return {**row, **{k: stated[k] for k in keys}, "sign": sign, **found(row, stated)}


def found(row: Row, stated: Row) -> dict[str, bool]:
    """Return whether the cause is named on its axis, and whether anything is said to have changed."""
    names = NAMES.get(stated["effect"], (stated["effect"],))
    named = any(name in names and axis == stated["axis"] for name, axis, _ in row["named"])
    return {"found": named, "seen": bool(row["named"]) or row["verdict"] != "none"}


def cause(shop: Any, m: Any, stated: Row, sign: int) -> Any:
    """Return a change of the other simulator's machine of the stated size; None where it cannot have that.

    Args:
        shop: the script ``shop.py``.
        m: its machine.
        stated: effect, axis, size and what the twin holds of it (``before``), in the unit of the effect.
        sign: +1 where the number rises, -1 where it falls.
    """
    axis, size, before = stated["axis"], sign * stated["size"], stated["before"]
    share = size / before if before else math.nan
    joint, second = m.joint(axis), m.second.get(axis)
    there = {"coulomb": joint.coulomb, "viscous": joint.viscous}
    if stated["effect"] in there:
        key, most = stated["effect"][0].replace("v", "b"), there[stated["effect"]]
        law = (axis, stated["effect"], {key: size})
        return shop.Change([], laws=lambda _: ([law], None)) if size > -MOST * most else None
    if stated["effect"] == "offset":
        return shop.Change([], laws=lambda _: ([(axis, "offset", {"f": size})], None))
    if stated["effect"] == "zero":
        return shop.Change([], drive=lambda _: {"zero": {axis: lambda t: size}})
    if stated["effect"] == "backlash":
        return shop.Change([], second={axis: replace(second, gap=abs(size))}) if second else None
    if stated["effect"] == "friction_scale":
        return shop.Change([], friction={axis: 1.0 + share}) if share > -MOST else None
    if stated["effect"] == "effort_scale":
        return shop.Change([], drive=lambda _: {"effort_scale": {axis: 1.0 + size}})
    if not abs(share) <= MOST:
        return None
    if stated["effect"] == "drive_flexibility":
        return shop.Change([], second={axis: replace(second, k=second.k * (1.0 + share))}) if second else None
    numbers = {"acceleration_feedforward": 1, "position_gain": 2, "velocity_feedforward": 3}
    if stated["effect"] not in numbers:
        return None
    gains = [1.0] * 4
    gains[numbers[stated["effect"]]] += share
    return shop.Change([], gains={axis: tuple(gains)})
