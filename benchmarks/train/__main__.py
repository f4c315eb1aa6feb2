"""``python -m benchmarks train rows CASES OUT``, then ``python -m benchmarks train fit OUT --out WEIGHTS.json``.

``rows CASES OUT --short`` asks twins of one short log, mostly of healthy motions.
``python -m benchmarks train limits CASES`` asks whether the least changes that are stated are found.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from benchmarks.train import fit, limits, rows


def main(words: Sequence[str]) -> None:
    """Make rows of cases, or train on rows."""
    steps = {"rows": rows.main, "fit": fit.main, "limits": limits.main}
    if not words or words[0] not in steps:
        sys.exit(__doc__)
    steps[words[0]](words[1:])


if __name__ == "__main__":
    main(sys.argv[1:])
