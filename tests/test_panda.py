"""The real robot Franka Panda (Gaz et al. 2019): scattered stamps, held and lost samples, no setting needed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt

# Published Coulomb friction [N·m], RA-L 2019, by classical least squares.
PUBLISHED = (0.2450, 0.1523, 0.1827, 0.3591, 0.2669, 0.1658, 0.2109)


@pytest.fixture(scope="module")
def twin(data_dir: Path) -> pt.Twin:
    folder = data_dir / "franka_panda"
    return pt.identify(pt.Machine.load(folder / "machine.yaml"), pt.read(folder / "exciting_traj.csv"))


def test_the_error_is_near_the_published_one_without_any_setting(twin: pt.Twin) -> None:
    assert twin.quality["relative_error"] <= 0.018  # published 1.41 %


def test_friction_agrees_with_the_published(twin: pt.Twin) -> None:
    found = [twin.parameter(f"panda_joint{k}.coulomb.c") for k in range(1, 8)]
    off = [abs(row.value - value) / value for row, value in zip(found, PUBLISHED, strict=True)]
    assert np.median(off) < 0.15
    assert max(off) < 0.4


def test_what_was_done_to_the_clock_is_said(twin: pt.Twin) -> None:
    said = " ".join(twin.quality["preparation"])
    assert "the motion shows a clock of 999.8 Hz below" in said
    assert "missing samples bridged" in said
