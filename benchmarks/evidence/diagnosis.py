"""The diagnosis of change and of structure, on machines and recordings that are not its own, beside what it must reach.

Faults of known kind, axis and size in real recordings and on machines of another simulator; all through the public
commands: the scores are those of `score.py` and `real.py` beside the recordings (`$PINOTWIN_DATA/../foreign`). Seeds
that nobody had looked at, asked once; beside each figure stands what it must reach.
"""

from __future__ import annotations

import argparse
import datetime
import inspect
import json
import math
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.evidence import store
from benchmarks.evidence.answers import Answers, Given, Row, Runs, Source, effects
from benchmarks.evidence.store import Figure, Kind
from pinotwin.bench.statistics import calibration
from pinotwin.system.writing import write_text

ROOT = Path(__file__).resolve().parents[2]
OUTSIDE = ("hum", "speed_ripple")
"""Kinds of the other simulator that nobody's catalogue holds."""


@dataclass(frozen=True)
class Line:
    """One line of the table.

    Attributes:
        what: in words.
        value: the figure; NaN where nothing was asked.
        must: largest value that is enough, smallest if ``least``. aim: the same of what should hold.
        least: whether larger is better.
        counts: what is behind it, such as ``37 of 40``.
        command: that gave it.
    """

    what: str
    value: float
    must: float
    aim: float
    least: bool
    counts: str
    command: str

    @property
    def state(self) -> str:
        """``aim``, ``must``, ``MISSED`` or a dash."""
        if not math.isfinite(self.value):
            return "-"
        good = (lambda bound: self.value >= bound) if self.least else (lambda bound: self.value <= bound)
        return "aim" if good(self.aim) else "must" if good(self.must) else "**MISSED**"


def share(
    what: str, flags: Sequence[bool], must: float, aim: float, command: str, *, least: bool = True
) -> Line:
    """Return a line that counts: how many flags are set, of how many."""
    hits, of = sum(map(bool, flags)), len(flags)
    return Line(what, hits / of if of else math.nan, must, aim, least, f"{hits} of {of}", command)


def real_healthy(runs: Source) -> list[Line]:
    """Real machines, nothing changed."""
    told = runs.score("real.py", "healthy")
    return [share("real, healthy: `none`", [r["right"] for r in told.rows], 1.0, 1.0, told.command)]


def real_faults(runs: Source) -> list[Line]:
    """Known faults in real logs."""
    told = _real_faults(runs)
    right = [r["right"] for r in told.rows]
    return [share("real, known faults: first name and axis", right, 0.85, 0.95, told.command)]


def _real_faults(runs: Source) -> Answers:
    seeds = f"{runs.seed}:{runs.seed + max(1, runs.machines // 2)}"
    return runs.score("real.py", "faults", "--seeds", seeds)


def healthy(runs: Source) -> list[Line]:
    """Another simulator's machines, nothing missing and nothing changed."""
    told = runs.score("score.py", "healthy", "--seeds", runs.seeds)
    rows, command = told.rows, told.command
    return [
        share(
            "other simulator, healthy: a cause named",
            [not r["unnamed"] for r in rows],
            0.05,
            0.0,
            command,
            least=False,
        ),
        share(
            "other simulator, healthy: not `none`",
            [not r["silent"] for r in rows],
            0.1,
            0.05,
            command,
            least=False,
        ),
    ]


def diagnose(runs: Source) -> list[Line]:
    """Another simulator's machines, 22 kinds."""
    told = runs.score("score.py", "diagnose", "--seeds", runs.seeds)
    rows, command = told.rows, told.command
    inside, outside = ([r for r in rows if (r["kind"] in OUTSIDE) is x] for x in (False, True))
    return [
        share(
            "other simulator, 20 kinds: first name and axis",
            [r["axis_right"] for r in inside],
            0.85,
            0.92,
            command,
        ),
        share(
            "other simulator: an extra name",
            [r["extras"] > 0 for r in inside],
            0.15,
            0.05,
            command,
            least=False,
        ),
        share(
            "other simulator: outside the catalogue recognised",
            [r["first"] for r in outside],
            0.8,
            0.9,
            command,
        ),
    ]


def named_machines(runs: Source) -> list[Line]:
    """The trunnion and the driller of the other simulator."""
    seeds = f"{runs.seed}:{runs.seed + 1}"
    out = []
    for machine in ("trunnion", "driller"):
        told = runs.score("score.py", "diagnose", "--machine", machine, "--seeds", seeds)
        right = [r["axis_right"] for r in told.rows]
        out.append(share(f"MuJoCo {machine}: first name and axis, 22 kinds", right, 0.9, 0.95, told.command))
    return out


def stated(runs: Source) -> list[Line]:
    """What the same answers stated: confidence, and the shrink that the fit promised."""
    told = [runs.score("score.py", "diagnose", "--seeds", runs.seeds), _real_faults(runs)]
    rows = [row for answers in told for row in answers.rows]
    named = [(r["named"][0][2], bool(r.get("axis_right", r.get("right")))) for r in rows if r["named"]]
    found = calibration([p for p, _ in named], [x for _, x in named])
    off = []
    for row in rows:
        if row["named"] and row.get("axis_right", row.get("right")):
            shrink = effects(row)[0]["shrink"].get("u")
            if shrink is not None:
                off.append(abs(shrink["promised"] - shrink["share"]))
    median = sorted(off)[len(off) // 2] if off else math.nan
    error = math.nan if found is None else found.error
    command = ", ".join(answers.command for answers in told if answers.rows)
    return [
        Line(
            "calibration error, other simulator and real",
            error,
            0.1,
            0.05,
            False,
            f"{len(named)} answers",
            command,
        ),
        Line(
            "variance explained, expected less achieved, median",
            median,
            0.07,
            0.03,
            False,
            f"{len(off)} answers",
            command,
        ),
    ]


def payload(runs: Source) -> list[Line]:
    """A kilogram at the last link of two real robots."""
    seeds = f"{runs.seed}:{runs.seed + 1}"
    words = ("faults", "--kinds", "payload", "--sets", "lwr4,panda", "--seeds", seeds)
    good, told = [], []
    asked = runs.score("real.py", *words)
    for row in asked.rows:
        first = next(iter(effects(row)), None)
        mass = next((s for s in (first or {}).get("sizes", ()) if s["unit"] == "kg"), None)
        low, high = mass["interval90"] if mass else (math.nan, math.nan)
        value = mass["after"] if mass else math.nan
        good.append(bool(row["right"]) and 0.9 <= value <= 1.1 and low <= 1.0 <= high)
        told.append(f"{row['set']} {value:.3f} ({low:.3f} to {high:.3f}) kg")
    what = (
        f"1 kg at the last link: named, 0.9 to 1.1 kg, within the interval ({'; '.join(dict.fromkeys(told))})"
    )
    return [share(what, good, 1.0, 1.0, asked.command)]


def bench(runs: Runs) -> list[Line]:
    """The project's own bench, on random machines of the same seeds."""
    names = [f"random:{runs.seed + k}" for k in range(runs.machines)]
    words = [
        "--seeds",
        "1",
        "--seed",
        str(runs.seed),
        "--machines",
        "trunnion",
        "laser_driller",
        "emps",
        *names,
    ]
    folder = runs.out / "bench"
    exe = Path(sys.executable).parent / "pinotwin"
    subprocess.run([str(exe), "blind", *words, "--out", str(folder)], check=True, stdout=subprocess.DEVNULL)
    rows = {r["name"]: r for r in json.loads((folder / "bench.json").read_text(encoding="utf-8"))["scores"]}
    said = "pinotwin blind " + " ".join(words)
    wanted = (
        ("healthy machine accused of anything", 0.05, 0.02, False),
        ("both of two, weaker rho ≥ 0.1", 0.65, 0.8, True),
        ("outside the catalogue recognised", 0.75, 0.95, True),
        ("top-1, 0.02 ≤ rho < 0.1", 0.55, 0.75, True),
    )
    out = []
    for name, must, aim, least in wanted:
        row = rows[name]
        value = math.nan if row["value"] is None else float(row["value"])
        counts = f"{row['share']['hits']} of {row['share']['of']}"
        out.append(Line(f"own bench: {name}", value, must, aim, least, counts, said))
    return out


def speed(runs: Runs) -> list[Line]:
    """One diagnosis, alone on the machine."""
    from benchmarks.diagnosis import CASES, timed

    del runs
    out = []
    for name, case in CASES.items():
        seconds = timed(case)
        command = f"python -m benchmarks diagnosis {name}"
        out.append(Line(case.what, seconds, case.must, case.aim, False, "s", command))
    return out


PARTS: Mapping[str, Callable[[Any], list[Line]]] = {
    "speed": speed,
    "real_healthy": real_healthy,
    "payload": payload,
    "healthy": healthy,
    "diagnose": diagnose,
    "real_faults": real_faults,
    "stated": stated,
    "named_machines": named_machines,
    "bench": bench,
}
"""Name -> what measures it, the short ones first."""
GIVEN = ("real_healthy", "payload", "healthy", "diagnose", "real_faults", "stated", "named_machines")
"""Those that only count what the scripts wrote."""


NAMES: Mapping[str, tuple[str, ...]] = {
    "speed": ("seconds_arm", "seconds_five"),
    "real_healthy": ("real_healthy",),
    "payload": ("payload",),
    "healthy": ("foreign_accused", "foreign_not_none"),
    "diagnose": ("foreign", "foreign_extra", "foreign_outside"),
    "real_faults": ("real",),
    "stated": ("calibration", "promised"),
    "named_machines": ("trunnion", "driller"),
    "bench": ("own_accused", "own_pairs", "own_outside", "own_small"),
}
"""Part -> name in figures.json of each of its lines."""
KNOWN = ("seconds_arm", "seconds_five", "real_healthy", "payload")
"""Figures of cases that no seed draws anew: they were looked at while the rules were set."""


def _named(figures: Mapping[str, Sequence[Row]]) -> Iterator[tuple[str, Line, str]]:
    """Yield name, line, and date and commit of what was measured."""
    for part in PARTS:
        for name, raw in zip(NAMES[part], figures.get(part, ()), strict=False):
            line = Line(**{k: raw[k] for k in Line.__dataclass_fields__})
            if math.isfinite(line.value):
                yield name, line, ", ".join(filter(None, (raw["date"], raw.get("commit"))))


def figures_of(lines: Mapping[str, Sequence[Row]]) -> list[Figure]:
    """Return the lines as figures: a share as a count, with what it must be."""
    out = []
    for name, line, date in _named(lines):
        sign = "≥" if line.least else "≤"
        note = f"must {sign} {line.must:g}, aim {sign} {line.aim:g}, reached: {line.state}; {line.command}; {date}"
        hits, _, of = line.counts.partition(" of ")
        value, whole = (float(hits), int(of)) if of else (line.value, None)
        unit = "s" if line.counts == "s" else ""
        kind: Kind = "development" if name in KNOWN else "unseen"
        out.append(
            Figure(name, line.what.removesuffix(" [s]"), value, unit=unit, kind=kind, of=whole, note=note)
        )
    return out


def _checked_out() -> str:
    words = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    return subprocess.run(words, check=False, capture_output=True, text=True).stdout.strip()


def main() -> None:
    """Measure what is asked for; write the part ``diagnosis`` of figures.json.

    python -m benchmarks.evidence.diagnosis speed healthy --seed 700 --machines 4 --out out/evidence
    python -m benchmarks.evidence.diagnosis --scores DIR/scores.jsonl [DIR2/scores.jsonl ...] --commit HASH

    Random machines are `random:SEED` and those after it, faults of recordings are drawn from SEED: take one that
    nobody looked at. An answer once given by the same code is kept in the folder: a run that was cut off goes on where
    it stopped. With --scores the answers that the scripts gave elsewhere are counted, not asked again. Either way the
    file holds the lines that the folder knows.
    """
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.evidence.diagnosis", description=inspect.cleandoc(main.__doc__ or "")
    )
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument(
        "parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; all of them by default"
    )
    parser.add_argument(
        "--seed", type=int, default=SEED, help=f"first seed, one that nobody looked at ({SEED})"
    )
    parser.add_argument("--machines", type=int, default=MACHINES, help=f"random machines ({MACHINES})")
    parser.add_argument("--out", default="out/evidence", help="answers are kept here (out/evidence)")
    parser.add_argument("--data", help="recordings (default $PINOTWIN_DATA)")
    parser.add_argument(
        "--scores", nargs="+", type=Path, metavar="FILE", help="count these answers of score.py and real.py"
    )
    parser.add_argument("--commit", help="that was asked (default: the one that is checked out)")
    args = parser.parse_args()
    unknown = [p for p in args.parts if p not in PARTS]
    if unknown:
        parser.error(f"no part {unknown[0]!r}; there are {', '.join(PARTS)}")
    try:
        if args.scores:
            parts, source = args.parts or list(GIVEN), Given.read(args.scores)
        else:
            parts = args.parts or list(PARTS)
            source = Runs.beside(Path(args.out), args.seed, args.machines, args.data)
        lines = measured(parts, source, Path(args.out), args.commit)
    except (FileNotFoundError, ValueError) as error:
        sys.exit(str(error))
    keep(lines)


def keep(lines: Mapping[str, Sequence[Row]]) -> None:
    """Write the part of figures.json."""
    store.keep(
        "diagnosis",
        inspect.cleandoc(__doc__ or ""),
        figures_of(lines),
        command="python -m benchmarks.evidence.diagnosis",
        seeds="those of the command beside each figure",
    )


def measured(
    parts: Sequence[str], runs: Runs | Given, out: Path, commit: str | None = None
) -> dict[str, list[Row]]:
    """Measure parts and return all lines that the folder knows, by part.

    Args:
        parts: names of :data:`PARTS`.
        runs: who answers.
        out: lines are kept here.
        commit: that answered; the one that is checked out unless given.
    """
    commit = commit or _checked_out()
    out.mkdir(parents=True, exist_ok=True)
    kept = out / "figures.json"
    lines: dict[str, list[Row]] = json.loads(kept.read_text(encoding="utf-8")) if kept.is_file() else {}
    for part in parts:
        start = time.monotonic()
        stamp = {"date": datetime.datetime.now(datetime.UTC).date().isoformat(), "commit": commit}
        found = [{**vars(f), **stamp} for f in PARTS[part](runs)]
        if not any(math.isfinite(f["value"]) for f in found):
            continue  # nobody asked
        lines[part] = found
        write_text(kept, json.dumps(lines, indent=1))
        for f in found:
            print(
                f"{f['what']}: {f['value']:.3g} ({f['counts']})  [{time.monotonic() - start:.0f} s]",
                flush=True,
            )
    return lines


SEED, MACHINES = 760, 5
"""Of `make evidence`: asked once on 2026-11-23 and looked at since. Another version is to be asked on others."""
SEEDS = f"random:{SEED} to random:{SEED + MACHINES - 1}, faults of recordings from {SEED}"
SLOW = True


def figures() -> list[Figure]:
    """Measure all parts; see the module."""
    out = ROOT / "out" / "evidence"
    return figures_of(measured(list(PARTS), Runs.beside(out, SEED, MACHINES), out))


if __name__ == "__main__":
    main()
