"""What the commands share: JSON files, output folders written whole or not at all, progress."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pinotwin.arrays import plain
from pinotwin.errors import InputError


def add_common(parser: argparse.ArgumentParser, *, out: str | None, required: bool = False) -> None:
    """Add ``--json`` and, with ``out`` as its help, ``--out``."""
    parser.add_argument("--json", metavar="FILE", help="write the machine-readable result here")
    if out is not None:
        parser.add_argument("--out", metavar="PATH", required=required, help=out)


def write_json(path: str | Path, value: Any) -> None:
    """Write ``value`` as JSON, whole or not at all."""
    text = json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    write_text(Path(path), text)


def write_text(target: Path, text: str) -> None:
    """Write a text file so that a crash leaves either the old one or the new one."""
    check_file(target)
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=_hidden(target))
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
        os.chmod(name, 0o644)
        os.replace(name, target)
    finally:
        Path(name).unlink(missing_ok=True)


def check_file(path: str | Path, *, folder: str | Path | None = None) -> None:
    """Refuse a file that cannot be written, before any work is done for it.

    Args:
        path: the file.
        folder: a folder that the same command makes; the file may lie in it.

    Raises:
        InputError: with what to do.
    """
    target = Path(path)
    if target.is_dir():
        raise InputError(f"{target}: is a folder; give a file name")
    if folder is None or target.parent != Path(folder):
        _check_parent(target)


def check_folder(path: str | Path) -> None:
    """Refuse an output folder that cannot be made, before any work is done for it.

    Raises:
        InputError: with what to do.
    """
    target = Path(path)
    if not str(path).strip():
        raise InputError("--out: no name given; give a folder")
    if target.exists() and not target.is_dir():
        raise InputError(f"{target}: is a file; give a folder for --out")
    _check_parent(target)


def _check_parent(target: Path) -> None:
    if not target.parent.is_dir():
        raise InputError(f"{target}: folder {target.parent} does not exist; make it first")
    try:  # whether one may write somewhere is best found out by writing
        tempfile.TemporaryFile(dir=target.parent).close()
    except OSError as error:
        raise InputError(
            f"{target}: folder {target.parent} cannot be written to: {error.strerror}; choose another"
        ) from None


def _hidden(target: Path) -> str:
    return f".{target.name[:40]}."


@contextmanager
def whole_folder(path: str | Path) -> Iterator[Path]:
    """Yield a folder to fill; it takes the place of ``path`` only if nothing fails.

    Files of an earlier run under the same names are replaced, others stay.
    """
    target = Path(path)
    check_folder(target)
    work = Path(tempfile.mkdtemp(dir=target.parent, prefix=_hidden(target)))
    try:
        yield work
        target.mkdir(exist_ok=True)
        mode = target.stat().st_mode
        shutil.copytree(work, target, dirs_exist_ok=True)
        target.chmod(mode)  # copytree gave it the private mode of the temporary folder
    finally:
        shutil.rmtree(work, ignore_errors=True)


def say(text: str = "") -> None:
    """Print a line of the command's result."""
    sys.stdout.write(text + "\n")
