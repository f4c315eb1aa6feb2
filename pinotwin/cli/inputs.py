"""Reading what the commands are given, with errors that name the argument."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterable, Sequence
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
    """Return a rate [Hz] that was given, or None; refuse what is no positive number."""
    if rate is not None and not (math.isfinite(rate) and rate > 0.0):
        raise InputError(f"--{option}: {rate:g} Hz must be above 0")
    return rate


def distinct(paths: Iterable[Sequence[str]], joint: str) -> list[str]:
    """Return a name for each path: its last part, after as many of its folders as tell it from the others."""
    paths = list(paths)
    depth = [1] * len(paths)
    for _ in range(20):
        names = [joint.join(p[-d:])[:120].lstrip(".") or "log" for p, d in zip(paths, depth, strict=True)]
        count = Counter(name.casefold() for name in names)  # the file system may not tell capitals
        if len(count) == len(names):
            return names
        depth = [d + (count[name.casefold()] > 1) for name, d in zip(names, depth, strict=True)]
    return [f"{path[-1]}_{k + 1}" for k, path in enumerate(paths)]


def numbers(option: str, given: str, form: str, count: int) -> list[float]:
    """Return the numbers of an option's value, ``-0.3,0.3`` or ``X=-0.3,0.3``; refuse what is not of that form."""
    text = given.partition("=")[2] if "=" in form else given
    try:
        values = [float(x) for x in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count:
        raise InputError(f"--{option}: {given!r} is not {form}")
    return values


def by_axis(option: str, given: Sequence[str], count: int = 1) -> dict[str, list[float]]:
    """Return axis -> numbers of an option such as ``--travel X=-0.3,0.3``."""
    form = f"AXIS={','.join(['NUMBER'] * count)}"
    return {text.partition("=")[0]: numbers(option, text, form, count) for text in given}


def files_of(argument: str) -> list[str]:
    """Return the files of a log; ``a.csv+b.csv`` names two."""
    whole = os.path.exists(argument) or "+" not in argument
    return [argument] if whole else [part.strip() for part in argument.split("+")]


def check_there(*arguments: str) -> None:
    """Refuse logs that are not there before anything is loaded for them, naming those that lie beside."""
    for text in arguments:
        if not any(map(os.path.exists, files_of(text))):
            from pinotwin.logs.files import read_argument

            read_argument(text)  # says what is wrong with the name


def check_twin(given: str) -> None:
    """Refuse the folder of a twin that is not there before anything is loaded for it."""
    path = Path(given) / "twin.json" if Path(given).is_dir() else Path(given)
    if not path.is_file():
        raise TwinError(f"{path}: no such file; give the folder that `pinotwin identify` wrote")


def read_logs(arguments: Sequence[str], large: float = 3e7) -> list[Log]:
    """Read every log, those of ``large`` bytes with a bar; of ``a.csv+b.csv`` the columns lie in two files."""
    from pinotwin.logs.files import read_argument

    sizes = [sum(map(os.path.getsize, filter(os.path.isfile, files_of(text)))) for text in arguments]
    logs = []
    with progress() if sum(sizes) > large else nullcontext(silent) as report:
        for k, text in enumerate(arguments):

            def seen(share: float, k: int = k, name: str = f"reading {Path(text).name}") -> None:
                report(name, (sum(sizes[:k]) + share * sizes[k]) / max(sum(sizes), 1))

            seen(0.0)
            logs.append(read_argument(text, None if report is silent else seen))
    return logs
