"""Who answers for the diagnosis' figures: the scripts beside the recordings, asked now or elsewhere."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from benchmarks.questions.other_machines import Elsewhere
from pinotwin.bench.fingerprint import fingerprint
from pinotwin.system.writing import write_text

Row = dict[str, Any]
QUESTIONS = 100
"""About detection limits."""
FAULTS, COMMANDED = ("real.py", "faults"), "emps"
"""Faults put into the effort alone. The recordings with a command are asked without it: with it such a fault
contradicts the known law of their controller."""


@dataclass(frozen=True)
class Answers:
    """What a script wrote.

    Attributes:
        rows: one a question; ``folder`` is where its diagnosis lies.
        command: how it was called.
    """

    rows: list[Row]
    command: str


def together(*answers: Answers) -> Answers:
    """Return all answers as one."""
    commands = dict.fromkeys(x.command for x in answers if x.rows)
    return Answers([row for x in answers for row in x.rows], ", ".join(commands))


class Source(Protocol):
    """Whoever answers: :class:`Runs` asks, :class:`Given` has been told."""

    seed: int
    machines: int

    @property
    def seeds(self) -> str:
        """The seeds as the scripts take them."""

    @property
    def folders(self) -> list[Path]:
        """Where diagnoses lie."""

    def score(self, script: str, *words: str) -> Answers:
        """Return what a script answers to these words."""


@dataclass
class Runs:
    """Asks, and keeps the answers.

    Attributes:
        at: scripts and recordings.
        out: folder.
        seed: of the first machine. machines: how many.
        questions: about detection limits, on all machines together.
    """

    at: Elsewhere
    out: Path
    seed: int
    machines: int
    questions: int = QUESTIONS

    @classmethod
    def beside(
        cls, out: Path, seed: int, machines: int, data: str | None = None, questions: int = QUESTIONS
    ) -> Runs:
        """Return who asks the scripts beside the recordings; ``$PINOTWIN_DATA`` has these unless ``data`` is given.

        Raises:
            FileNotFoundError: they are not at hand.
        """
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        out = out.resolve()
        at = Elsewhere.at_hand(out / "cases", data)
        if at is None:
            raise FileNotFoundError(
                "recordings and the scripts beside them are not at hand: set PINOTWIN_DATA"
            )
        out.mkdir(parents=True, exist_ok=True)
        return cls(at, out, seed, machines, questions)

    @property
    def seeds(self) -> str:
        """The seeds as the scripts take them."""
        return f"{self.seed}:{self.seed + self.machines}"

    @property
    def cases(self) -> Path:
        """Small cases beside the recordings; the folder may be absent."""
        return self.at.data.parent / "cases"

    @property
    def folders(self) -> list[Path]:
        """Where diagnoses lie."""
        return [self.out]

    def score(self, script: str, *words: str) -> Answers:
        """Return what a script of the other simulator or of the recordings writes."""
        folder = self.out / f"{script.removesuffix('.py')}-{words[0]}"
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
            if (script, words[0]) == FAULTS:
                self._without_command(folder / COMMANDED)
            subprocess.run(command, check=True)
            write_text(kept, (folder / "scores.jsonl").read_text(encoding="utf-8"))
        return Answers(_rows(kept, folder), f"{script} {' '.join(words)}")

    def _without_command(self, folder: Path) -> None:
        """Put recordings without their command where ``real.py`` would write them with it."""
        shutil.copytree(self.at.real(COMMANDED)[0], folder, dirs_exist_ok=True)
        for log in folder.glob("*.csv"):
            rows = [line.split(",") for line in log.read_text(encoding="utf-8").splitlines()]
            kept = [k for k, name in enumerate(rows[0]) if not name.endswith(".qr")]
            write_text(log, "".join(",".join(row[k] for k in kept) + "\n" for row in rows))


@dataclass
class Given:
    """Answers that the scripts gave elsewhere.

    Attributes:
        rows: all of them. seed, machines: of no meaning here.
    """

    rows: list[Row]
    seed: int = 0
    machines: int = 1

    @classmethod
    def read(cls, files: Sequence[Path]) -> Given:
        """Read ``scores.jsonl`` files; their diagnoses lie beside them. What was asked with a command is left out.

        Raises:
            ValueError: a question was asked twice, so that one would have to be chosen.
        """
        rows = _as_asked([row for file in files for row in _rows(file, file.resolve().parent)])
        asked = Counter((row["folder"], *_question(row)) for row in rows)
        twice = [question for question, count in asked.items() if count > 1]
        if twice:
            raise ValueError(f"{twice[0][0]}: asked twice: {' '.join(map(str, twice[0][1:]))}")
        alone = [row for row in rows if _asked(row) != FAULTS or not _with_command(row)]
        if len(alone) < len(rows):
            print(f"{len(rows) - len(alone)} faults put into recordings with a command are not counted")
        return cls(alone)

    @property
    def seeds(self) -> str:
        """Any."""
        return ""

    @property
    def folders(self) -> list[Path]:
        """Where diagnoses lie."""
        return sorted({Path(row["folder"]) for row in self.rows})

    def score(self, script: str, *words: str) -> Answers:
        """Return those of the rows that a script would have written for these words, whatever their seeds."""
        options = dict(zip(words[1::2], words[2::2], strict=True))
        wanted = {o: options[o].split(",") for o in ("--kinds", "--sets") if o in options}
        rows = [
            row
            for row in self.rows
            if _asked(row) == (script, words[0])
            and _machine(row) == options.get("--machine", "random" if script == "score.py" else "")
            and _kind(row) in wanted.get("--kinds", [_kind(row)])
            and row.get("set") in wanted.get("--sets", [row.get("set")])
        ]
        seeds = sorted({_seed(row) for row in rows} - {None})
        said = [f"{o} {options[o]}" for o in ("--machine", "--kinds", "--sets") if o in options]
        return Answers(rows, " ".join([script, words[0], *said, *_spans(seeds)]))


def _rows(file: Path, folder: Path) -> list[Row]:
    lines = file.read_text(encoding="utf-8").splitlines()
    return [{**json.loads(line), "folder": str(folder)} for line in lines]


def _asked(row: Row) -> tuple[str, str]:
    if "set" in row:
        return "real.py", "faults" if ":" in row["case"] else "healthy"
    return "score.py", row["what"]


def _with_command(row: Row) -> bool:
    """Return whether the recording that a fault was put into has a command."""
    log = Path(row["folder"]) / row["set"] / "b.csv"
    return log.is_file() and ".qr," in log.read_text(encoding="utf-8").partition("\n")[0]


def _as_asked(rows: Sequence[Row]) -> list[Row]:
    """Return the rows with the kind that was asked where the answer has another.

    Friction that grows with the load is asked of every machine; one that has slides alone gets an asymmetry instead,
    and its row then says so.
    """
    seen, out = set[tuple[Any, ...]](), []
    for row in rows:
        key = (row["folder"], *_question(row))
        again = key in seen and row.get("kind") == "coulomb_asymmetric"
        out.append({**row, "asked": "load_friction"} if again else row)
        seen.add((row["folder"], *_question(out[-1])))
    return out


def _question(row: Row) -> tuple[str, ...]:
    keys = ("set", "case", "what", "machine", "seed", "kind", "asked", "situation")
    return tuple(str(row[k]) for k in keys if k in row)


def _kind(row: Row) -> str:
    return str(row["case"].partition(":")[0] if "set" in row else row.get("kind", "none"))


def _seed(row: Row) -> int | None:
    last = str(row["case"]).rpartition(":")[2] if "set" in row else row["seed"]
    return int(last) if str(last).isdigit() else None


def _machine(row: Row) -> str:
    """Return the machine that a row of ``score.py`` is about, ``random`` for one of its seed: its folder may tell."""
    if "set" in row:
        return ""
    if row["what"] == "shop":
        return str(row["machine"]).partition(":")[0]
    case = f"{row.get('kind', 'none')}-{row['seed']}"
    found = {p.name.removesuffix(f"-{case}") for p in Path(row["folder"]).glob(f"*-{case}")}
    if len(found) != 1:
        raise ValueError(
            f"{row['folder']}: {len(found)} machines of {case}; give each machine a folder of its own"
        )
    name = found.pop()
    return "random" if name == f"random{row['seed']}" else name


def _spans(seeds: Sequence[int]) -> list[str]:
    """Return seeds as the scripts take them, one option for every stretch without a gap."""
    starts = [s for s in seeds if s - 1 not in seeds]
    ends = [s + 1 for s in seeds if s + 1 not in seeds]
    return [f"--seeds {low}:{high}" for low, high in zip(starts, ends, strict=True)]


def effects(row: Row) -> list[Row]:
    """Return the effects of the diagnosis behind a row."""
    file = diagnosis_of(row) / "diagnosis.json"
    found: list[Row] = json.loads(file.read_text(encoding="utf-8"))["effects"] if file.is_file() else []
    return found


def documents(folder: Path) -> list[Row]:
    """Return all diagnoses that lie in a folder or below it."""
    return [json.loads(x.read_text(encoding="utf-8")) for x in sorted(folder.rglob("diagnosis.json"))]


def diagnosis_of(row: Row) -> Path:
    """Return the folder of the diagnosis behind a row; that of all rows where there is none."""
    if "diagnosis" in row:
        return Path(row["diagnosis"])
    folder = Path(row["folder"])
    if "set" in row:
        return folder / f"{row['set']}-{row['case']}"
    if row["what"] == "shop":
        twin = "-balanced" * (row["kind"] == "counterbalance")
        name = f"{row['machine'].replace(':', '')}-shop-{row['seed']}{twin}"
        return folder / name / row["kind"] / "diagnosis"
    return next(folder.glob(f"*-{row.get('asked', row['kind'])}-{row['seed']}/diagnosis-*"), folder)
