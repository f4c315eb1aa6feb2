"""Lines of real recordings: what counts as right, what is skipped, and one that is run."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from benchmarks.questions.__main__ import main
from benchmarks.questions.real import Given, Line, Task, cells, data_folder, line_of, real_lines
from benchmarks.questions.real_tasks import TASKS
from pinotwin.dynamics.parameters import body_count


def task(recording, withheld):
    return next(t for t in TASKS if (t.recording, t.withheld) == (recording, withheld))


def test_every_line_that_was_promised_is_there():
    lines = {(t.recording, t.withheld) for t in TASKS}
    assert {w for r, w in lines if r == "EMPS"} == {
        "Coulomb friction",
        "viscous friction",
        "asymmetric friction",
    }
    assert {w for r, w in lines if r == "TX40"} == {
        "wrist coupling",
        "gravity",
        "rotor inertia",
        "the effort's lead, uncorrected",
    }
    assert any("ODrive" in r for r, _ in lines)
    assert {w for r, w in lines if r == "KR300"} == {"gear ripple", "joint flexibility"}


def test_right_is_the_effect_on_its_axis():
    coupling = task("TX40", "wrist coupling")
    assert coupling.is_right(("wrist_coupling", "J6"))
    assert not coupling.is_right(("wrist_coupling", "J2"))
    assert task("TX40", "gravity").is_right(("gravity", None))
    assert not task("TX40", "gravity").is_right(("delay", "J1"))


def test_without_recordings_every_line_is_skipped_with_the_reason(tmp_path):
    for folder in (None, tmp_path):
        lines = list(real_lines(folder, TASKS))
        assert len(lines) == len(TASKS)
        assert all(x.skipped == "the recording is not at hand" for x in lines)


def test_the_folder_of_recordings_is_found_in_three_ways(tmp_path, monkeypatch):
    monkeypatch.setenv("PINOTWIN_DATA", str(tmp_path))
    assert data_folder() == tmp_path
    assert data_folder("/nowhere/at/all") is None


def test_data_that_cannot_be_read_are_a_line_not_a_crash(tmp_path):
    (tmp_path / "emps").mkdir()
    (tmp_path / "emps" / "DATA_EMPS.mat").write_bytes(b"not a mat file")
    line = line_of(task("EMPS", "viscous friction"), tmp_path)
    assert "DATA_EMPS.mat" in line.skipped
    assert not line.right


def test_viscous_friction_of_the_real_drive_is_named(data_dir):
    line = line_of(task("EMPS", "viscous friction"), data_dir)
    assert line.right
    assert line.axis == "X"
    assert line.on == "validation"
    assert line.shrink > 0.9


def test_cogging_of_the_real_motor_is_named_from_its_maps(data_dir):
    line = line_of(task("ODrive, cogging maps", "cogging"), data_dir)
    assert line.right
    assert line.effect in ("ripple", "ripple_modulated", "position_table")


def test_what_is_withheld_of_the_robot_is_gone_and_nothing_else(data_dir):
    given: dict[str, Given] = {t.withheld: t.make(Path(data_dir)) for t in TASKS if t.recording == "TX40"}
    effects = [e.name for e in given["wrist coupling"].machine.axis("J6").effects]
    assert "wrist_coupling" not in effects
    assert "viscous" in effects
    assert not np.any(given["gravity"].machine.model.gravity.vector)
    whole, poorer = (given[w].machine for w in ("gravity", "rotor inertia"))
    links = 10 * body_count(whole.model)
    assert np.abs(whole.base.P[:, links:]).max() > 0.0
    assert not np.any(poorer.base.P[:, links:])
    # The same efforts as before for a machine whose rotors weigh nothing.
    rng = np.random.default_rng(1)
    q, v, a = (rng.uniform(-1, 1, (5, 6)) for _ in range(3))
    pi = np.concatenate([rng.normal(size=links), np.zeros(whole.base.P.shape[1] - links)])
    still = dataclasses.replace(whole, model=poorer.model)
    full = still.base.regressor(still.model, q, v, a) @ still.base.from_standard(pi)
    less = poorer.base.regressor(poorer.model, q, v, a) @ poorer.base.from_standard(pi)
    np.testing.assert_allclose(less, full, atol=1e-8)


def test_a_task_says_where_it_is_right_for_any_axis():
    anywhere = Task("r", "w", ("ripple",), (), lambda folder: pytest.fail("not run"), "file")
    assert anywhere.is_right(("ripple", "A4"))


def test_the_table_says_what_was_named_or_why_it_was_skipped(capsys, tmp_path):
    named = Line(
        "EMPS", "Coulomb friction", "explained: coulomb on X", "coulomb", "X", 0.9, 0.97, "validation", True
    )
    row = " | ".join(cells(named))
    assert row == "EMPS | Coulomb friction | explained: coulomb on X | 0.90 | 0.97 (validation) | yes"
    assert main(["real", "--data", str(tmp_path)]) == 0
    head, _, *rows = capsys.readouterr().out.splitlines()
    assert head.startswith("| recording | withheld |")
    assert len(rows) == len(TASKS)
    assert all("skipped: the recording is not at hand" in row for row in rows)
