"""Real recordings with an effect of the real machine withheld from the model: is it named?

Each line is one diagnosis of a recording that others published (``../shared/data/README.md``); data that
are not at hand are skipped with the reason. What is right is known from the publication, from a second
sensor, or because the effect was in the model until it was taken out.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from pinotwin.diagnosis import Diagnosis, diagnose
from pinotwin.errors import PinotwinError
from pinotwin.log import Log
from pinotwin.machine import Machine

Key = tuple[str, str | None]


@dataclass(frozen=True)
class Given:
    """What a diagnosis of a real recording starts from.

    Attributes:
        machine: without the effect.
        logs: recordings.
        validation: recordings that nothing is fitted to; none for held-out blocks.
    """

    machine: Machine
    logs: tuple[Log, ...]
    validation: tuple[Log, ...] = ()


@dataclass(frozen=True)
class Task:
    """One line to be filled.

    Attributes:
        recording: which.
        withheld: what the model lacks, in words.
        right: names that are right.
        axes: axes where they are; empty for any.
        make: reads the data of a folder.
        file: what must be in the folder of recordings.
    """

    recording: str
    withheld: str
    right: tuple[str, ...]
    axes: tuple[str, ...]
    make: Callable[[Path], Given]
    file: str

    def is_right(self, said: Key) -> bool:
        """Whether an answer is right."""
        return said[0] in self.right and (not self.axes or said[1] in (*self.axes, None))


@dataclass(frozen=True)
class Line:
    """One line of the table.

    Attributes:
        recording: which.
        withheld: what the model lacked.
        said: every effect that was named, in words, or the verdict.
        effect: the right one if it was named, else the first; None where nothing was.
        axis: its axis.
        confidence: its stated probability.
        shrink: delivered share of the squared gap that it takes away.
        on: what the shrink was measured on.
        right: whether the withheld effect was named.
        first: whether it was named first.
        seconds: what the diagnosis took [s].
        skipped: why it was not run.
    """

    recording: str
    withheld: str
    said: str = ""
    effect: str | None = None
    axis: str | None = None
    confidence: float | None = None
    shrink: float | None = None
    on: str = ""
    right: bool = False
    first: bool = False
    seconds: float = 0.0
    skipped: str = ""


def data_folder(given: str | Path | None = None) -> Path | None:
    """Return the folder of real recordings: as given, ``$PINOTWIN_DATA``, or beside the project."""
    beside = Path(__file__).resolve().parents[3] / "shared" / "data"
    path = Path(given or os.environ.get("PINOTWIN_DATA") or beside)
    return path if path.is_dir() else None


def real_lines(folder: Path | None, tasks: Sequence[Task]) -> Iterator[Line]:
    """Yield one line per task.

    Args:
        folder: of the recordings, None where there are none.
        tasks: what to run.
    """
    for task in tasks:
        missing = folder is None or not (folder / task.file).exists()
        if folder is None or missing:
            yield Line(task.recording, task.withheld, skipped="the recording is not at hand")
            continue
        yield line_of(task, folder)


def line_of(task: Task, folder: Path) -> Line:
    """Run one task."""
    start = time.perf_counter()
    try:
        given = task.make(folder)
        found = diagnose(given.machine, given.logs, validate=list(given.validation) or None)
    except PinotwinError as error:
        return Line(task.recording, task.withheld, skipped=str(error))
    return judged(task, found, time.perf_counter() - start)


def judged(task: Task, found: Diagnosis, seconds: float) -> Line:
    """Return the line that a diagnosis makes."""
    flags = [task.is_right((e.effect, e.axis)) for e in found.effects]
    named = [f"{e.effect}" + (f" on {e.axis}" if e.axis else "") for e in found.effects]
    said = f"{found.verdict}: {', '.join(named)}" if named else found.verdict
    if not found.effects:
        return Line(task.recording, task.withheld, said, seconds=seconds)
    at = flags.index(True) if any(flags) else 0
    best = found.effects[at]
    shrink = best.shrink.get("u") or next(iter(best.shrink.values()), None)
    return Line(
        task.recording,
        task.withheld,
        said,
        best.effect,
        best.axis,
        float(best.confidence),
        None if shrink is None else float(shrink.share),
        "" if shrink is None else shrink.on,
        any(flags),
        flags[0],
        seconds,
    )


HEAD = ("recording", "withheld", "named", "confidence", "held-out shrink", "right")


def cells(line: Line) -> tuple[str, ...]:
    """Return the cells of a line, under those of :data:`HEAD`."""
    if line.skipped:
        return (line.recording, line.withheld, f"skipped: {line.skipped}", "", "", "")
    shrink = "" if line.shrink is None else f"{line.shrink:.2f} ({line.on})"
    sure = "" if line.confidence is None else f"{line.confidence:.2f}"
    return (line.recording, line.withheld, line.said, sure, shrink, "yes" if line.right else "NO")
