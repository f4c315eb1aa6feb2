"""KR300 A of Weigand et al. (2021): plant and loops from the first 60 % of a log, judged on the rest.

Run: python -m benchmarks kr300. It does not work, and this says by how much and why: 10 s of a robot whose
controller feeds a whole rigid-body model forward, which loops of one axis each cannot hold. Nor could
another law be told from this log: nearly all of the power of the tracking error lies below 0.2 Hz, two periods
of it, so that a law of three numbers (velocity, acceleration, a constant) fitted to the first part fails on the
rest, which it fits well with three others.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np

import pinotwin as pt
from pinotwin.analysis.disturbance import generalised_disturbance
from pinotwin.arrays import Floats
from pinotwin.columns import bind
from pinotwin.errors import DataError
from pinotwin.identification.loop_parts import errors, loop_data

ROOT = Path(__file__).resolve().parents[1]
LOG = Path("kuka_kr300") / "FF_A_08ms.mat"


def figures(folder: Path) -> tuple[dict[str, dict[str, float]], str]:
    """Return RMS error over RMS of e and u on the part held back, and how the simulation went.

    The errors are along the measured motion; the simulation runs from the command alone.
    """
    machine = pt.Machine.load(ROOT / "examples" / "machines" / "kr300")
    log = pt.read(folder / LOG)
    cut = int(0.6 * len(log))
    twin = pt.identify(machine, log.rows(slice(0, cut)))
    rest = log.rows(slice(cut, None))
    motion = pt.prepare(machine, rest)
    disturbance = generalised_disturbance(twin, motion, twin.diagonal)
    found = {a: errors(loop_data(motion, disturbance, a), twin.loops[a]) for a in twin.loops}
    try:
        twin.simulate(rest)
    except DataError as error:
        return found, str(error)
    return found, "the simulation runs through"


def slowness(folder: Path) -> dict[str, tuple[float, float, float, float]]:
    """Return what the tracking error of axes 1 to 3 at the link encoder, which closes their loops, tells.

    Share of its power below 0.2 Hz; what a law of three numbers from the first part leaves of it there, and
    of the rest; and what the same law leaves of the rest with numbers of its own. Shares of the RMS.
    """
    machine = pt.Machine.load(ROOT / "examples" / "machines" / "kr300")
    log = bind(pt.read(folder / LOG), machine.columns)
    step, cut = float(np.median(np.diff(log.t))), int(0.6 * len(log))
    found = {}
    for a in ("A1", "A2", "A3"):
        e = log[f"{a}.qr"] - log[f"{a}.ql"]
        power = np.abs(np.fft.rfft(e * np.hanning(len(e)))) ** 2
        slow = np.fft.rfftfreq(len(e), step) <= 0.2
        v = np.gradient(log[f"{a}.qr"], step)
        X = np.column_stack([v, np.gradient(v, step), np.ones(len(v))])
        first, last = slice(0, cut), slice(cut, None)
        left = [_left(X, e, fitted, asked) for fitted, asked in ((first, first), (first, last), (last, last))]
        found[a] = (float(power[slow].sum() / power.sum()), left[0], left[1], left[2])
    return found


def _left(X: Floats, e: Floats, fitted: slice, asked: slice) -> float:
    """Return what a law fitted to some rows leaves of others, over their RMS."""
    law = np.linalg.lstsq(X[fitted], e[fitted], rcond=None)[0]
    return float(np.linalg.norm(e[asked] - X[asked] @ law) / np.linalg.norm(e[asked]))


def main() -> None:
    """Print the table."""
    folder = Path(os.environ.get("PINOTWIN_DATA", ROOT.parent / "shared" / "data"))
    if not (folder / LOG).is_file():
        print("the KR300's recording is not at hand ($PINOTWIN_DATA)")
        return
    start = time.perf_counter()
    table, simulated = figures(folder)
    print("along the measured motion, held back: RMS error over RMS\naxis      e        u")
    for axis, row in table.items():
        print(f"{axis}  {row['e']:8.1%} {row['u']:8.1%}")
    print("e at the link: power below 0.2 Hz; law of the first part there, on the rest; law of the rest")
    for axis, told in slowness(folder).items():
        print(axis, *(f"{x:8.1%}" for x in told))
    print(f"from the command alone: {simulated}\n{time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main()
