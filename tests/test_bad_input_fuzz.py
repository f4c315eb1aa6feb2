"""Logs spoiled at random: a check and a model, or one line that says why not; never anything else.

``PINOTWIN_FUZZ=1000`` looks longer; warnings of NumPy (overflow, invalid value) count as failures.
"""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pinotwin.errors import InputError
from pinotwin.identification import identify
from pinotwin.log import Log
from pinotwin.logs.check import check
from pinotwin.machine import Machine
from tests.rig import good_log, write_machine

EXAMPLES = int(os.environ.get("PINOTWIN_FUZZ", "25"))
JUNK = (0.0, 1.0, -1.0, np.nan, np.inf, -np.inf, 1e-6, 1e6, 1e9, 1e11, 1e300)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return Machine.load(write_machine(tmp_path_factory.mktemp("rig") / "rig"))


def _span(x: np.ndarray, at: int, size: float) -> np.ndarray:
    x[at : at + 300] = size
    return x


def _shuffled(x: np.ndarray, at: int, _: float) -> np.ndarray:
    np.random.default_rng(at).shuffle(x)
    return x


def _one(x: np.ndarray, at: int, size: float) -> np.ndarray:
    x[at % max(len(x), 1) : at % max(len(x), 1) + 1] = size
    return x


SPOILERS: dict[str, Callable[[np.ndarray, int, float], np.ndarray]] = {
    "one value": _one,
    "a span": _span,
    "scaled": lambda x, _, size: x * (size if np.isfinite(size) else 57.3),
    "shifted": lambda x, _, size: x + (size if np.isfinite(size) else 1e3),
    "constant": lambda x, _, size: 0 * x + size,
    "noise": lambda x, at, _: x + 10.0 ** (at % 9 - 6) * np.random.default_rng(at).normal(size=len(x)),
    "coarse": lambda x, at, _: np.round(x / 10.0 ** (at % 5 - 3)) * 10.0 ** (at % 5 - 3),
    "each three times": lambda x, _, __: np.resize(np.repeat(x[::3], 3), len(x)),
    "backward": lambda x, _, __: x[::-1].copy(),
    "shuffled": _shuffled,
}


@st.composite
def spoiled_logs(draw: st.DrawFn) -> dict[str, np.ndarray]:
    log = good_log()
    for _ in range(draw(st.integers(1, 4))):
        how = draw(st.sampled_from([*SPOILERS, "absent", "cut", "exchanged"]))
        name, other = (draw(st.sampled_from(sorted(log))) for _ in range(2))
        at = draw(st.integers(0, 1999))
        if how == "absent" and len(log) > 1:
            del log[name]
        elif how == "cut":
            log = {key: x[at : at + draw(st.integers(1, 1000))] for key, x in log.items()}
            shortest = min(map(len, log.values()))
            log = {key: x[:shortest] for key, x in log.items()}
        elif how == "exchanged":
            log[name], log[other] = log[other], log[name]
        elif how in SPOILERS:
            with np.errstate(all="ignore"):
                log[name] = SPOILERS[how](log[name].copy(), at, draw(st.sampled_from(JUNK)))
    return log


@settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck))
@given(channels=spoiled_logs())
def test_a_spoiled_log(rig: Machine, channels: dict[str, np.ndarray]) -> None:
    log = Log(channels, "spoiled.csv")
    said = ""
    try:
        assert isinstance(check(rig, log).ok, bool)
        twin = identify(rig, log, loop=False)
    except InputError as error:
        said = str(error)
    if said:
        assert "\n" not in said
        return
    for row in twin.parameters:  # what is not determined has no number to be mistaken for one
        written = row.as_dict()
        if not row.determined:
            assert written["standard_error"] is None
            assert written["interval95"] is None
        else:
            assert np.isfinite(row.value)
            assert np.isfinite(row.error)
