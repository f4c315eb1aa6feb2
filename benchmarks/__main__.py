"""``make benchmarks``: every benchmark in turn, each with its peers in the same run.

python -m benchmarks                      # all of them; one that fails does not keep the others from running
python -m benchmarks loop kr300           # these
python -m benchmarks imu_chain --runs 4   # one, with its own options
python -m benchmarks evidence PART        # measure figures of README and docs again
python -m benchmarks gate                 # questions that the diagnosis must not get wrong
python -m benchmarks train rows CASES OUT # evidence of known changes; then: train fit OUT --out WEIGHTS
python -m benchmarks real                 # recordings of real machines, an effect withheld from the model
python -m benchmarks three                # three changes of a machine at once
"""

from __future__ import annotations

import importlib
import sys
import traceback
from pathlib import Path

HERE = Path(__file__).parent


def main() -> int:
    """Run what is named, or everything; return 1 if any of it failed."""
    known = sorted(p.stem for p in HERE.glob("*.py") if not p.stem.startswith("_"))
    words = sys.argv[1:]
    if words[:1] == ["evidence"]:
        return int(importlib.import_module("benchmarks.evidence").main(words[1:]) or 0)
    if words[:1] in (["gate"], ["real"], ["three"]):
        return int(importlib.import_module("benchmarks.questions.__main__").main(words))
    if words[:1] == ["train"]:
        return int(importlib.import_module("benchmarks.train.__main__").main(words[1:]) or 0)
    named = [word for word in words if word in known]
    if words and not named:
        sys.exit(f"no benchmark {words[0]!r}; there are evidence, gate, real, three, {', '.join(known)}")
    sys.argv[1:] = [word for word in words if word not in known]
    failed = []
    for name in named or known:
        print(f"\n=== {name}", flush=True)
        try:
            importlib.import_module(f"benchmarks.{name}").main()
        except Exception:  # noqa: BLE001 - said, and the next one is run
            traceback.print_exc()
            failed.append(name)
    if failed:
        print(f"\nfailed: {', '.join(failed)}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
