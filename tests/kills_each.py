"""The attack on ``diagnose --each``, judged by what docs/many_logs.md promises.

An answer that was finished stays, whatever comes later; every row of the table with a verdict is that of the answer
in the folder; the same command again works on the rest only, ends as an undisturbed run does, and leaves no litter;
an error that ends the command is one line on stderr.
"""

from __future__ import annotations

import csv
import json
import os
import random
import shutil
import signal
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests import kills

NUMBERS = ("gap", "after", "misfit")


class EachAttack:
    """``--each`` over some logs, with the answers of one input in place, attacked while it answers the other."""

    def __init__(self, name: str, inputs: Path, folder: Path) -> None:
        self.command, self.folder = kills.commands()[name], folder
        shutil.copytree(inputs, folder, dirs_exist_ok=True)
        folder.chmod(0o755)
        self.answers: list[dict[str, dict[str, str]]] = []
        self.rows: list[dict[str, dict[str, Any]]] = []
        for k in (1, 0):
            start = time.monotonic()
            code, said = kills.finished(self.start(k))
            assert code == 0, (code, said)
            self.seconds = time.monotonic() - start
            self.answers.insert(0, {log: self.answer(log) for log in kills.EACH})
            self.rows.insert(0, self.table("out/each.json"))
        assert all(self.answers[0][log] != self.answers[1][log] for log in kills.EACH)
        self.now = 0

    def start(self, k: int, before: Callable[[], None] | None = None) -> kills.Child:
        words = [*self.command.words(k), "--json", "made/here/result.json"]
        return kills.forked(words, self.folder, before, own=True)

    def answer(self, log: str) -> dict[str, str]:
        """Return what a log's folder holds: name -> digest; what it was made of is that of its run."""
        return kills.state(self.folder, [f"out/{log}"])

    def table(self, name: str) -> dict[str, dict[str, Any]]:
        """Return the rows of a table: stem of the log -> row."""
        path = self.folder / name
        if path.suffix == ".json":
            rows = json.loads(path.read_text())["logs"]
        else:
            rows = list(csv.DictReader(path.read_text().splitlines()))
        return {Path(row["log"]).stem: row for row in rows}

    def judged(self, k: int) -> Counter[str]:
        """Say what lies there after a run on input ``k`` that was stopped."""
        found: Counter[str] = Counter()
        sides = {}
        for log in kills.EACH:
            old, new, now = self.answers[self.now][log], self.answers[k][log], self.answer(log)
            sides[log] = {"old kept": self.now, "new": k}.get(verdict := kills.verdict(old, new, now))
            found[verdict] += 1
        for name in ("out/each.json", "out/each.csv"):
            try:
                rows = self.table(name)
            except (OSError, ValueError, LookupError):
                found["lost"] += 1
                continue
            claims = [log for log in kills.EACH if log in rows]  # the CSV has no row before the answer
            found["mixed"] += sum(not self.agrees(rows[log], log, sides[log]) for log in claims)
        return found

    def agrees(self, row: dict[str, Any] | None, log: str, side: int | None) -> bool:
        """Whether a row claims nothing, or what the answer of that side says."""
        if row is None or side is None:
            return False
        if row["verdict"] == "waiting":
            return not row["folder"]
        answer = self.rows[side][log]
        return row["verdict"] == answer["verdict"] and all(
            float(row[name]) == answer[name] for name in NUMBERS
        )

    def restarted(self, k: int) -> Counter[str]:
        """Run the same command to its end: what was answered is not done again, and nothing lies about."""
        done = {log: self.stamp(log) for log in kills.EACH if self.answer(log) == self.answers[k][log]}
        code, said = kills.finished(self.start(k))
        if code != 0 or said:
            print(f"restarted: exit code {code}: {said[-600:]}")
        again = sum(self.stamp(log) != stamp for log, stamp in done.items())
        whole = {log: self.answer(log) for log in kills.EACH} == self.answers[k]
        tables = [self.table(name) for name in ("out/each.json", "out/each.csv", "made/here/result.json")]
        agree = all(self.agrees(rows.get(log), log, k) for rows in tables for log in kills.EACH)
        waiting = any(row["verdict"] == "waiting" for rows in tables for row in rows.values())
        self.now = k
        return Counter(
            resumed=len(done),
            lost=again + int(not whole or code != 0),
            mixed=int(not agree or waiting),
            litter=len(kills.litter(self.folder)),
        )

    def stamp(self, log: str) -> int:
        return (self.folder / "out" / log / "diagnosis.json").stat().st_mtime_ns

    def kill(self, rng: random.Random) -> Counter[str]:
        """Stop the command once, politely one time in four, judge what is there, and run it again."""
        k, polite = 1 - self.now, rng.random() < 0.25
        how = signal.SIGTERM if polite else signal.SIGKILL
        code, said = kills.finished(self.start(k), kills.moment(rng) * self.seconds, how)
        # before Python has come to pinotwin, SIGTERM is what it is for any program
        stopped = code in (-signal.SIGKILL, -signal.SIGTERM) or (
            code == 130 and said == "pinotwin: stopped\n"
        )
        if not stopped and code != 0:
            print(f"stopped: exit code {code}: {said[-600:]}")
        found = Counter(kills=int(stopped), ended=int(code == 0), tracebacks=int(not stopped and code != 0))
        return found + self.judged(k) + self.restarted(k)

    def tidy(self) -> Counter[str]:
        """Return nothing: every kill is followed by a restart that is judged."""
        return Counter()

    def full_disk(self) -> Counter[str]:
        return self.refused(kills.fill_disk)

    def forbidden(self) -> Counter[str]:
        """Run as somebody who may not write here (root may write anywhere)."""
        if os.getuid() != 0:
            return Counter()
        kills.owned_by(self.folder, kills.NOBODY)
        try:
            found = self.refused(kills.no_override, again=False)
        finally:
            kills.owned_by(self.folder, 0)
        return found

    def refused(self, before: Callable[[], None], again: bool = True) -> Counter[str]:
        k = 1 - self.now
        code, said = kills.finished(self.start(k, before))
        found = Counter(refused=1, tracebacks=int(not kills.in_one_line(code, said))) + self.judged(k)
        return found + self.restarted(k) if again else found
