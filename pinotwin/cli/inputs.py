"""Reading what the commands are given, with errors that name the argument."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from pinotwin.cli.progress import progress, silent
from pinotwin.errors import InputError, TwinError

if TYPE_CHECKING:
    from pinotwin.log import Log
    from pinotwin.machine import Machine
    from pinotwin.twin import Twin

Subject = TypeVar("Subject", bound="Machine | Twin")


def resampled(subject: Subject, rate: float | None) -> Subject:
    """Return the machine or twin whose logs are put on a clock of that rate [Hz]; None: as its YAML says."""
    if rate is None:
        return subject
    from pinotwin.twin import Twin

    machine = subject.machine if isinstance(subject, Twin) else subject
    other = replace(machine, data=replace(machine.data, resample=above_zero("resample", rate)))
    return replace(subject, machine=other) if isinstance(subject, Twin) else other  # type: ignore[return-value]


def above_zero(option: str, rate: float | None) -> float | None:
    """Return a rate [Hz] that was given, or None.

    Raises:
        InputError: it is no positive number.
    """
    if rate is not None and not (math.isfinite(rate) and rate > 0.0):
        raise InputError(f"--{option}: {rate:g} Hz must be above 0")
    return rate


def check_there(*arguments: str) -> None:
    """Refuse logs that are not there before anything is loaded for them.

    Raises:
        LogError: with the logs that lie beside.
    """
    for text in arguments:
        if not any(map(os.path.exists, [text, *map(str.strip, text.split("+"))])):
            from pinotwin.logs.files import read_argument

            read_argument(text)  # says what is wrong with the name


def check_twin(given: str) -> None:
    """Refuse the folder of a twin that is not there before anything is loaded for it.

    Raises:
        TwinError: with what to give.
    """
    path = Path(given) / "twin.json" if Path(given).is_dir() else Path(given)
    if not path.is_file():
        raise TwinError(f"{path}: no such file; give the folder that `pinotwin identify` wrote")


def read_logs(arguments: Sequence[str], large: float = 3e7) -> list[Log]:
    """Read every log; ``a.csv+b.csv`` is one log whose columns lie in two files.

    Args:
        arguments: as they were given.
        large: bytes from which the reading is shown by a bar: a second or so.
    """
    from pinotwin.logs.files import read_argument

    sizes = [_size(text) for text in arguments]
    logs = []
    with progress() if sum(sizes) > large else nullcontext(silent) as report:
        for k, text in enumerate(arguments):

            def seen(share: float, k: int = k, name: str = f"reading {Path(text).name}") -> None:
                report(name, (sum(sizes[:k]) + share * sizes[k]) / max(sum(sizes), 1))

            seen(0.0)
            logs.append(read_argument(text, None if report is silent else seen))
    return logs


def _size(text: str) -> int:
    """Return the bytes of what an argument names; 0 for what is not there, which reading will say."""
    paths = [Path(text)] if Path(text).exists() else [Path(part.strip()) for part in text.split("+")]
    return sum(path.stat().st_size for path in paths if path.is_file())
