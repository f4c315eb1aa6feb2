"""A command's arguments are those of its function: kinds from the signature, help from the docstring.

A parameter before the ``*`` is a word of the command line, one after it an option. An entry ``name (META): text`` of
``Args`` is its help and the word for its value; one without is of :data:`SHARED`, else hidden. ``argparse`` reads the
words, in 5 ms of imports where cyclopts takes 65.
"""

from __future__ import annotations

import argparse
import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from pinotwin.errors import InputError
from pinotwin.system.writing import check_file, check_folder

Several = Annotated[Sequence[str], "+"]  # ``--name A B C``
Repeated = Annotated[Sequence[str], "append"]  # ``--name A --name B``
AnyNumber = Annotated[Sequence[str], "*"]  # ``--name``, ``--name A`` or ``--name A B``
File = Annotated[str, "file"]  # a file that the command writes; some with what it is and its endings
CsvFile = Annotated[str, "file", "a result over time", ".csv"]
LOG = ("a log", ".csv", ".parquet")
LogFile = Annotated[str, "file", *LOG]
PageFile = Annotated[str, "file", "a page", ".html", ".htm"]
Share = Annotated[float, "share"]  # ``2%`` or ``0.02``
Folder = Annotated[str, "folder"]  # a folder that the command writes

SHARED: dict[str, tuple[str | None, str]] = {
    "machine": (None, "machine folder, machine.yaml, .urdf, or a bundled name"),
    "twin": (None, "folder that `pinotwin identify` wrote"),
    "seed": (None, "of the healthy draws"),
    "cutoff": ("HZ", "corner of the zero-phase low-pass; 0 for none (found in the logs)"),
    "decimate": ("N", "fit one row in N (as the corner allows)"),
    "resample": ("HZ", "put the logs on an even clock of that rate (their own clock)"),
    "meshes": ("DIR", "folder of the URDF's meshes or mesh packages, for pictures"),
    "effects": ("FILE", "Python file with effects of your own; may be given several times"),
    "json": ("FILE", "write the machine-readable result here"),
}
"""Option that several commands have -> what stands for its value, and its help."""


@dataclass(frozen=True)
class Answer:
    """What a command answers."""

    lines: Iterable[str]  # said one by one, after the files are written
    content: Any = None  # of ``--json``
    code: int = 0  # exit code


Command = Callable[..., Answer]
SUBJECTS = ("machine", "twin", "subject", "subjects")
"""A command whose first argument is one of these may meet effects of the user's own."""
_JSON = inspect.Parameter("json", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=File)
_EFFECTS = inspect.Parameter("effects", inspect.Parameter.KEYWORD_ONLY, default=(), annotation=Repeated)


def add_arguments(parser: argparse.ArgumentParser, command: Command) -> None:
    """Give a parser the arguments of a command; every command has ``--json``, one about a machine ``--effects``."""
    words, kinds = dict(inspect.signature(command).parameters), get_type_hints(command, include_extras=True)
    told = SHARED | dict(_told(command))
    last = [words.pop("out")] if "out" in words else []
    if next(iter(words), "") in SUBJECTS:
        words.setdefault("effects", _EFFECTS)
    for word in (*words.values(), _JSON, *last):
        required = word.default is word.empty
        options = _options(kinds.get(word.name, word.annotation), word.default)
        metavar, text = told.get(word.name, (None, argparse.SUPPRESS))
        options["help"] = _with_default(text, word.default)
        if metavar is not None:
            options["metavar"] = metavar
        if word.kind is word.KEYWORD_ONLY:
            parser.add_argument(f"--{word.name.replace('_', '-')}", required=required, **options)
        else:
            parser.add_argument(word.name, **options if required else {"nargs": "?", **options})
    tags = {name: _kind(kind)[1] for name, kind in kinds.items() if name != "return"}
    parser.set_defaults(written={"json": ("file",), **tags})


def _told(command: Command) -> Iterator[tuple[str, tuple[str | None, str]]]:
    """Yield the entries of ``Args`` in a docstring: name, what stands for the value, help."""
    section = re.search(r"^Args:\n((?: .*\n?|\n)*)", inspect.getdoc(command) or "", re.MULTILINE)
    entries = re.split(r"^ {4}(?=\w)", section.group(1) if section else "", flags=re.MULTILINE)
    for entry in entries:
        found = re.match(r"(\w+)(?: \((.*?)\))?: (.*)", " ".join(entry.split()))
        if found:
            yield found[1], (found[2], found[3].replace("%", "%%"))


def _with_default(text: str, default: Any) -> str:
    """Return a help that states its default, if there is one and it is not stated already."""
    silent = default is None or default is False or default == () or default is inspect.Parameter.empty
    if silent or text == argparse.SUPPRESS:
        return text
    value = f"{default:g}" if isinstance(default, float) else str(default)
    shown = " ".join(default) if isinstance(default, tuple) else value
    return text if "default" in text or f"({shown}" in text else f"{text} ({shown})"


def _kind(annotation: Any) -> tuple[Any, tuple[str, ...]]:
    """Return the type without ``None``, and its tags."""
    some = [x for x in get_args(annotation) if x is not NoneType]
    kind = some[0] if NoneType in get_args(annotation) else annotation
    return (get_args(kind)[0], kind.__metadata__) if get_origin(kind) is Annotated else (kind, ())


def _options(annotation: Any, default: Any) -> dict[str, Any]:
    """Return what ``add_argument`` is told of a parameter."""
    kind, tags = _kind(annotation)
    tag = tags[0] if tags else ""
    if kind is bool:
        return {"action": "store_true"}
    value = list(default) if isinstance(default, tuple) else default
    out: dict[str, Any] = {} if default is inspect.Parameter.empty else {"default": value}
    if tag in ("+", "*"):
        out["nargs"] = tag
    elif tag == "append":
        out["action"] = "append"
    if kind in (int, float):
        out["type"] = _share if tag == "share" else kind
    elif choices := [x for x in (kind, *get_args(kind)) if get_origin(x) is Literal]:
        out["choices"] = get_args(choices[0])
    return out


def _share(text: str) -> float:
    """Return a share that is written as 0.02 or 2%."""
    with suppress(ValueError):
        x = float(text.rstrip("%")) / (100.0 if text.endswith("%") else 1.0)
        if 0.0 < x < 1.0:
            return x
    raise argparse.ArgumentTypeError(f"{text}: give a share between 0 and 1, such as 0.02 or 2%")


def check_outputs(values: Mapping[str, Any], written: Mapping[str, tuple[str, ...]]) -> None:
    """Refuse results that cannot be written before the work; ``written``: argument -> file or folder, its endings."""
    for name, tags in written.items():
        path = values[name]
        if isinstance(path, str) and tags[:1] == ("folder",):
            check_folder(path)
        elif isinstance(path, str) and tags[:1] == ("file",):
            check_written(name, path, *tags[1:])


def check_written(option: str, path: str, what: str = "", *endings: str) -> None:
    """Refuse a file that cannot be written, or has none of the endings that ``what`` is written as."""
    if endings and Path(path).suffix not in endings:
        raise InputError(f"--{option}: {Path(path).name}: {what} is written as {' or '.join(endings)}")
    check_file(path)
