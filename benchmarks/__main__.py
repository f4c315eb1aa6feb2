"""``make bench``: every benchmark in turn, each with its peers in the same run."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

SLOW = ("blind",)


def main() -> None:
    here = Path(__file__).parent
    names = sys.argv[1:] or [
        p.stem for p in sorted(here.glob("*.py")) if not p.stem.startswith("_") and p.stem not in SLOW
    ]
    for name in names:
        print(f"\n=== {name}")
        importlib.import_module(f"benchmarks.{name}").main()


if __name__ == "__main__":
    main()
