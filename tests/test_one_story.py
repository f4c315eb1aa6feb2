"""No contradiction between sentence, table, chip, plot, JSON and terminal: of stored answers, and of 300 made up."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pinotwin.diagnosis import Diagnosis
from pinotwin.diagnosis.grade import OPEN
from pinotwin.diagnosis.result import Found, Gap, Size, shrunk
from tests.one_story import contradictions, read_back

STORED = json.loads((Path(__file__).parent / "answers.json").read_text())["now"]
EFFECTS = ("viscous", "coulomb", "ripple", "backlash", "external_force", "position_table", "friction_scale")


@pytest.mark.parametrize("name", STORED)
def test_a_stored_answer_tells_one_story(name: str) -> None:
    assert contradictions(read_back(STORED[name])) == []


@st.composite
def gaps(draw: st.DrawFn) -> Gap:
    size = 10.0 ** draw(st.floats(-6.0, 4.0))
    rms, misfit, noise, after = (size * draw(st.floats(0.01, 3.0)) for _ in range(4))
    misfit = draw(st.sampled_from((misfit, misfit, math.nan)))
    return Gap(rms, draw(st.floats(0.001, 1.5)), draw(st.sampled_from((noise, 0.0))), min(after, rms), misfit)


@st.composite
def diagnoses(draw: st.DrawFn) -> Diagnosis:
    """Return a diagnosis whose verdict follows from its grades, as every diagnosis' does."""
    situation, causes = draw(st.sampled_from(("change", "structure"))), []
    gap = {
        a: {s: draw(gaps()) for s in draw(st.sampled_from(("u", "ue")))}
        for a in "XYZ"[: draw(st.integers(1, 3))]
    }
    for axis in draw(st.lists(st.sampled_from([*gap]), max_size=2, unique=True)):
        g, name = gap[axis]["u"], draw(st.sampled_from(EFFECTS))
        share = 1.0 - (g.after / g.rms) ** 2
        shrink = shrunk(
            g.rms, share, (share, share), share, draw(st.sampled_from(("validation", "fitted logs"))), None
        )
        before, after = draw(st.sampled_from((0.0, 1.0, 3.0))), draw(st.floats(0.01, 1e3))
        size = Size(f"{name}.c", before, after, draw(st.sampled_from(("N", "-", "rad", "m"))), (after, after))
        causes.append(Found(name, axis, draw(st.floats(0.5, 1.0)), {}, {}, {"u": shrink}, [], size=[size]))
    for axis in set(gap) - {e.axis for e in causes}:  # nothing is taken off where nothing is named
        gap[axis] = {s: replace(g, after=g.rms) for s, g in gap[axis].items()}
    d = Diagnosis("", gap, [], causes, [], {}, {}, "repeats", [], situation, {})
    left = {a: {s: 1.0 for s in row if d.grade(a, s) in OPEN} for a, row in gap.items()}
    left = {a: row for a, row in left.items() if row}
    return replace(d, unexplained=left)


@given(diagnoses())
@settings(max_examples=300, deadline=None)
def test_every_diagnosis_tells_one_story(d: Diagnosis) -> None:
    assert contradictions(d) == []
