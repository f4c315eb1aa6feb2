"""KR300 A of Weigand et al. (2021): plant and loops from the first 60 % of a log, judged on the rest.

Run: python -m benchmarks kr300. It does not work, and this says by how much: 10 s at 125 Hz of a robot whose
controller feeds a whole rigid-body model forward, which loops of one axis each cannot hold.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import pinotwin as pt
from pinotwin.analysis.disturbance import generalised_disturbance
from pinotwin.errors import DataError
from pinotwin.identification.loops import errors, loop_data

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
    print(f"from the command alone: {simulated}\n{time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main()
