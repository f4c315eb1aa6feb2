"""Questions that are put to the public command line one by one, and their answers, each kept as soon as it is there."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.evidence.answers import Row
from pinotwin.bench.fingerprint import fingerprint

EXE = Path(sys.executable).parent / "pinotwin"


@dataclass(frozen=True)
class Said:
    """What a command did.

    Attributes:
        code: it ended with; 0 is well.
        text: all that it printed.
    """

    code: int
    text: str

    @property
    def last(self) -> str:
        """The last line."""
        return (self.text.strip().splitlines() or [""])[-1]


def pinotwin(*words: object, at: Path) -> Said:
    """Run a command of pinotwin in a folder, with its answer and its errors in one text."""
    command = [str(EXE), *map(str, words)]
    done = subprocess.run(
        command, check=False, cwd=at, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    return Said(done.returncode, done.stdout)


def twin_of(machine: Path, *logs: Path) -> Path:
    """Return the twin of a machine beside it, identified once.

    Raises:
        ValueError: it cannot be identified.
    """
    twin = machine.with_name(f"{fingerprint()}-twin")
    if not (twin / "twin.json").is_file():
        said = pinotwin("identify", machine, *logs, "--out", twin, at=machine.parent)
        if said.code:
            raise ValueError(f"{machine}: {said.last}")
    return twin


def diagnosed(twin: Path, *words: object, out: Path) -> Row:
    """Return verdict, names with axis and confidence [1], faults of the recording, and where the diagnosis lies.

    Args:
        twin: that is asked.
        words: logs and options.
        out: folder of the diagnosis.
    """
    said = pinotwin("diagnose", twin, *words, "--out", out, at=twin.parent)
    file = out / "diagnosis.json"
    if said.code or not file.is_file():
        return {"verdict": f"failed: {said.last}", "named": [], "recording": [], "diagnosis": str(out)}
    document = json.loads(file.read_text(encoding="utf-8"))
    named = [[e["effect"], e["axis"], e["confidence"]] for e in document["effects"]]
    faults = [[x["fault"], x["axis"]] for x in document["recording"]]
    return {
        "verdict": document["verdict"],
        "named": named,
        "recording": faults,
        "diagnosis": str(out),
        "detectable": document["detectable"],
    }


def kept(
    out: Path, part: str, questions: Iterable[str], ask: Callable[[str], Row | None], most: int | None = None
) -> list[Row]:
    """Return a row for each question, asked once of this code; a run that was cut off goes on where it stopped.

    Args:
        out: folder of the answers.
        part: of the table; names the file.
        questions: each by a name of its own.
        ask: puts one; None where it cannot be put.
        most: so many that can be put, all unless given.
    """
    file = out / f"{fingerprint()}-{part}.jsonl"
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    known: dict[str, Row] = {row["question"]: row for row in map(json.loads, lines)}
    found = list[Row]()
    for question in questions:
        if len(found) == most:
            break
        if question not in known:
            answer = ask(question)
            known[question] = {"question": question, "asked": answer is not None, **(answer or {})}
            with file.open("a", encoding="utf-8") as f:
                f.write(json.dumps(known[question]) + "\n")
            print(_told(known[question]), flush=True)
        if known[question]["asked"]:
            found.append(known[question])
    return found


def _told(row: Row) -> str:
    names = "; ".join(f"{x[1]} {x[0]} {x[2]:.2f}" for x in row.get("named", [])) or "no name"
    faults = ", ".join(str(x[0]) for x in row.get("recording", []))
    return f"{row['question']}: {row.get('verdict', '-')}: {names}{'; recording: ' * bool(faults)}{faults}"
