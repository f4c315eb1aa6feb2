"""What has changed since a twin that knows no days of its own and no law of its controller was identified."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pinotwin.diagnosis.candidates.catalogue import candidates, named
from pinotwin.diagnosis.data.comparison import Comparison, compare
from pinotwin.diagnosis.days.account import sizes_of
from pinotwin.diagnosis.days.ground import Ground
from pinotwin.diagnosis.days.lack import Lack, judged
from pinotwin.diagnosis.days.structure import lacking
from pinotwin.effects import EFFECTS, Effect
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.twin import Twin
from tests.slide_logs import Extra, listing, log
from tests.test_diagnosis_named import record

VISCOUS = 60.0
"""Of the slide [N·s/m]; its dry friction is 20 N."""


def without_command(log: Log) -> Log:
    return log.with_channels({k: x for k, x in log.channels.items() if k != "X.qr"})


def bare(path: int, *inject: str) -> Log:
    """Return a log of the virtual EMPS; rows at rest count."""
    return without_command(record(path, *inject))


def none(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    del q, v
    return np.zeros_like(t)


@pytest.fixture(scope="module")
def emps() -> Twin:
    machine = Machine.load("emps")
    laws = tuple(EFFECTS[x].on(machine, "X") for x in ("viscous", "presliding"))
    machine = replace(machine, columns={}, axes={"X": replace(machine.axes["X"], effects=laws)})
    return identify(machine, [bare(3), bare(5)], loop=False)


@pytest.fixture(scope="module")
def slide(tmp_path_factory: pytest.TempPathFactory) -> Twin:
    """A twin so good that only what differs from day to day holds it back."""
    machine = listing(tmp_path_factory.mktemp("machine") / "slide")
    logs = [without_command(log(k, none, path=p)) for k, p in ((1, 7), (2, 8))]
    return identify(machine, logs, loop=False)


def later(twin: Twin, *extras: Extra, path: int = 9) -> Comparison:
    """Return runs of the slide on another day, each with something put on top."""
    return compare(twin, [without_command(log(20 + k, x, path=path + k)) for k, x in enumerate(extras)], [])


def rubs(v: np.ndarray) -> np.ndarray:
    return VISCOUS * v + 20.0 * np.tanh(v / 1e-3)


def said(c: Comparison) -> list[str]:
    return [x.name for x in lacking(c).causes]


def known(c: Comparison, effect: Effect) -> Lack | None:
    """Return an effect with what it is worth, where a machine can have it."""
    g = Ground.of(c)
    one = judged(g, effect, "X", g.table(effect))
    return one if one is not None and one.possible else None


@pytest.mark.parametrize("path", [4, 6, 7])
def test_nothing_has_changed(emps: Twin, path: int) -> None:
    assert said(compare(emps, [bare(path)], [])) == []


@pytest.mark.parametrize("path", [9, 12])
def test_nothing_has_changed_on_a_slide_that_is_known_well(slide: Twin, path: int) -> None:
    assert said(later(slide, none, path=path)) == []


@pytest.mark.parametrize(("inject", "cause"), [("viscous:X=0.5", "viscous"), ("ripple:X=0.1", "ripple")])
def test_what_was_put_in_is_named(emps: Twin, inject: str, cause: str) -> None:
    assert said(compare(emps, [bare(4, inject)], [])) == [cause]


@pytest.mark.parametrize(("times", "causes"), [(0.03, []), (0.3, ["viscous"])])
def test_friction_that_scatters_from_run_to_run_is_no_change(
    slide: Twin, times: float, causes: list[str]
) -> None:
    """By so much of all its friction, RMS."""
    assert said(later(slide, lambda t, q, v: times * 2.2 * VISCOUS * v)) == causes


def test_what_closes_less_than_the_scatter_of_friction_is_no_cause_either(slide: Twin) -> None:
    """Friction is 4 % higher than in the twin's runs: no change, nor is a scale that looks a little like it."""
    assert said(later(slide, lambda t, q, v: 0.04 * rubs(v))) == []
    c = later(slide, lambda t, q, v: 0.04 * rubs(v))
    u = c.logs[0].log["X.u"]
    scaled = without_command(c.logs[0].log).with_channels({**c.logs[0].log.channels, "X.u": 1.1 * u})
    assert said(compare(slide, [scaled], [])) == ["effort_scale"]


def test_friction_of_another_form_is_no_scatter_of_it_however_little(slide: Twin) -> None:
    """Friction that goes with the load closed 0.88 of a gap of four misfits, and was called scatter."""

    def falls(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        del t, q
        turn = np.abs(v) / np.abs(v).max()
        course = np.sign(v) * (np.exp(-turn / 0.05) - 0.2 * np.exp(-turn))
        return np.asarray(0.06 * course * np.sqrt(np.mean(rubs(v) ** 2) / np.mean(course**2)))

    assert said(later(slide, falls)) == ["stribeck"]


@pytest.mark.parametrize("stands", [True, False])
def test_a_push_is_named_while_the_axis_moves_and_what_friction_may_hold_at_rest_is_none(
    emps: Twin, stands: bool
) -> None:
    c = compare(emps, [bare(4)], [])
    v = np.abs(c.new.motion.v[c.new.samples(0), 0])
    rows = np.flatnonzero((v < 0.01 * v.max()) == stands)
    longest = max(np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1), key=len)[:100]
    assert len(longest) > 20
    begin, end = c.new.motion.t[c.new.samples(0)[longest[[0, -1]]]]
    u, t = bare(4)["X.u"], bare(4).t
    pushed = u + 15.0 * c.floor[0] * ((t >= begin) & (t <= end))
    found = said(compare(emps, [bare(4).with_channels({**bare(4).channels, "X.u": pushed})], []))
    assert found == ([] if stands else ["external_force"])


@pytest.mark.parametrize(("scale", "told"), [(0.048, False), (0.15, True)])
def test_friction_that_differs_from_run_to_run_is_no_push(slide: Twin, scale: float, told: bool) -> None:
    found = said(later(slide, none, lambda t, q, v: scale * rubs(v)))
    assert bool(found) is told


@pytest.mark.parametrize(("times", "value"), [(-0.5, 0.5), (-1.02, 0.0), (-3.0, None)])
def test_friction_is_none_at_least_once_it_has_changed(
    slide: Twin, times: float, value: float | None
) -> None:
    drag = EFFECTS["viscous"].on(slide.machine, "X")
    noise = 10.0 * np.random.default_rng(1).normal(size=6000)
    one = known(later(slide, lambda t, q, v: times * VISCOUS * v + noise), drag)
    if value is None:
        assert one is None
        return
    assert one is not None
    (size,) = sizes_of(one)
    assert size.before == pytest.approx(VISCOUS, rel=0.1)
    assert size.after == pytest.approx(value * VISCOUS, abs=0.1 * VISCOUS)
    assert 0.0 <= size.interval[0] <= size.after <= size.interval[1]


@pytest.mark.parametrize(
    ("factor", "turned", "can"), [(0.5, False, True), (0.0, False, False), (-0.9, True, True)]
)
def test_a_drive_counts_no_effort_with_a_factor_of_nothing(
    slide: Twin, factor: float, turned: bool, can: bool
) -> None:
    plain = without_command(log(20, none, path=9))
    rest = 0.3 * np.random.default_rng(3).normal(size=len(plain.t))
    scaled = plain.with_channels({**plain.channels, "X.u": factor * plain["X.u"] + rest})
    c = compare(slide, [scaled], [])
    c = replace(c, gate=replace(c.gate, turned=frozenset({"X"} if turned else ())))
    assert (known(c, EFFECTS["effort_scale"].on(slide.machine, "X")) is not None) == can


@pytest.mark.parametrize(("part", "can"), [(-0.5, True), (-1.5, False)])
def test_friction_that_warms_away_brakes_to_the_end(slide: Twin, part: float, can: bool) -> None:
    c = later(slide, lambda t, q, v: part * VISCOUS * v * (1.0 - np.exp(-t / 5.0)))
    warm: Any = next(e for e in candidates(c) if named(e).name == "viscous_thermal").shaped([5.0])
    one = known(c, warm)
    assert (one is not None) == can
    if one is not None:
        cold = next(s for s in sizes_of(one) if s.name == "viscous_thermal.b")
        assert cold.before == pytest.approx(VISCOUS, rel=0.1)
        assert cold.after == pytest.approx(VISCOUS, rel=0.1)


@pytest.mark.parametrize(("share", "fitting"), [(0.3, True), (40.0, False)])
def test_a_load_behind_a_spring_is_no_more_than_its_axis(
    emps: Twin, share: float, fitting: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a machine, whose inertia was fitted without the spring."""
    monkeypatch.setattr(Lack, "own", 1.0)
    c = compare(emps.machine, [bare(4)], [])
    spring = EFFECTS["drive_flexibility"].on(c.machine, "X").shaped([30.0, 0.03])
    g = Ground.of(c)
    one = judged(g, spring, "X", g.table(spring))
    assert one is not None
    told = replace(one.fit, theta=np.array([share]), covariance=np.zeros((1, 1)))
    assert replace(one, fit=told).possible is fitting
