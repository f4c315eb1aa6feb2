"""Random drives and logs: never an unstable loop, never an exception. What is refused is counted.

    python -m benchmarks stability --count 500 --first 1000

The suite asks the first 20 (tests/test_loop_property.py).
"""

from __future__ import annotations

import argparse
from collections import Counter

from tests.random_drives import asked


def main() -> None:
    """Print what became of every case that went wrong, and the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--first", type=int, default=1000, help="seed of the first")
    args = parser.parse_args()
    ends: Counter[str] = Counter()
    for seed in range(args.first, args.first + args.count):
        answer = asked(seed)
        ends[answer.end] += 1
        if answer.wrong:
            print(f"{seed} {answer.how}: {answer.wrong}", flush=True)
    print(f"{args.count} logs: " + ", ".join(f"{n} {end}" for end, n in ends.most_common()))


if __name__ == "__main__":
    main()
