"""Regressor of a whole log against a bare Python loop over Pinocchio, in one run.

    OPENBLAS_NUM_THREADS=1 python benchmarks/regressor.py

Single timings scatter by tens of per cent: each is the best of several, and only ratios count.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin

from pinotwin.dynamics import base_parameters, inverse, regressor

N = 20_000
REPEATS = 7


def laser_driller() -> pin.Model:
    """A five-axis tree: nozzle on X-Y, table on Z-B-C."""
    model = pin.Model()
    model.name = "laser_driller"
    above = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.08]))
    for parent, kind, axis, place in (
        (0, pin.JointModelPrismaticUnaligned, (1, 0, 0), pin.SE3.Identity()),
        (1, pin.JointModelPrismaticUnaligned, (0, 1, 0), pin.SE3.Identity()),
        (0, pin.JointModelPrismaticUnaligned, (0, 0, -1), pin.SE3.Identity()),
        (3, pin.JointModelRevoluteUnaligned, (0, -1, 0), pin.SE3.Identity()),
        (4, pin.JointModelRevoluteUnaligned, (0, 0, -1), above),
    ):
        name = "XYZBC"[model.njoints - 1]
        i = model.addJoint(parent, kind(np.array(axis, dtype=float)), place, name)
        model.appendBodyToJoint(i, pin.Inertia.Random(), pin.SE3.Identity())
    return model


def ur10() -> pin.Model | None:
    """The UR10 of example-robot-data, if that is installed."""
    prefix = Path(pin.__file__).parents[4]
    path = "share/example-robot-data/robots/ur_description/urdf/ur10_robot.urdf"
    if not (prefix / path).exists():
        return None
    model = pin.buildModelFromUrdf(str(prefix / path))
    model.name = "ur10"
    return model


def best(work: Callable[[], object]) -> float:
    """Return the shortest of several times [µs per sample]."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times) / N * 1e6


def compare(model: pin.Model) -> list[tuple[str, float]]:
    """Return the time of every route [µs per sample]; the first is the bare loop."""
    rng = np.random.default_rng(0)
    q, v, a = (rng.uniform(-1.0, 1.0, (N, model.nv)) * s for s in (2.0, 1.5, 5.0))
    data, base = model.createData(), base_parameters(model)

    def loop() -> None:
        for k in range(N):
            pin.computeJointTorqueRegressor(model, data, q[k], v[k], a[k])

    def kept() -> object:
        W = np.empty((N, model.nv, 10 * model.nv))
        for k in range(N):
            W[k] = pin.computeJointTorqueRegressor(model, data, q[k], v[k], a[k])
        return W

    return [
        ("bare loop over Pinocchio", best(loop)),
        ("same, results kept", best(kept)),
        (f"regressor, {len(base)} base columns", best(lambda: base.regressor(model, q, v, a))),
        ("regressor, all columns", best(lambda: regressor(model, q, v, a))),
        ("inverse dynamics", best(lambda: inverse(model, q, v, a))),
    ]


def main() -> None:
    """Print the table."""
    start = time.perf_counter()
    driller = laser_driller()
    zero = np.zeros((1, driller.nv))
    regressor(driller, zero, zero, zero)
    print(f"first call (import of numba, compilation or cache): {time.perf_counter() - start:.2f} s")
    for model in (driller, ur10()):
        if model is None:
            print("ur10: example-robot-data is not installed")
            continue
        rows = compare(model)
        print(f"\n{model.name}, {N} samples    µs/sample   ratio to the bare loop")
        for name, value in rows:
            print(f"  {name:34s} {value:8.3f}   {value / rows[0][1]:6.3f}")


if __name__ == "__main__":
    main()
