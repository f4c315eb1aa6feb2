"""The diagnosis of change and of structure, on machines and recordings that are not its own, beside what it must reach.

Faults of known kind, axis and size in real recordings and on machines of another simulator; all through the public
commands: the scores are those of `score.py` and `real.py` beside the recordings (`$PINOTWIN_DATA/../foreign`). The
table with what each figure must reach is in diagnose.md. Parts of it, other seeds and sizes:

    python -m benchmarks.evidence.diagnosis speed healthy --seed 700 --machines 4 --out out/evidence

Random machines are `random:SEED` and those after it, faults of recordings are drawn from SEED: take one that nobody
looked at. An answer once given by the same code is kept in the folder: a run that was cut off goes on where it stopped.
"""

from __future__ import annotations

import argparse
import datetime
import json
import math
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.evidence.store import Figure
from pinotwin.bench.elsewhere import Elsewhere
from pinotwin.bench.fingerprint import fingerprint
from pinotwin.bench.statistics import calibration
from pinotwin.writing import write_text

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "diagnose.md"
BEGIN, END = "<!-- measured -->", "<!-- end of measured -->"
OUTSIDE = ("hum", "speed_ripple")
"""Kinds of the other simulator that nobody's catalogue holds."""

Row = dict[str, Any]


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


@dataclass
class Runs:
    """Asks, and keeps the answers.

    Attributes:
        at: scripts and recordings.
        out: folder.
        seed: of the first machine. machines: how many.
    """

    at: Elsewhere
    out: Path
    seed: int
    machines: int

    @property
    def seeds(self) -> str:
        """The seeds as the scripts take them."""
        return f"{self.seed}:{self.seed + self.machines}"

    def score(self, script: str, *words: str) -> list[Row]:
        """Return the rows that a script of the other simulator or of the recordings writes."""
        folder = self.out / script.removesuffix(".py")
        key = "-".join(words).replace("--", "").replace(":", "_").replace(",", "+")
        kept = self.out / f"{fingerprint()}-{script.removesuffix('.py')}-{key}.jsonl"
        if not kept.is_file():
            print(f"$ {script} {' '.join(words)}", flush=True)
            (folder / "scores.jsonl").unlink(missing_ok=True)
            exe = Path(sys.executable).parent / "pinotwin"
            command = [sys.executable, str(self.at.scripts / script), *words, "--out", str(folder)]
            command += ["--exe", str(exe), "--jobs", "2"]
            if script == "real.py":
                command += ["--data", str(self.at.data)]
            subprocess.run(command, check=True)
            write_text(kept, (folder / "scores.jsonl").read_text(encoding="utf-8"))
        return [json.loads(line) for line in kept.read_text(encoding="utf-8").splitlines()]

    def effects(self, row: Row) -> list[Row]:
        """Return the effects of the diagnosis behind a row."""
        if "set" in row:
            folder = self.out / "real" / f"{row['set']}-{row['case']}"
        else:
            where = next((self.out / "score").glob(f"*-{row['kind']}-{row['seed']}"))
            folder = next(where.glob("diagnosis-*"))
        file = folder / "diagnosis.json"
        effects: list[Row] = json.loads(file.read_text(encoding="utf-8"))["effects"] if file.is_file() else []
        return effects


def _share(
    what: str, flags: Sequence[bool], must: float, aim: float, command: str, *, least: bool = True
) -> Line:
    hits, of = sum(map(bool, flags)), len(flags)
    return Line(what, hits / of if of else math.nan, must, aim, least, f"{hits} of {of}", command)


def real_healthy(runs: Runs) -> list[Line]:
    """Real machines, nothing changed."""
    rows = runs.score("real.py", "healthy")
    return [_share("real, healthy: `none`", [r["right"] for r in rows], 1.0, 1.0, "real.py healthy")]


def real_faults(runs: Runs) -> list[Line]:
    """Known faults in real logs."""
    seeds = f"{runs.seed}:{runs.seed + max(1, runs.machines // 2)}"
    rows = runs.score("real.py", "faults", "--seeds", seeds)
    command = f"real.py faults --seeds {seeds}"
    return [
        _share("real, known faults: first name and axis", [r["right"] for r in rows], 0.85, 0.95, command)
    ]


def healthy(runs: Runs) -> list[Line]:
    """Another simulator's machines, nothing missing and nothing changed."""
    rows = runs.score("score.py", "healthy", "--seeds", runs.seeds)
    command = f"score.py healthy --seeds {runs.seeds}"
    return [
        _share("foreign, healthy: named", [not r["unnamed"] for r in rows], 0.05, 0.0, command, least=False),
        _share(
            "foreign, healthy: not `none`", [not r["silent"] for r in rows], 0.1, 0.05, command, least=False
        ),
    ]


def diagnose(runs: Runs) -> list[Line]:
    """Another simulator's machines, 22 kinds."""
    rows = runs.score("score.py", "diagnose", "--seeds", runs.seeds)
    inside, outside = ([r for r in rows if (r["kind"] in OUTSIDE) is x] for x in (False, True))
    command = f"score.py diagnose --seeds {runs.seeds}"
    return [
        _share(
            "foreign, 20 kinds: first name and axis", [r["axis_right"] for r in inside], 0.85, 0.92, command
        ),
        _share("foreign: an extra name", [r["extras"] > 0 for r in inside], 0.15, 0.05, command, least=False),
        _share("foreign: outside the catalogue recognised", [r["first"] for r in outside], 0.8, 0.9, command),
    ]


def named_machines(runs: Runs) -> list[Line]:
    """The trunnion and the driller of the other simulator."""
    seeds = f"{runs.seed}:{runs.seed + 1}"
    out = []
    for machine in ("trunnion", "driller"):
        rows = runs.score("score.py", "diagnose", "--machine", machine, "--seeds", seeds)
        right = [r["axis_right"] for r in rows]
        command = f"score.py diagnose --machine {machine} --seeds {seeds}"
        out.append(_share(f"MuJoCo {machine}: first name and axis, 22 kinds", right, 0.9, 0.95, command))
    return out


def stated(runs: Runs) -> list[Line]:
    """What the same answers stated: confidence, and the shrink that the fit promised."""
    rows = runs.score("score.py", "diagnose", "--seeds", runs.seeds)
    seeds = f"{runs.seed}:{runs.seed + max(1, runs.machines // 2)}"
    real = runs.score("real.py", "faults", "--seeds", seeds)
    named = [
        (r["named"][0][2], bool(r.get("axis_right", r.get("right")))) for r in [*rows, *real] if r["named"]
    ]
    found = calibration([p for p, _ in named], [x for _, x in named])
    off = []
    for row in [*rows, *real]:
        if row["named"] and row.get("axis_right", row.get("right")):
            shrink = runs.effects(row)[0]["shrink"].get("u")
            if shrink is not None:
                off.append(abs(shrink["promised"] - shrink["share"]))
    median = sorted(off)[len(off) // 2] if off else math.nan
    error = math.nan if found is None else found.error
    command = "both of the above"
    return [
        Line(
            "calibration error, foreign and real", error, 0.1, 0.05, False, f"{len(named)} answers", command
        ),
        Line(
            "promised less delivered shrink, median",
            median,
            0.07,
            0.03,
            False,
            f"{len(off)} answers",
            command,
        ),
    ]


def payload(runs: Runs) -> list[Line]:
    """A kilogram at the last link of two real robots."""
    seeds = f"{runs.seed}:{runs.seed + 1}"
    words = ("faults", "--kinds", "payload", "--sets", "lwr4,panda", "--seeds", seeds)
    good, told = [], []
    for row in runs.score("real.py", *words):
        first = next(iter(runs.effects(row)), None)
        mass = next((s for s in (first or {}).get("sizes", ()) if s["unit"] == "kg"), None)
        low, high = mass["interval90"] if mass else (math.nan, math.nan)
        value = mass["after"] if mass else math.nan
        good.append(bool(row["right"]) and 0.9 <= value <= 1.1 and low <= 1.0 <= high)
        told.append(f"{row['set']} {value:.3f} ({low:.3f} to {high:.3f}) kg")
    what = f"1 kg at the last link: named, 0.9 to 1.1 kg, within the interval ({'; '.join(told)})"
    return [_share(what, good, 1.0, 1.0, f"real.py {' '.join(words)}")]


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
    subprocess.run(
        [str(exe), "blind", *words, "--no-real", "--out", str(folder)], check=True, stdout=subprocess.DEVNULL
    )
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


PARTS: Mapping[str, Callable[[Runs], list[Line]]] = {
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


def table(figures: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """Return the table of docs/diagnose.md.

    Args:
        figures: part -> its figures, each with date, seed and number of machines.
    """
    lines = [
        "| what | measured | counts | must | aim | reached | command | date |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for part in PARTS:
        for raw in figures.get(part, ()):
            f = Line(**{k: raw[k] for k in Line.__dataclass_fields__})
            sign = "≥" if f.least else "≤"
            lines.append(
                f"| {f.what} | {f.value:.3g} | {f.counts} | {sign} {f.must:g} | {sign} {f.aim:g} | {f.state} "
                f"| `{f.command}` | {raw['date']} |"
            )
    return "\n".join(lines)


def write_page(page: Path, text: str) -> None:
    """Put the table between its two marks on the page."""
    whole = page.read_text(encoding="utf-8")
    pattern = re.escape(BEGIN) + ".*?" + re.escape(END)
    if not re.search(pattern, whole, re.S):
        raise ValueError(f"{page}: no {BEGIN} ... {END}")
    write_text(page, re.sub(pattern, lambda _: f"{BEGIN}\n{text}\n{END}", whole, flags=re.S))


def main() -> None:
    """Measure what is asked for and write the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.evidence.diagnosis", description=__doc__)
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
    args = parser.parse_args()
    unknown = [p for p in args.parts if p not in PARTS]
    if unknown:
        parser.error(f"no part {unknown[0]!r}; there are {', '.join(PARTS)}")
    try:
        measured(args.parts or list(PARTS), args.seed, args.machines, Path(args.out), args.data)
    except FileNotFoundError as error:
        sys.exit(str(error))


def measured(
    parts: Sequence[str], seed: int, machines: int, out: Path, data: str | None = None
) -> dict[str, list[Row]]:
    """Measure parts, write the table, and return all lines that the folder knows, by part.

    Args:
        parts: names of :data:`PARTS`.
        seed: first one.
        machines: how many random machines.
        out: answers are kept here.
        data: recordings; ``$PINOTWIN_DATA`` unless given.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    out = out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    at = Elsewhere.at_hand(out / "cases", data)
    if at is None:
        raise FileNotFoundError("recordings and the scripts beside them are not at hand: set PINOTWIN_DATA")
    runs, kept = Runs(at, out, seed, machines), out / "figures.json"
    lines: dict[str, list[Row]] = json.loads(kept.read_text(encoding="utf-8")) if kept.is_file() else {}
    for part in parts:
        start = time.monotonic()
        stamp = {"date": datetime.datetime.now(datetime.UTC).date().isoformat(), "code": fingerprint()}
        lines[part] = [{**vars(f), **stamp} for f in PARTS[part](runs)]
        write_text(kept, json.dumps(lines, indent=1))
        write_page(PAGE, table(lines))
        for f in lines[part]:
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
    lines = measured(list(PARTS), SEED, MACHINES, ROOT / "out" / "evidence")
    out = []
    for part in PARTS:
        for k, f in enumerate(lines[part]):
            if math.isfinite(f["value"]):
                bound = f"{'at least' if f['least'] else 'at most'} {f['must']:g}, aim {f['aim']:g}; {f['counts']}"
                out.append(Figure(f"{part}{k or ''}", f["what"], f["value"], unit="", note=bound))
    return out


if __name__ == "__main__":
    main()
