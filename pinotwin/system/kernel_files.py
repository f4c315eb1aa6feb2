"""Where compiled functions are kept: the user's cache folder, so that one clone compiles for all.

A file's name hashes byte code, constants and options of a function and all it calls, types, numba and processor: an
edit of a callee leaves no old function in use, and two processes that compile at once write the same.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from pickle import UnpicklingError, dumps
from types import CodeType, ModuleType
from typing import Any

import numba
from numba.core.caching import IndexDataCacheFile, _Cache
from numba.core.compiler import CompileResult
from numba.misc.appdirs import AppDirs


def dispatcher(function: Any, options: Mapping[str, Any]) -> Any:
    """Return numba's function, compiled by its globals (only what it uses), that looks for itself on the disk first."""
    made: Any = numba.njit(**options)(function)
    folder = _folder()
    if folder is not None and made is not function:  # as it is with NUMBA_DISABLE_JIT
        recipe = repr((numba.__version__, sys.version, *_recipe(made, set())))
        made._cache = _Files(folder, f"{function.__module__}.{function.__name__}", recipe)  # type: ignore[attr-defined]
    return made


def _recipe(made: Any, seen: set[Any]) -> Iterator[Any]:
    """Yield what numba's function is made of: byte code, constants, options, and those of what it calls."""
    function = made.py_func
    if function in seen:
        return
    seen.add(function)
    code = function.__code__
    yield function.__module__, function.__qualname__, _plain(code), function.__defaults__
    yield sorted(made.targetoptions.items())
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    for name, value in (*function.__globals__.items(), *zip(code.co_freevars, cells, strict=True)):
        if hasattr(value, "py_func"):
            yield name, value.py_func.__qualname__
            yield from _recipe(value, seen)
        elif isinstance(value, ModuleType):
            if value.__name__.startswith("pinotwin"):  # constants of it
                yield name, [(n, repr(getattr(value, n, None))) for n in code.co_names]
        elif isinstance(value, type):
            yield name, getattr(value, "_fields", None)
        elif not callable(value):
            yield name, dumps(value)


def _plain(code: CodeType) -> tuple[Any, ...]:
    """Return what a code object does, without where it stands."""
    constants = tuple(_plain(x) if isinstance(x, CodeType) else repr(x) for x in code.co_consts)
    return code.co_code, constants, code.co_names, code.co_varnames


def _fields(kind: Any) -> list[Any]:
    """Return class and names of a named tuple and of those that it holds: its type tells neither module nor order."""
    own = (kind.instance_class, *kind.fields) if hasattr(kind, "instance_class") else ()
    return [*own, *map(_fields, getattr(kind, "types", ()))]


@cache
def _folder() -> Path | None:
    """Return a folder that can be written: $NUMBA_CACHE_DIR, the user's for caches; None without one."""
    given = os.environ.get("NUMBA_CACHE_DIR") or AppDirs("pinotwin", appauthor=False).user_cache_dir
    folder = Path(given) / "kernels"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError:
        return None


class _Files(_Cache):  # type: ignore[misc]
    """The compiled forms of one function, made by a recipe: two files for each list of argument types."""

    def __init__(self, folder: Path, name: str, recipe: str) -> None:
        self._folder, self._name, self._recipe = folder, name, recipe

    @property
    def cache_path(self) -> str:
        return str(self._folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        target_context.refresh()
        form = self._form(sig, target_context.codegen())
        try:
            data = form.load(())
        except (OSError, EOFError, UnpicklingError):  # a damaged file
            with suppress(OSError):
                form.flush()
            return None
        return None if data is None else CompileResult._rebuild(target_context, *data)

    def save_overload(self, sig: Any, data: Any) -> None:
        if data.lifted or data.library.has_dynamic_globals:
            return
        with suppress(OSError):  # a full disk costs time, no result
            self._form(sig, data.codegen).save((), data._reduce())
            self._forget_old()

    def _form(self, sig: Any, codegen: Any) -> IndexDataCacheFile:
        key = repr((self._recipe, sig, [*map(_fields, sig)], codegen.magic_tuple()))
        digest = sha256(key.encode()).hexdigest()[:24]
        return IndexDataCacheFile(self.cache_path, f"{self._name}-{digest}", digest)

    def _forget_old(self, most: int = 50) -> None:
        """Remove all but the newest files: each edit of a kernel leaves its old form behind."""
        files = sorted(self._folder.glob(f"{self._name}-*"), key=lambda file: file.stat().st_mtime)
        for file in files[:-most]:
            file.unlink(missing_ok=True)

    def enable(self) -> None: ...
    def disable(self) -> None: ...
    def flush(self) -> None: ...
