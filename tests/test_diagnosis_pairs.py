"""One cause for two, and two for one: a load on two axes, two ripples in place of a table."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from pinotwin.diagnosis.candidates.catalogue import candidates, named
from pinotwin.diagnosis.conclusion.verdict import judge
from pinotwin.diagnosis.data.comparison import compare
from pinotwin.diagnosis.result import Found as Named
from pinotwin.diagnosis.result import Gap, shrunk
from pinotwin.diagnosis.rules import RULES
from pinotwin.diagnosis.search import forward
from pinotwin.diagnosis.search.forward import Found, Step, search
from pinotwin.diagnosis.search.scan import Scored, Searcher
from pinotwin.diagnosis.search.shortlist import Shortlist
from pinotwin.effects import EFFECTS, Ripple
from pinotwin.identification import identify
from pinotwin.machine import Machine
from pinotwin.twin import Twin
from tests.test_diagnosis_named import one_number, record, with_residual
from tests.test_effects_battery import tree


@pytest.fixture(scope="module")
def twin() -> Twin:
    machine = dataclasses.replace(Machine.load("emps"), columns={})
    return identify(machine, [record(3), record(5)])


def step(chosen: Scored, *rivals: Scored) -> Step:
    return Step(chosen, rivals, cast(Searcher, None))


@pytest.mark.parametrize(("closed", "names"), [(1.13, ["payload"]), (1.11, ["effort_scale", "effort_scale"])])
def test_a_load_that_closes_two_axes_stands_for_the_scales_of_both(
    closed: float, names: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Foreign random892: 12 kg on a table that turns on a slide were two drives that log 4 and 7 % too much."""
    monkeypatch.setattr(forward, "refused", lambda *_: "")
    lifts, turns = (
        one_number(EFFECTS["effort_scale"].on(tree(), axis), (j,), gain)
        for j, (axis, gain) in enumerate((("Y", 1.0), ("A", 0.12)))
    )
    load = one_number(EFFECTS["payload"].on(tree(), "A"), (0, 1), closed)
    found = forward._as_one([step(lifts, load), step(turns)], RULES)
    assert [named(s.chosen.effect).name for s in found] == names
    if names == ["payload"]:
        assert found[0].again(lifts, [lifts, load], [lifts, load, turns]) is load
        weaker = dataclasses.replace(load, gain=1.0)
        assert found[0].again(lifts, [lifts, weaker], [lifts, weaker, turns]) is lifts


def test_one_axis_closed_by_a_scale_alone_is_no_load(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forward, "refused", lambda *_: "")
    scale = one_number(EFFECTS["effort_scale"].on(tree(), "Y"), (0,), 1.0)
    again = one_number(EFFECTS["viscous"].on(tree(), "Y"), (0,), 0.1)
    load = one_number(EFFECTS["payload"].on(tree(), "A"), (0, 1), 1.2)
    steps = [step(scale, load), step(again)]
    assert forward._as_one(steps, RULES) == steps


def test_two_ripples_are_not_a_table(twin: Twin) -> None:
    """Foreign random834, 890: a listed ripple whose pitch was found for want of another one."""
    c = compare(twin, [record(4)], [])
    columns = [c.new.columns(Ripple("X", period=p))[0] for p in (0.05, 0.031)]
    put = [x @ [1.0, 0.3] for x in columns]
    r = sum(8.0 * c.floor[0] * x / np.sqrt(np.mean(x**2)) for x in put)
    r = r + c.floor[0] * np.random.default_rng(0).normal(size=len(r))
    every = [e for e in candidates(c) if named(e).name in ("ripple", "position_table")]
    found = search(with_residual(c, r), every)
    assert next(named(s.chosen.effect).name for s in found.steps) == "ripple"


def test_friction_beside_a_ripple_is_no_two_causes_in_place_of_a_table(twin: Twin) -> None:
    """LWR4: a table of its first axis was a ripple and asymmetric friction, which close more of what both leave."""
    searcher = Searcher(compare(twin, [record(4)], []))
    of = {e.name: e for e in (named(x) for x in candidates(searcher.comparison))}
    scored = {name: searcher.score(of[name]) for name in ("position_table", "ripple", "viscous_asymmetric")}
    assert all(scored.values())
    beside = {k: forward._plain_beside(scored["position_table"], one, RULES) for k, one in scored.items()}
    assert beside == {"position_table": False, "ripple": True, "viscous_asymmetric": False}


def test_a_body_has_many_numbers_and_stands_for_no_two_causes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Own bench 24, 25: two and four kilograms on a slide were its drive's scale and a little of something else."""
    load = dataclasses.replace(
        one_number(EFFECTS["payload"].on(tree(), "A"), (0,), 1.0), judged=SimpleNamespace(theta=np.ones(10))
    )
    scale, rest = (
        one_number(EFFECTS[x].on(tree(), "A"), (0,), gain)
        for x, gain in (("effort_scale", 0.93), ("viscous", 0.03))
    )
    monkeypatch.setattr(forward, "_plain_beside", lambda rich, one, rules: one in (scale, rest))
    monkeypatch.setattr(forward, "rank", lambda *_: [rest])
    shortlist = cast(Shortlist, SimpleNamespace(of=lambda _: ()))
    searcher = cast(Searcher, SimpleNamespace(comparison=SimpleNamespace(change=False), found=()))
    assert forward._first_of_two(load, [load, scale], searcher, shortlist, RULES) is load
    table = dataclasses.replace(load, effect=EFFECTS["position_table"].on(tree(), "A"))
    assert forward._first_of_two(table, [table, scale], searcher, shortlist, RULES) is scale


def test_a_cause_that_is_not_sure_opens_the_axis_that_it_moves_most(twin: Twin) -> None:
    """A load of 12 kg on the last link, not sure, left "no change" on the axis that lifts it."""
    c = compare(twin, [record(4)], [])
    searcher = Searcher(c)
    load = one_number(EFFECTS["payload"].on(tree(), "A"), (0,), 1.0)
    found = Found([Step(load, (), searcher)], None, (), searcher, searcher)
    acts = {"X": shrunk(4.0, 0.9, (0.8, 0.95), 0.9, "held-out blocks", "X")}
    unsure = Named("payload", "A", 0.3, {}, {}, {}, [], acts=acts)
    said = judge(
        c, found, {"X": {"u": Gap(rms=4.0, nrmse=0.1, noise=0.8, after=0.9, misfit=0.6)}}, [], [unsure]
    )
    assert (said.verdict, list(said.unexplained)) == ("unexplained", ["X"])


@pytest.mark.parametrize(
    ("name", "percent", "is_named"),
    [("quadratic_drag", 0.8, True), ("quadratic_drag", 0.2, False), ("coulomb", 0.8, False)],
)
def test_what_is_all_that_repeats_share_is_named_however_small_unless_it_rubs_about_rest(
    name: str, percent: float, is_named: bool
) -> None:
    """Foreign random896, 897: a drag of 0.6 to 0.8 % of the effort was half and more of what two runs shared."""
    machine = dataclasses.replace(Machine.load("emps"), columns={})
    c = compare(machine.with_effects("X", ()), [record(4)], [])
    law = EFFECTS[name].on(c.machine, "X")
    column = c.new.columns(law)[0][:, 0]
    put = 0.01 * percent * c.new.size(0) * column / np.std(column)
    sigma = np.std(put)
    r = put + sigma * np.random.default_rng(0).normal(size=len(put))
    c = dataclasses.replace(with_residual(c, r), floor={0: sigma}, noise={0: sigma})
    assert bool(search(c, [law]).steps) is is_named
