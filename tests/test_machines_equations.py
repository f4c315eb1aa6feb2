"""The bundled machines are the thesis' equations: RNEA of their trees against the closed forms.

The closed forms are written out here by hand from Wang (2023): Eq. 3.2 to 3.6 (5-axis laser
driller), Eq. 4.26-4.27 (trunnion) and Eq. 5.4-5.5 (flexure rig), their rigid parts, with the errata
of re-deriving them: 4.27 takes the *acceleration* of the linear axis, 5.4's first left side is u_Y.
Inertias, rotor inertias and states are drawn at random; the structure that the equations assume (a
centre of mass on its axis, a symmetric rotor) is kept.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import scipy.linalg
import yaml

G = 9.81
SEEDS = range(20)


def load(urdf_dir: Path, name: str) -> pin.Model:
    model = pin.buildModelFromUrdf(str(urdf_dir / name / f"{name}.urdf"))
    model.gravity.linear = np.array([0.0, 0.0, -G])
    return model


def random_tensor(rng: np.random.Generator) -> np.ndarray:
    """A rotational inertia that a real body can have [kg·m²]."""
    points = rng.normal(size=(6, 3)) * 0.2
    centred = points - points.mean(axis=0)
    second = centred.T @ centred
    return np.trace(second) * np.eye(3) - second


def symmetric_tensor(rng: np.random.Generator) -> np.ndarray:
    """A rotational inertia with Ixx = Iyy and no products, about z."""
    side = rng.uniform(0.02, 0.2)
    return np.diag([side, side, rng.uniform(0.2, 1.9) * side])


def body(m: float, com: list[float], tensor: np.ndarray) -> pin.Inertia:
    return pin.Inertia(m, np.array(com), tensor)


def states(model: pin.Model, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return tuple(rng.uniform(-3.0, 3.0, size=model.nv) for _ in range(3))


def agree(tau: np.ndarray, equation: np.ndarray) -> None:
    scale = np.abs(equation).max()
    np.testing.assert_allclose(tau, equation, rtol=1e-9, atol=1e-9 * scale)


def test_joint_order_and_axes_of_the_driller(urdf_dir: Path) -> None:
    model = load(urdf_dir, "laser_driller")
    assert list(model.names)[1:] == ["X", "Y", "Z", "B", "C"]
    np.testing.assert_allclose(model.jointPlacements[model.getJointId("C")].translation, [0, 0, 0.08])
    for joint in range(1, model.njoints):
        np.testing.assert_allclose(model.jointPlacements[joint].rotation, np.eye(3), atol=1e-15)


@pytest.mark.parametrize("seed", SEEDS)
def test_driller_is_eq_3_2_to_3_6(urdf_dir: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = load(urdf_dir, "laser_driller")
    r_c = 0.08
    m_x, m_y, m_z, m_b, m_c, m_w = rng.uniform(2.0, 60.0, size=6)
    m_sx, m_sy, m_sc = rng.uniform(1.0, 90.0, size=3)  # reflected rotor inertias
    r_b = rng.uniform(-0.1, 0.1)
    x_w, y_w, z_w = rng.uniform(-0.1, 0.1, size=3)
    i_b, i_w, i_c = random_tensor(rng), random_tensor(rng), symmetric_tensor(rng)
    model.inertias[1] = body(m_x, [0.1, 0.2, 0.3], random_tensor(rng))
    model.inertias[2] = body(m_y, [-0.1, 0.2, 0.1], random_tensor(rng))
    model.inertias[3] = body(m_z, [0.1, 0.4, 0.0], random_tensor(rng))
    model.inertias[4] = body(m_b, [0.0, 0.0, -r_b], i_b)
    model.inertias[5] = body(m_c, [0.0, 0.0, 0.0], i_c) + body(m_w, [x_w, y_w, z_w], i_w)
    model.armature = np.array([m_sx, m_sy, m_sc, 0.0, 0.0])
    q, v, a = states(model, rng)
    tau = pin.rnea(model, model.createData(), q, v, a)

    (_, _, _, q_b, q_c), (_, _, _, v_b, v_c), (a_x, a_y, a_z, a_b, a_c) = q, v, a
    sb, cb, sc, cc = np.sin(q_b), np.cos(q_b), np.sin(q_c), np.cos(q_c)
    # Eq. 3.2, 3.3: decoupled; X carries Y.
    u_x = (m_x + m_y + m_sx) * a_x
    u_y = (m_y + m_sy) * a_y
    # Eq. 3.4
    s_z = r_c * m_c + z_w * m_w + r_c * m_w - r_b * m_b
    u_z = (
        (m_z + m_b + m_c + m_w + m_sc) * a_z
        + (m_z + m_b + m_c + m_w) * (-G)
        + s_z * (cb * v_b**2 + sb * a_b)
        + y_w * m_w * (-2 * cb * cc * v_b * v_c + (v_b**2 + v_c**2) * sb * sc - sb * cc * a_c - cb * sc * a_b)
        + x_w * m_w * (2 * cb * sc * v_b * v_c + (v_b**2 + v_c**2) * sb * cc + sb * sc * a_c - cb * cc * a_b)
    )
    # Eq. 3.5; products of inertia are elements of the tensor (I_xy = -integral of xy dm)
    p_zx = -i_w[2, 0] + m_w * r_c * x_w + m_w * x_w * z_w
    p_xy = i_w[0, 1] - m_w * x_w * y_w
    p_yz = i_w[1, 2] - m_w * r_c * y_w - m_w * y_w * z_w
    d_xy = i_w[0, 0] - i_w[1, 1] - m_w * x_w**2 + m_w * y_w**2
    j_b = (
        i_b[1, 1]
        + i_c[0, 0]
        + i_w[0, 0]
        + m_c * r_c**2
        + m_b * r_b**2
        + m_w * y_w**2
        + m_w * z_w**2
        + m_w * r_c**2
        + 2 * m_w * r_c * z_w
    )
    u_b = (
        j_b * a_b
        + s_z * (a_z - G) * sb
        + p_zx * (v_c**2 * cc + a_c * sc)
        + p_xy * (2 * v_b * v_c - 2 * a_b * cc * sc - 4 * cc**2 * v_b * v_c)
        + p_yz * (a_c * cc - v_c**2 * sc)
        + d_xy * (2 * cc * sc * v_b * v_c - cc**2 * a_b)
        + m_w * y_w * (G - a_z) * cb * sc
        + m_w * x_w * (G - a_z) * cb * cc
    )
    # Eq. 3.6
    u_c = (
        (i_c[2, 2] + i_w[2, 2] + m_w * x_w**2 + m_w * y_w**2) * a_c
        + p_xy * (2 * cc**2 - 1) * v_b**2
        + p_zx * a_b * sc
        + p_yz * a_b * cc
        + d_xy * (-sc * cc * v_b**2)
        + m_w * y_w * (-a_z + G) * sb * cc
        + m_w * x_w * (a_z - G) * sb * sc
    )
    agree(tau, np.array([u_x, u_y, u_z, u_b, u_c]))


@pytest.mark.parametrize("seed", SEEDS)
def test_trunnion_is_eq_4_26_and_4_27(urdf_dir: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = load(urdf_dir, "trunnion")
    assert list(model.names)[1:] == ["Y", "A", "C"]
    h_c = model.jointPlacements[3].translation[2]
    m_y, m_a, m_c = rng.uniform(2.0, 60.0, size=3)
    r_a, z_c = rng.uniform(0.02, 0.2, size=2)
    i_a, i_c = random_tensor(rng), symmetric_tensor(rng)
    model.inertias[1] = body(m_y, [0.1, 0.2, 0.3], random_tensor(rng))
    model.inertias[2] = body(m_a, [0.0, 0.0, -r_a], i_a)
    model.inertias[3] = body(m_c, [0.0, 0.0, -z_c], i_c)
    model.armature = rng.uniform(0.1, 5.0, size=3)
    q, v, a = states(model, rng)
    tau = pin.rnea(model, model.createData(), q, v, a)

    depth = z_c - h_c  # of the table's centre of mass below the A axis
    chi_1 = m_y + m_a + m_c + model.armature[0]
    chi_2 = m_a * r_a + m_c * depth
    chi_6 = i_a[0, 0] + m_a * r_a**2 + i_c[0, 0] + m_c * depth**2 + model.armature[1]
    u_1 = chi_1 * a[0] + chi_2 * (a[1] * np.cos(q[1]) - v[1] ** 2 * np.sin(q[1]))
    u_2 = chi_6 * a[1] + chi_2 * (a[0] * np.cos(q[1]) + G * np.sin(q[1]))
    u_3 = (i_c[2, 2] + model.armature[2]) * a[2]  # a body of revolution is decoupled
    agree(tau, np.array([u_1, u_2, u_3]))


def rig_parameters(model: pin.Model) -> dict[str, float]:
    """Parameters of Eq. 5.4-5.5 from the inertials of the tree."""
    link, tilt, table = (model.inertias[i] for i in (2, 3, 4))
    length = model.jointPlacements[3].translation[2]
    h_c = model.jointPlacements[4].translation[2]
    m_a = tilt.mass + table.mass
    rho = -tilt.mass * tilt.lever[2] - table.mass * (h_c + table.lever[2])
    return {
        "m_Y": model.inertias[1].mass + link.mass + m_a,
        "mu": link.mass * link.lever[2] + m_a * length,
        "rho": rho,
        "lambda": length * rho,
        "psi": rho * G,
        "phi": (link.mass * link.lever[2] + m_a * length) * G,
        "I_delta": link.inertia[0, 0] + link.mass * link.lever[2] ** 2 + m_a * length**2,
        "I_A": tilt.inertia[0, 0]
        + tilt.mass * tilt.lever[2] ** 2
        + table.inertia[0, 0]
        + table.mass * (h_c + table.lever[2]) ** 2,
    }


@pytest.mark.parametrize("seed", SEEDS)
def test_flexure_rig_is_eq_5_4_and_5_5(urdf_dir: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = load(urdf_dir, "flexure_rig")
    assert list(model.names)[1:] == ["Y", "delta", "A", "C"]
    m_y, m_d, m_a, m_c = rng.uniform(2.0, 60.0, size=4)
    r_d, r_a, z_c = rng.uniform(0.02, 0.3, size=3)
    model.inertias[1] = body(m_y, [0.1, 0.2, 0.3], random_tensor(rng))
    model.inertias[2] = body(m_d, [0.0, 0.0, r_d], random_tensor(rng))
    model.inertias[3] = body(m_a, [0.0, 0.0, -r_a], random_tensor(rng))
    model.inertias[4] = body(m_c, [0.0, 0.0, -z_c], symmetric_tensor(rng))
    rotor = rng.uniform(0.1, 5.0)
    model.armature = np.array([rotor, 0.0, 0.0, 0.0])
    q, v, a = states(model, rng)
    tau = pin.rnea(model, model.createData(), q, v, a)

    p = rig_parameters(model)
    q_d, q_a = q[1], q[2]
    v_d, a_d = v[1], a[1]
    q_abs, v_abs, a_abs = q_d + q_a, v_d + v[2], a_d + a[2]  # q_A' = q_delta + q_A
    d_y = p["mu"] * (v_d**2 * np.sin(q_d) - a_d * np.cos(q_d)) + p["rho"] * (
        a_abs * np.cos(q_abs) - v_abs**2 * np.sin(q_abs)
    )
    d_delta = (
        p["lambda"] * (-a_abs * np.cos(q_a) + v_abs**2 * np.sin(q_a))
        - p["mu"] * a[0] * np.cos(q_d)
        - p["phi"] * np.sin(q_d)
    )
    d_a = (
        p["lambda"] * (-a_d * np.cos(q_a) - v_d**2 * np.sin(q_a))
        + p["rho"] * a[0] * np.cos(q_abs)
        + p["psi"] * np.sin(q_abs)
    )
    u_y = (p["m_Y"] + rotor) * a[0] + d_y
    u_a = p["I_A"] * a_abs + d_a
    # Second line of 5.4: the flexure transmits -(c v + k q), which is the link's inertial effort
    # plus the motor's reaction; RNEA's second row is exactly that.
    transmitted = p["I_delta"] * a_d + d_delta + u_a
    u_c = model.inertias[4].inertia[2, 2] * a[3]
    agree(tau, np.array([u_y, transmitted, u_a, u_c]))


def test_flexure_rig_has_the_parameters_of_table_7_1(urdf_dir: Path) -> None:
    p = rig_parameters(load(urdf_dir, "flexure_rig"))
    published = {"m_Y": 55.7, "mu": 11.8, "rho": 0.886, "I_A": 0.124, "lambda": 0.257}
    for name, value in published.items():
        assert p[name] == pytest.approx(value, rel=3e-3), name
    assert p["I_delta"] == pytest.approx(3.754, rel=1e-3)
    assert p["psi"] == pytest.approx(8.47, rel=0.03)  # the published one is 2.5 % below rho g


def frequencies(mass: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    return np.sqrt(np.clip(scipy.linalg.eigh(stiffness, mass, eigvals_only=True), 0, None)) / (2 * np.pi)


def test_flexure_rig_modes_of_the_linear_part_of_eq_5_4(urdf_dir: Path) -> None:
    """Tap test of Appendix A: 20 Hz with the linear motor held, 34.6 Hz without."""
    p = rig_parameters(load(urdf_dir, "flexure_rig"))
    flexure = yaml.safe_load((urdf_dir / "flexure_rig/machine.yaml").read_text())["passive"]["delta"]
    k, c = flexure["stiffness"], flexure["damping"]
    held = np.sqrt(k / p["I_delta"]) / (2 * np.pi)
    mass = np.array([[p["m_Y"], -p["mu"]], [-p["mu"], p["I_delta"]]])
    free = frequencies(mass, np.diag([0.0, k]))
    assert held == pytest.approx(20.0, rel=2e-3)
    assert free[1] == pytest.approx(34.6, rel=2e-3)
    assert c / (2 * np.sqrt(k * p["I_delta"])) == pytest.approx(0.05, rel=0.01)


def test_flexure_rig_modes_of_the_whole_tree_with_the_tilting_axis_clamped(urdf_dir: Path) -> None:
    """The table's small coupling moves the modes by a few per cent with its tilt, no more."""
    model = load(urdf_dir, "flexure_rig")
    data = model.createData()
    k = yaml.safe_load((urdf_dir / "flexure_rig/machine.yaml").read_text())["passive"]["delta"]["stiffness"]
    for tilt in np.radians([0.0, 32.0, 73.0, 90.0]):
        mass = pin.crba(model, data, np.array([0.0, 0.0, tilt, 0.0]))[:2, :2]
        held = np.sqrt(k / mass[1, 1]) / (2 * np.pi)
        free = frequencies(mass, np.diag([0.0, k]))[1]
        assert held == pytest.approx(20.0, rel=0.06)
        assert free == pytest.approx(34.6, rel=0.05)
