"""Files and folders that are written whole or not at all, so that a full disk or a kill leaves what was there.

A result is made beside its target, ``.<name>.<random>.part``, and renamed when complete. Its maker holds a lock on it
(``flock``, but on Windows), so that the next command of the same target can tell what a killed process left.
"""

from __future__ import annotations

import contextlib
import csv
import ctypes
import errno
import io
import json
import os
import re
import shutil
import stat
import tempfile
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from pinotwin.errors import InputError, OutputError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_PART = re.compile(r"\..+\.\w{8}\.part")


def as_path(given: Any, name: str) -> Path:
    """Return the path that a caller names; InputError, with the ``name`` of the argument, if it cannot name a file."""
    if isinstance(given, str | os.PathLike):
        try:
            os.lstat(given)
        except ValueError:  # a zero byte
            raise InputError(f"{name}: {given!r} cannot name a file") from None
        except OSError as error:
            text = os.fsdecode(given)
            if error.errno == errno.ENAMETOOLONG or "\n" in text:
                start = " ".join(text[:60].split())
                raise InputError(
                    f"{name}: expected the name of a file or folder, not its text ({start!r} ...); save it as a file"
                ) from None
        return Path(given)
    raise InputError(f"{name}: expected a file or folder name, not {type(given).__name__}")


def check_file(path: str | Path) -> None:
    """Refuse a file that cannot be written, before any work is done for it."""
    if not str(path).strip():
        raise OutputError("no name given for an output; give a file")
    target = Path(path)
    if target.is_dir():
        raise OutputError(f"{target}: is a folder; give a file name")
    if target.exists() and not (target.is_file() or _is_sink(target)):
        raise OutputError(f"{target}: is no ordinary file; give another name")
    if not _is_sink(target):
        _check_writing(target)


def check_folder(path: str | Path) -> None:
    """Refuse an output folder that cannot be made or filled, before any work is done for it."""
    if not str(path).strip():
        raise OutputError("--out: no name given; give a folder")
    target = Path(path)
    if target.exists() and not target.is_dir():
        raise OutputError(f"{target}: is a file; give a folder for --out")
    if target.is_dir():
        _check_writing(target, target)
    _check_writing(target)


def _check_writing(target: Path, folder: Path | None = None) -> None:
    """Refuse a target in a folder, or where the nearest folder above it is, that cannot be written to."""
    if folder is None:
        above = Path(os.path.abspath(target)).parents
        folder = next((p for p in above if p.exists()), above[-1])
    if not folder.is_dir():
        raise OutputError(f"{target}: {folder} is not a folder; choose another")
    try:  # whether one may write somewhere is best found out by writing
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"x")
    except OSError as error:
        raise OutputError(
            f"{target}: folder {folder} cannot be written to: {_why(error)}; choose another"
        ) from None


def write_text(path: str | Path, text: str) -> None:
    """Write a text file (UTF-8), whole or not at all."""
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")


def write_json(path: str | Path, value: Any) -> None:
    """Write ``value`` as JSON, whole or not at all."""
    from pinotwin.arrays import plain  # needs NumPy, which refusing a file does not

    write_text(path, json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def write_bytes(path: str | Path, content: bytes) -> None:
    """Write a file, whole or not at all."""
    with whole_file(path) as part:
        part.write_bytes(content)


def csv_text(rows: Iterable[Sequence[Any]]) -> str:
    """Return rows of cells as CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def append_text(path: Path, text: str) -> None:
    """Add text (UTF-8) at the end of a file, all of it or nothing: on an OutputError the file is as it was."""
    with _in_one_line(path), path.open("ab", buffering=0) as file:
        end = file.tell()
        try:
            if file.write(content := text.encode()) != len(content):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
            os.fsync(file.fileno())
        except OSError:
            file.truncate(end)
            raise


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Yield a file to write, of the same suffix; it takes the place of ``path`` if nothing fails, folders made."""
    target = Path(path).resolve()  # a symbolic link stays one
    if not _is_inside(target):
        check_file(path)
    if _is_sink(target):
        with _in_one_line(target):
            yield target
        return
    with _made(target, folder=False) as part:
        yield part
        _settle(part, target, 0o666)
        os.replace(part, target)


@contextmanager
def whole_folder(path: str | Path, replaces: Sequence[str] = ()) -> Iterator[Path]:
    """Yield a folder that takes ``path``'s place if nothing fails; it keeps what is there but for ``replaces``."""
    check_folder(path)
    target = Path(path).resolve()
    with _made(target, folder=True) as part:
        yield part
        _settle(part, target, 0o777)
        _take_place(part, target, replaces)


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Make a folder that many results go into, and hold it against others: until the process ends, however it does."""
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        try:
            stack.enter_context(held(folder.resolve(), wait=False))
        except BlockingIOError:
            raise OutputError(
                f"{folder}: another pinotwin is writing here; wait for it, or give another --out"
            ) from None
        yield


@contextmanager
def held(path: Path, *, wait: bool = True) -> Iterator[bool]:
    """Hold a file or folder; yield whether it is: not all systems can. BlockingIOError if it is not to ``wait``."""
    handle = None
    with ExitStack() as stack:
        if fcntl is not None:
            try:
                handle = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
                stack.callback(os.close, handle)
                fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
            except BlockingIOError:
                raise
            except OSError:  # a file system without locks
                handle = None
        yield handle is not None


def _take_place(part: Path, target: Path, replaces: Sequence[str]) -> None:
    if not target.exists():
        os.rename(part, target)
        return
    own = os.listdir(part)
    here = Path.cwd()  # of a shell that would lose its folder
    if not (target.is_mount() or here == target or target in here.parents):
        _carry_over(target, part, replaces)
        if _exchange(part, target):
            return
    for name in [n for n in os.listdir(target) if n not in own and _matches(n, replaces)]:
        _remove(target / name)
    for name in own:
        if (part / name).is_dir() or (target / name).is_dir():
            _remove(target / name)
        os.replace(part / name, target / name)


def _exchange(part: Path, target: Path) -> bool:
    """Swap two folders in one step, or by two renames where the system cannot; False if neither can."""
    with contextlib.suppress(AttributeError, OSError, TypeError):  # no C library by that name, no such call
        here, exchange = -100, 2  # AT_FDCWD, RENAME_EXCHANGE of renameat2(2), Linux 3.15
        rename = ctypes.CDLL(None, use_errno=True).renameat2
        if rename(here, os.fsencode(part), here, os.fsencode(target), exchange) == 0:
            return True
    aside = part.with_name(part.name.removesuffix(".part") + ".old.part")
    try:
        os.rename(target, aside)
    except OSError:
        return False
    try:
        os.rename(part, target)
    except OSError:
        os.rename(aside, target)
        return False
    _remove(aside)
    return True


def _carry_over(old: Path, new: Path, replaces: Sequence[str] = ()) -> None:
    """Link what only the old folder has into the new one (copy where a link is not possible)."""
    for entry in os.scandir(old):
        place = new / entry.name
        if entry.is_dir(follow_symlinks=False):
            if place.is_dir():
                continue  # a folder of the result, written anew
            if not place.exists() and not _matches(entry.name, replaces):
                place.mkdir()
                _carry_over(Path(entry.path), place)
                shutil.copystat(entry.path, place)
        elif not os.path.lexists(place) and not _matches(entry.name, replaces):
            try:
                os.link(entry.path, place, follow_symlinks=False)
            except (OSError, NotImplementedError):
                shutil.copy2(entry.path, place, follow_symlinks=False)


def _matches(name: str, patterns: Sequence[str]) -> bool:
    return any(Path(name).match(pattern) for pattern in patterns)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


@contextmanager
def _made(target: Path, *, folder: bool) -> Iterator[Path]:
    """Yield a new file or folder beside the target, locked; whatever has its name afterwards is removed."""
    with _in_one_line(target), ExitStack() as stack:
        target.parent.mkdir(parents=True, exist_ok=True)
        sweep(target)
        while True:
            part = _new(target, folder)
            stack.enter_context(held(part))
            stack.callback(_remove, part)
            if part.exists():  # else another process swept it before it was held
                break
        yield part


def _new(target: Path, folder: bool) -> Path:
    start = f".{_stem(target)}."
    if folder:
        return Path(tempfile.mkdtemp(dir=target.parent, prefix=start, suffix=".part"))
    suffix = f".part{target.suffix}" if len(target.suffix) < 20 else ".part"
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=start, suffix=suffix)
    os.close(handle)
    return Path(name)


def _stem(target: Path, most: int = 40) -> str:
    """Return the target's name as its parts have it: file systems stop at 255 bytes, and long names stay apart."""
    name = target.name
    return name if len(name) <= most else f"{name[:most]}-{zlib.crc32(os.fsencode(name)):08x}"


def sweep(target: Path) -> None:
    """Remove what killed processes left of this target; put back a folder that was only renamed aside."""
    pattern = re.compile(rf"\.{re.escape(_stem(target))}\.\w{{8}}(\.old)?\.part(\.\w+)?")
    for entry in target.parent.iterdir():
        if pattern.fullmatch(entry.name):
            with contextlib.suppress(OSError), held(entry, wait=False) as dead:
                if ".old.part" in entry.name and not target.exists():
                    os.rename(entry, target)
                elif dead:
                    _remove(entry)


def _settle(part: Path, target: Path, usual: int) -> None:
    """Give a part the mode of what it replaces, and wait for its contents: a rename may overtake them on the disk."""
    for file in [p for p in part.rglob("*") if p.is_file()] if part.is_dir() else [part]:
        handle = os.open(file, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
    mask = os.umask(0)
    os.umask(mask)
    part.chmod(stat.S_IMODE(target.stat().st_mode) if target.exists() else usual & ~mask)


def _is_sink(target: Path) -> bool:
    """Whether a target is a device or pipe, such as /dev/null, which cannot be replaced."""
    try:
        mode = target.stat().st_mode
    except OSError:
        return False
    return stat.S_ISCHR(mode) or stat.S_ISFIFO(mode)


@contextmanager
def _in_one_line(target: Path) -> Iterator[None]:
    """Turn what the system says of a write into one line that says what became of the target."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        if _is_inside(target):
            raise  # the folder that it is a file of says what became of it
        if error.filename is not None and not str(error.filename).startswith(str(target.parent)):
            raise  # trouble with another file, which the command line names
        kept = "the earlier one is kept" if target.is_file() or target.is_dir() else "nothing is kept"
        raise OutputError(f"{target}: cannot be written: {_why(error)}; {kept}") from None


def _is_inside(target: Path) -> bool:
    """Whether a file is of a folder that is being made."""
    return any(_PART.fullmatch(parent.name) for parent in target.parents)


def _why(error: OSError) -> str:
    if error.errno is not None and error.errno in errno.errorcode:
        return os.strerror(error.errno)
    return " ".join(str(error).split())[:200]
