"""What a log excites: known matrices, and the driller with some axes at rest."""

from __future__ import annotations

import numpy as np
import pytest

from pinotwin.dynamics import base_parameters, excitation, parameters
from pinotwin.errors import DataError
from tests.dynamics_models import driller


def columns(n=400, b=4, seed=0):
    return np.random.default_rng(seed).normal(size=(n, b))


def test_orthogonal_columns_are_fully_determined_in_any_unit():
    Q = np.linalg.qr(columns())[0] * [1.0, 0.1, 30.0, 5.0]
    e = excitation(Q, "abcd")
    assert e.condition == pytest.approx(1.0)
    assert (e.rank, e.unexcited, e.determined) == (4, (), ("a", "b", "c", "d"))


def test_dependent_columns_form_a_named_group():
    W = columns(b=5)
    W[:, 1] = 0.0
    W[:, 4] = W[:, 2] - 3.0 * W[:, 3]
    e = excitation(W, "abcde")
    assert [(g.names, g.free) for g in e.unexcited] == [(("b",), 1), (("c", "d", "e"), 1)]
    assert e.rank == 3
    assert e.determined == ("a",)
    assert e.condition == np.inf


def test_separate_groups_stay_apart():
    W = columns(b=6)
    W[:, 1] = 2.0 * W[:, 0]
    W[:, 3] = W[:, 4] = W[:, 2]
    groups = {g.names: g.free for g in excitation(W, "abcdef").unexcited}
    assert groups == {("a", "b"): 1, ("c", "d", "e"): 2}


def test_size_tells_an_empty_column_from_one_in_small_units():
    W = columns() * [1.0, 1.0, 1.0, 1e-6]
    assert excitation(W, "abcd").rank == 3
    assert excitation(W, "abcd", size=np.array([1.0, 1.0, 1.0, 1e6])).rank == 4


def test_fewer_rows_than_parameters():
    e = excitation(columns(n=2), "abcd")
    assert e.rank == 2
    assert e.condition == np.inf


def test_nothing_moves():
    e = excitation(np.zeros((10, 2)), "ab")
    assert e.rank == 0
    assert [g.names for g in e.unexcited] == [("a",), ("b",)]


def multisine(model, moving, n=600):
    t = np.linspace(0.0, 6.0, n)
    q, v, a = (np.zeros((n, 5)) for _ in range(3))
    for j, amplitude in moving.items():
        for k in range(1, 5):
            w = 2 * np.pi * (0.13 * k + 0.037 * j)
            q[:, j] += amplitude * np.sin(w * t + k + j) / k
            v[:, j] += amplitude * w * np.cos(w * t + k + j) / k
            a[:, j] -= amplitude * w * w * np.sin(w * t + k + j) / k
    return q, v, a


def driller_excitation(moving):
    model = driller()
    base = base_parameters(model)
    W = base.regressor(model, *multisine(model, moving)).reshape(-1, len(base))
    size = np.abs(base.from_standard(parameters(model)))
    return excitation(W, base.labels, size=size)


def test_all_axes_of_the_driller():
    e = driller_excitation({0: 0.2, 1: 0.2, 2: 0.2, 3: 1.0, 4: 2.0})
    assert e.rank == 14
    assert e.condition < 30


def test_driller_with_rotations_at_rest():
    e = driller_excitation({0: 0.2, 1: 0.2, 2: 0.2})
    assert set(e.determined) == {"m_X*", "m_Y*", "Ja_Z", "m_Z*"} | (set(e.determined) & {"mx_B"})
    lost = {name for g in e.unexcited for name in g.names}
    assert {"Izz_C*", "Iyy_B*", "Ixy_C"} <= lost


def test_small_tilts_confuse_yoke_and_part():
    wide = driller_excitation({2: 0.2, 3: 1.5, 4: 3.0})
    narrow = driller_excitation({2: 0.2, 3: 0.17, 4: 0.5})
    assert narrow.condition > 3 * wide.condition


@pytest.mark.parametrize(
    ("W", "text"),
    [
        (np.zeros((3, 3)), r"regressor has shape \(3, 3\), expected \(rows > 0, 2\)"),
        (np.zeros((0, 2)), r"regressor has shape \(0, 2\)"),
        (np.array([[1.0, np.nan]]), r"columns \['b'\] hold values that are not finite"),
    ],
)
def test_bad_input(W, text):
    with pytest.raises(DataError, match=text):
        excitation(W, "ab")
