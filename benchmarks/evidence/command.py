"""``python -m benchmarks evidence [PART...]``."""

from __future__ import annotations

import argparse
import importlib
import inspect
import json
import os
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.evidence import store

HERE = Path(__file__).parent
NOT_PARTS = (
    *("__init__", "answers", "asking", "command", "counts", "store", "real", "virtual"),
    *("limits", "public", "spoilt"),  # those of `diagnosis`
)


def parts() -> list[str]:
    """Return the parts, those that need minutes last."""
    found = sorted(p.stem for p in HERE.glob("*.py") if p.stem not in NOT_PARTS)
    return sorted(found, key=lambda name: bool(getattr(_module(name), "SLOW", False)))


def _module(part: str):  # type: ignore[no-untyped-def]
    return importlib.import_module(f"benchmarks.evidence.{part}")


def main(words: Sequence[str] | None = None) -> int:
    """Measure parts, or take in what was measured elsewhere."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    parser = argparse.ArgumentParser(prog="python -m benchmarks evidence", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"all of them: {', '.join(parts())}")
    parser.add_argument("--list", action="store_true", help="say what there is, and of which day")
    parser.add_argument("--add", nargs=2, metavar=("PART", "FILE"), help="figures measured elsewhere, JSON")
    parser.add_argument("--what", help="with --add: what was measured, in words")
    parser.add_argument("--command", help="with --add: what was run")
    parser.add_argument("--seeds", help="with --add: which seeds, none of them looked at before")
    args = parser.parse_args(words)
    if args.list:
        kept = store.read()
        for name in sorted({*parts(), *kept}):
            print(f"{name:<14} {kept[name]['date'] if name in kept else 'never measured'}")
        return 0
    if args.add:
        return _add(args, parser)
    unknown = [name for name in args.parts if name not in parts()]
    if unknown:
        parser.error(f"no part {unknown[0]!r}; there are {', '.join(parts())}")
    failed = [name for name in args.parts or parts() if not _measure(name)]
    if failed:
        print(f"not measured: {', '.join(failed)}")
    return 1 if failed else 0


def _measure(name: str) -> bool:
    """Measure one part and keep it; False if its data are not at hand."""
    module, start = _module(name), time.monotonic()
    print(f"\n=== {name}", flush=True)
    try:
        figures = module.figures()
    except FileNotFoundError as error:
        print(f"left as it was: {error}")
        return False
    for figure in figures:
        print(f"{figure.name:<28}{figure.value:>12.4g} {figure.unit:<6} {figure.what}")
    store.keep(
        name,
        inspect.cleandoc(module.__doc__ or ""),
        figures,
        command=f"python -m benchmarks evidence {name}",
        seeds=module.SEEDS,
        seconds=time.monotonic() - start,
    )
    return True


def _add(args: argparse.Namespace, parser: argparse.ArgumentParser) -> int:
    """Take in figures from a JSON list of the fields of :class:`store.Figure`."""
    if not (args.what and args.command and args.seeds):
        parser.error("--add needs --what, --command and --seeds")
    part, file = args.add
    figures = [store.Figure(**row) for row in json.loads(Path(file).read_text(encoding="utf-8"))]
    store.keep(part, args.what, figures, command=args.command, seeds=args.seeds)
    return 0
