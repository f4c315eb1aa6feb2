"""A log is bound, put on an even clock and prepared once, however many questions are asked of it."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from types import FrameType
from typing import Any

import pytest

import pinotwin as pt
from pinotwin import columns
from pinotwin.logs import prepare
from pinotwin.logs.quality import inspection
from pinotwin.scaffold.chain import Sizes
from pinotwin.simulation import run as simulation
from tests.conftest import ROOT

CNC = ROOT / "examples" / "data" / "cnc"
SIZES = Sizes(mass={"Y": 52.0, "A": 9.0, "C": 4.0}, factor={"Y": 35.0, "A": 3.1, "C": 2.2})


def calls(question: Callable[[], Any]) -> tuple[Any, Counter[str]]:
    """Return an answer, and how often logs were bound, made even, filtered, inspected and simulated for it."""
    names = {
        columns.bind.__code__: "bind",
        prepare._regular.__code__: "even",
        prepare._prepare_one.__code__: "filter",
        inspection.inspect.__code__: "inspect",
        simulation.simulate.__code__: "simulate",
    }
    found: Counter[str] = Counter()

    def seen(frame: FrameType, event: str, _: Any) -> None:
        name = names.get(frame.f_code) if event == "call" else None
        if name and not (name == "bind" and frame.f_locals["log"].scale):  # a bound log is returned as it is
            found[name] += 1

    sys.setprofile(seen)
    try:
        return question(), found
    finally:
        sys.setprofile(None)


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> pt.Machine:
    folder = tmp_path_factory.mktemp("cnc") / "table"
    pt.new("0-YAC", CNC / "healthy.sco", sizes=SIZES, out=folder)
    return pt.Machine.load(folder)


@pytest.fixture(scope="module")
def twin(machine: pt.Machine) -> pt.Twin:
    return pt.identify(machine, pt.read(CNC / "healthy.sco"))


def test_check(machine: pt.Machine) -> None:
    log = pt.read(CNC / "healthy.sco")
    _, found = calls(lambda: pt.check(machine, log))
    assert found == {"bind": 1, "even": 1, "filter": 1, "inspect": 1}


def test_identify(machine: pt.Machine) -> None:
    log = pt.read(CNC / "healthy.sco")
    _, found = calls(lambda: pt.identify(machine, log, loop=False))
    assert found == {"bind": 1, "even": 1, "filter": 1}


def test_identify_with_loops_filters_once_more_for_the_unfiltered_law(machine: pt.Machine) -> None:
    log = pt.read(CNC / "healthy.sco")
    _, found = calls(lambda: pt.identify(machine, log))
    assert (found["bind"], found["even"], found["filter"]) == (1, 1, 2)


def test_diagnose_and_its_page(twin: pt.Twin, tmp_path: Any) -> None:
    logs = [pt.read(CNC / name) for name in ("monday.sco", "monday_again.sco")]
    answer, found = calls(lambda: pt.diagnose(twin, logs))
    own = 1  # the twin's own motion, as a log whose command is simulated
    each = Counter({"bind": len(logs) + own, "even": len(logs), "filter": len(logs), "inspect": len(logs)})
    each["simulate"] = (
        2 * len(logs) + 2 * own
    )  # each log without and with the causes; friction of another day
    assert found == each
    _, found = calls(lambda: answer.save(tmp_path / "result"))
    assert found == {}
