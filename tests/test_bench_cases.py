"""What the bench draws: enough of everything, fair, sealed, and the same for the same seed."""

from __future__ import annotations

import dataclasses
from collections import Counter

import numpy as np
import pytest
from scipy.stats import kstest

from pinotwin.bench.cases import MACHINES, draw_cases, some
from pinotwin.bench.catalogue import CHANGE, CHANGE_SIZES, SIZES, left_out_with
from pinotwin.bench.plants import is_listed, listing, public_machine, virtual, without
from pinotwin.bench.produce import produce
from pinotwin.errors import InputError


@pytest.fixture(scope="module")
def whole():
    return draw_cases(rounds=4)


def test_the_bench_is_as_large_as_promised(whole):
    kinds = Counter(c.kind for c in whole)
    assert kinds["healthy"] >= 100
    assert kinds["double"] >= 40
    assert kinds["outside"] + kinds["left_out"] >= 30
    assert kinds["form"] >= 20
    assert len({c.effects[0][0] for c in whole if c.kind == "single"}) >= 20
    assert {c.situation for c in whole} == {"structure", "change"}
    used = Counter(c.machine for c in whole)
    assert set(used) == set(MACHINES)
    assert min(used.values()) > 0.7 * max(used.values())


def test_cases_depend_on_the_seed_alone(whole):
    assert draw_cases(rounds=4) == whole
    assert draw_cases(rounds=1) == whole[: len(draw_cases(rounds=1))]
    assert draw_cases(rounds=4, seed=1) != whole
    keys = {c.key(8.0) for c in whole}
    assert len(keys) == len(whole)
    assert whole[0].key(8.0) != whole[0].key(9.0)


def test_sizes_are_log_uniform(whole):
    shares = []
    for case in whole:
        for effect, _, size in case.effects:
            table = CHANGE_SIZES if case.situation == "change" and effect in CHANGE_SIZES else SIZES
            low, high = np.log(table[effect])
            shares.append((np.log(size) - low) / (high - low))
    assert len(shares) > 250
    assert kstest(shares, "uniform").pvalue > 1e-3


def test_axes_are_drawn_from_all(whole):
    drawn = {a for c in whole if c.machine == "laser_driller" for _, a, _ in c.effects}
    assert drawn == set("XYZBC")


def test_a_part_of_the_bench_is_spread_over_it(whole):
    few = some(whole, 20)
    assert len(few) == 20
    assert few[0] == whole[0]
    assert few[-1] == whole[-1]
    assert some(whole, None) == whole


def test_what_is_left_out_takes_its_imitators_along():
    assert "position_table" in left_out_with("ripple")
    assert left_out_with("delay") == ("delay",)
    assert all(name in left_out_with(name) for name in CHANGE)


def test_a_withheld_effect_leaves_the_listing_and_the_rest_of_its_friction_stays():
    assert is_listed("trunnion", "stribeck", "Y")
    assert not is_listed("trunnion", "stribeck", "A")
    items = listing("trunnion")["Y"]
    assert without(items, "viscous") == [i for i in items if i != "viscous"]
    assert {"presliding": {"stribeck": 0}} in without(items, "stribeck")
    assert "coulomb" in without(items, "presliding")
    machine = public_machine("trunnion", (("presliding", "Y", 1.0),))
    names = [e.name for e in machine.axis("Y").effects]
    assert "presliding" not in names
    assert "coulomb" in names
    assert [e.name for e in machine.axis("A").effects] == [
        e.name for e in public_machine("trunnion").axis("A").effects
    ]


def test_the_truth_loses_what_the_listing_lost_and_gets_the_drawn_size():
    placed = (("viscous", "Y", 0.05),)
    bare = virtual("trunnion", off=placed).truth.axes["Y"].friction.viscous
    ill = virtual("trunnion", off=placed, on=placed)
    scale = ill.scales["Y"]
    assert bare == 0.0
    assert ill.truth.axes["Y"].friction.viscous == pytest.approx(0.05 * scale.rated / scale.speed)


def test_nothing_sealed_is_at_hand(whole):
    case = next(c for c in whole if c.kind == "single" and c.machine == "random:33")
    made = produce(case, seconds=3.0)
    folder = made.sealed.machine.urdf.parent
    assert not list(folder.glob("virtual.yaml"))
    assert "virtual" not in made.sealed.machine.spec
    for log in (*made.sealed.logs, *made.sealed.validation):
        assert {c.rpartition(".")[2] for c in log.channels} <= {"t", "q", "qr", "u"}
        assert log.source in ("A1", "A2", "B")
        assert not log.scalars
    fields = {f.name for f in dataclasses.fields(made.sealed)}
    assert fields == {"machine", "logs", "validation"}


def test_repeats_share_a_command_and_the_check_has_another(whole):
    case = next(c for c in whole if c.machine == "emps")
    sealed = produce(case, seconds=3.0).sealed
    one, two = sealed.logs
    assert np.array_equal(one["X.qr"], two["X.qr"])
    assert not np.array_equal(one["X.u"], two["X.u"])
    assert not np.array_equal(one["X.qr"], sealed.validation[0]["X.qr"])


def test_unknown_machines_are_refused():
    with pytest.raises(InputError, match="no machine 'trunion'"):
        draw_cases(["trunion"])
    with pytest.raises(InputError, match="random:SEED"):
        draw_cases(["random:x"])
