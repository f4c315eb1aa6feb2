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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.evidence import asking, counts, store
from benchmarks.evidence.answers import (
    QUESTIONS,
    Answers,
    Given,
    Row,
    Runs,
    Source,
    diagnosis_of,
    documents,
    together,
)
from benchmarks.evidence.counts import HEALTHY, Measured, changed, each, inside
from benchmarks.evidence.limits import limits
from benchmarks.evidence.public import public
from benchmarks.evidence.spoilt import recordings
from benchmarks.evidence.store import Figure, Kind
from pinotwin.system.writing import write_text

ROOT = Path(__file__).resolve().parents[2]
TENTH, KNOB = 0.1, 1.5
"""The other false-alarm setting, and how many times as often a healthy machine may be accused."""


@dataclass(frozen=True)
class Line:
    """One line of the table.

    Attributes:
        what: in words.
        must: smallest value that is enough, largest unless ``least``.
        aim: the same of what should hold; None where nothing more is wanted.
        value: measures it on answers.
        least: whether larger is better.
        unit: of the value; empty for shares and counts.
        most: beyond this a larger value is no better.
    """

    what: str
    must: float
    aim: float | None
    value: Callable[[Sequence[Row]], Measured]
    least: bool = True
    unit: str = ""
    most: float = math.inf

    def state(self, value: float) -> str:
        """Return ``aim``, ``must``, ``MISSED`` or a dash."""
        if not math.isfinite(value):
            return "-"
        if self.aim is not None and self._reaches(value, self.aim):
            return "aim"
        return "must" if self._reaches(value, self.must) else "**MISSED**"

    def _reaches(self, value: float, bound: float) -> bool:
        return bound <= value <= self.most if self.least else value <= bound

    def judged(self, value: float) -> str:
        """Return the bounds, and which of them a value reaches."""
        sign = "≥" if self.least else "≤"
        aim = "" if self.aim is None else f", aim {sign} {self.aim:.3g}"
        aim += "" if math.isinf(self.most) else f", at most {self.most:.3g}"
        return f"must {sign} {self.must:.3g}{aim}, reached: {self.state(value)}"


def at_most(
    what: str, must: float, aim: float | None, value: Callable[[Sequence[Row]], Measured], unit: str = ""
) -> Line:
    """Return a line of which less is better."""
    return Line(what, must, aim, value, False, unit)


@dataclass(frozen=True)
class Part:
    """Lines that are measured on the same answers.

    Attributes:
        about: which machines, in words; begins every line.
        ask: returns the answers.
        lines: name in figures.json -> line.
    """

    about: str
    ask: Callable[[Any], Answers]
    lines: Mapping[str, Line]


def _seeds(runs: Source, machines: int) -> str:
    """Return the seeds of so many machines as the scripts take them."""
    return f"{runs.seed}:{runs.seed + machines}"


def real_healthy(runs: Source) -> Answers:
    """Real machines, nothing changed."""
    return runs.score("real.py", "healthy")


def real_faults(runs: Source) -> Answers:
    """Known faults put into the effort of real logs."""
    return runs.score("real.py", "faults", "--seeds", _seeds(runs, max(1, runs.machines // 2)))


def healthy(runs: Source) -> Answers:
    """Twice as many of another simulator's machines, nothing missing and nothing changed."""
    return runs.score("score.py", "healthy", "--seeds", _seeds(runs, 2 * runs.machines))


def diagnose(runs: Source) -> Answers:
    """Another simulator's machines, 22 kinds."""
    return runs.score("score.py", "diagnose", "--seeds", runs.seeds)


def shop(runs: Source) -> Answers:
    """Machines over days, every kind; the healthy days of twice as many machines."""
    every = runs.score("score.py", "shop", "--seeds", runs.seeds)
    ill = Answers([row for row in every.rows if row["kind"] not in HEALTHY], every.command)
    seeds = _seeds(runs, 2 * runs.machines)
    well = runs.score("score.py", "shop", "--kinds", ",".join(HEALTHY), "--seeds", seeds)
    return together(ill, well)


def stated(runs: Source) -> Answers:
    """All answers that state how sure they are of a name."""
    asked = (real_healthy, healthy, diagnose, real_faults, shop)
    return Answers(together(*(ask(runs) for ask in asked)).rows, "answers above")


def three(runs: Runs) -> Answers:
    """Three changes at once, of machines over days with a second encoder."""
    from benchmarks.questions.three import asked, cases

    seeds = range(runs.seed, runs.seed + 5 * runs.machines)
    rows = [asked(case) for case in cases(runs.at, seeds)]
    return Answers(rows, f"python -m benchmarks three --seeds {seeds.start}:{seeds.stop}")


def bench(runs: Runs) -> Answers:
    """The project's own bench, on random machines of the same seeds."""
    names = [f"random:{runs.seed + k}" for k in range(runs.machines)]
    words = ["--seeds", "1", "--seed", str(runs.seed), "--machines", "trunnion", "laser_driller", "emps"]
    words += names
    folder = runs.out / "bench"
    exe = Path(sys.executable).parent / "pinotwin"
    subprocess.run([str(exe), "blind", *words, "--out", str(folder)], check=True, stdout=subprocess.DEVNULL)
    rows = json.loads((folder / "bench.json").read_text(encoding="utf-8"))["scores"]
    return Answers(rows, f"pinotwin blind {' '.join(words)}")


def tenth(runs: Runs) -> Answers:
    """The healthy days of twice as many machines as ``shop`` asks, at the other false-alarm setting."""
    seeds = _seeds(runs, 2 * runs.machines)
    asked = runs.score("score.py", "shop", "--kinds", ",".join(HEALTHY), "--seeds", seeds)
    days = {f"{row['machine']} {row['kind']}": row for row in asked.rows}

    def ask(question: str) -> Row:
        day, case = days[question], diagnosis_of(days[question]).parent
        words = (*(case / f"{x}.csv" for x in ("train", "repeat")), "--validate", case / "valid.csv")
        words += ("--false-alarm", str(TENTH))
        found = asking.diagnosed(case.parent / "twin", *words, out=case / f"diagnosis-{TENTH:g}")
        return {**{k: day[k] for k in ("machine", "seed", "kind")}, **found}

    return Answers(asking.kept(runs.out, "tenth", days, ask), f"{asked.command} --false-alarm {TENTH:g}")


def grades(runs: Source) -> Answers:
    """All diagnoses that lie in the folder of the answers."""
    found = [x for folder in runs.folders for x in documents(folder)]
    return Answers([{"contradicts": counts.contradicts(x)} for x in found], "answers of the other parts")


def speed(runs: Source) -> Answers:
    """One diagnosis, alone on the machine."""
    from benchmarks.diagnosis import CASES, timed

    del runs
    rows = [{"case": name, "seconds": timed(case)} for name, case in CASES.items()]
    return Answers(rows, "python -m benchmarks diagnosis")


PARTS: Mapping[str, Part] = {
    "speed": Part(
        "one diagnosis",
        speed,
        {
            "seconds_arm": at_most("7-axis robot, 25 s at 250 Hz", 10, 5, counts.seconds("arm"), "s"),
            "seconds_five": at_most("five axes, 24 s, two repeats", 25, 12, counts.seconds("five"), "s"),
        },
    ),
    "real_healthy": Part(
        "real, healthy", real_healthy, {"real_healthy": Line("`none`", 1.0, None, each("right"))}
    ),
    "healthy": Part(
        "other simulator, healthy",
        healthy,
        {"foreign_accused": at_most("a cause named", 2 / 40, 0.0, each("named"))},
    ),
    "diagnose": Part(
        "other simulator",
        diagnose,
        {
            "foreign": Line("first name and axis, 20 kinds", 0.86, 0.93, each("axis_right", inside)),
            "foreign_extra": at_most("an extra name", 0.05, None, each("extras", inside)),
            "foreign_outside": Line("unknown ones recognised", 0.85, None, each("first", counts.outside)),
        },
    ),
    "real_faults": Part(
        "real faults, EMPS without command",
        real_faults,
        {"real": Line("first name and axis", 0.88, 0.95, each("right"))},
    ),
    "shop": Part(
        "shop",
        shop,
        {
            "shop_accused": at_most("healthy, accused", 2 / 60, 0.0, counts.accused_days),
            "shop_again": at_most("healthy, accused on two days", 0.0, None, counts.accused_again),
            "shop_first": Line("first name (or class) and axis", 0.86, 0.94, each("first", changed)),
            "shop_extra": at_most("a wrong extra name", 0.10, 0.03, each("wrong_extra", changed)),
            "shop_honest": Line("no open signal passed over", 0.95, 0.99, each("honest", changed)),
            "shop_story": Line("place, time or other axis told", 0.80, 0.92, each("story", counts.storied)),
            "shop_worst": Line("first name and axis, worst of six kinds", 0.75, 0.9, counts.worst_service),
            "shop_astray": at_most("motor or process blamed wrongly", 1 / 40, 0.0, counts.astray),
        },
    ),
    "stated": Part(
        "all answers",
        stated,
        {
            "calibration": at_most("expected calibration error", 0.06, 0.03, counts.calibrated),
            "discrimination": Line("AUC of right against wrong names", 0.85, 0.95, counts.discriminated),
            "promised": at_most("share promised less delivered, median", 0.05, 0.02, counts.kept_promise),
        },
    ),
    "three": Part(
        "three changes at once",
        three,
        {
            "three_worst": Line("named, worst of the three", 0.7, 0.9, counts.worst_of_three),
            "three_false": at_most("a false name first", 0.0, None, counts.false_first),
        },
    ),
    "tenth": Part(
        "shop at --false-alarm 0.1",
        tenth,
        {
            "tenth_accused": at_most("healthy, accused", KNOB * TENTH, 1.2 * TENTH, counts.accused_days),
        },
    ),
    "public": Part(
        "public cases",
        public,
        {
            "public_right": Line("as their README says", 17 / 23, 21 / 23, each("right")),
            "public_first": Line("first name and axis, whatever its number", 17 / 23, 21 / 23, each("first")),
            "public_passed": at_most(
                "wrong, and called `none` or `explained`", 0.0, None, each("passed_over")
            ),
        },
    ),
    "spoilt": Part(
        "recordings at fault, 7 kinds",
        recordings,
        {
            "spoilt_accused": at_most("a cause of the machine named", 2 / 70, 0.0, each("machine_cause")),
            "spoilt_told": Line("the recording named", 0.85, 0.95, each("recorded")),
        },
    ),
    "limits": Part(
        "causes of the stated 90 % size",
        limits,
        {
            "limits_found": Line("named on their axis", 0.80, None, each("found"), most=0.97),
            "limits_seen": Line("something said to have changed", 0.80, None, each("seen")),
        },
    ),
    "bench": Part(
        "own bench",
        bench,
        {
            "own_first": Line("first name of what an oracle sees", 0.75, 0.9, counts.own(counts.SEEN)),
            "own_pairs": Line("both of two", 0.55, None, counts.own("both of two, weaker rho ≥ 0.1")),
            "own_outside": Line("unknown recognised", 0.75, None, counts.own(counts.UNKNOWN)),
            "own_accused": at_most("healthy, accused", 1 / 26, None, counts.own(counts.ACCUSED)),
        },
    ),
    "grades": Part(
        "all diagnoses in the folder",
        grades,
        {"grades": at_most("verdict against grades or names", 0.0, None, each("contradicts"))},
    ),
}
"""Name -> what is asked, and the lines that are measured on it; the short ones first."""
ASKED = ("speed", "three", "tenth", "public", "spoilt", "limits", "bench")
"""Those that put questions of their own."""
GIVEN = tuple(name for name in PARTS if name not in ASKED)
"""Those that only count what the scripts wrote."""
KNOWN = ("seconds_arm", "seconds_five", "real_healthy", "public_right", "public_first", "public_passed")
"""Figures of cases that no seed draws anew: they were looked at while the rules were set."""


def figures_of(kept: Mapping[str, Row]) -> list[Figure]:
    """Return the measured lines as figures: a share as a count, with what it must be."""
    out, before = list[Figure](), ""
    lines = [(name, part.about, line) for part in PARTS.values() for name, line in part.lines.items()]
    for name, about, line in (x for x in lines if x[0] in kept):
        row = kept[name]
        source = f"{row['command']}; {row['date']}, {row['commit']}"
        said = (line.judged(row["value"]), row["which"], source if source != before else "")
        before = source
        hits, _, of = row["counts"].partition(" of ")
        value, whole = (float(hits), int(of)) if of else (row["value"], None)
        kind: Kind = "development" if name in KNOWN else "unseen"
        note = "; ".join(filter(None, said))
        what = f"{about}: {line.what}"
        out.append(Figure(name, what, value, unit=line.unit, kind=kind, of=whole, note=note))
    return out


def _checked_out() -> str:
    words = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    return subprocess.run(words, check=False, capture_output=True, text=True).stdout.strip()


def main() -> None:
    """Measure what is asked for; write the part ``diagnosis`` of figures.json.

    python -m benchmarks.evidence.diagnosis speed healthy --seed 700 --machines 4 --out out/evidence
    python -m benchmarks.evidence.diagnosis [shop] --scores DIR/scores.jsonl [DIR2/scores.jsonl ...] --commit HASH

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
    parser.add_argument(
        "--questions", type=int, default=QUESTIONS, help=f"about detection limits ({QUESTIONS})"
    )
    parser.add_argument("--out", default="out/evidence", help="answers are kept here (out/evidence)")
    parser.add_argument("--data", help="recordings (default $PINOTWIN_DATA)")
    parser.add_argument(
        "--scores", nargs="+", type=Path, metavar="FILE", help="count these answers of score.py and real.py"
    )
    parser.add_argument("--commit", help="that was asked (default: the one that is checked out)")
    args = parser.parse_args()
    known = GIVEN if args.scores else tuple(PARTS)
    unknown = [p for p in args.parts if p not in known]
    if unknown:
        parser.error(f"no part {unknown[0]!r}; there are {', '.join(known)}")
    out = Path(args.out)
    try:
        source: Runs | Given
        if args.scores:
            source = Given.read(args.scores)
        else:
            source = Runs.beside(out, args.seed, args.machines, args.data, args.questions)
        keep(measured(args.parts or known, source, out, args.commit))
    except (FileNotFoundError, ValueError) as error:
        sys.exit(str(error))


def keep(kept: Mapping[str, Row]) -> None:
    """Write the part of figures.json; a line that was not measured now stays as it was, with its own date."""
    names = {name for part in PARTS.values() for name in part.lines} - kept.keys()
    before = store.read().get("diagnosis", {"figures": {}})["figures"]
    others = [Figure(**{"unit": "", **before[name]}) for name in before if name in names]
    store.keep(
        "diagnosis",
        inspect.cleandoc(__doc__ or ""),
        [*figures_of(kept), *others],
        command="python -m benchmarks.evidence.diagnosis",
        seeds="those of the command beside each figure, or the one above it",
    )


def measured(
    parts: Sequence[str], runs: Runs | Given, out: Path, commit: str | None = None
) -> dict[str, Row]:
    """Measure parts, print their lines, and return all lines that the folder knows, by name.

    Args:
        parts: names of :data:`PARTS`.
        runs: who answers.
        out: lines are kept here.
        commit: that answered; the one that is checked out unless given.
    """
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    stamp = {"date": today, "commit": commit or _checked_out()}
    out.mkdir(parents=True, exist_ok=True)
    file = out / "lines.json"
    kept: dict[str, Row] = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    for part in (PARTS[name] for name in parts):
        told = part.ask(runs)
        for name, line in part.lines.items():
            found = line.value(told.rows)
            if not math.isfinite(found.value):
                continue  # nobody asked
            kept[name] = {**asdict(found), "command": told.command, **stamp}
            behind = ", ".join(filter(None, (found.counts, found.which)))
            said = f"{found.value:.3g} {line.unit or f'({behind})'}; {line.judged(found.value)}"
            print(f"{name:<16}{part.about}: {line.what}: {said}", flush=True)
        write_text(file, json.dumps(kept, indent=1))
    return kept


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
