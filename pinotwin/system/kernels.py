"""Compiled functions: numba is imported on the first call; :mod:`.kernel_files` keeps what it compiles."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dis import get_instructions
from functools import update_wrapper
from types import CellType, FunctionType
from typing import Any

_LOCK = threading.RLock()
_PART = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of numba for a function that only compiled ones call: a fifth less to compile."""


def compiled(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Return a function that numba compiles, with options of ``njit``, when it is first called; not a recursive one."""
    if function is None:
        return lambda other: Kernel(other, options)
    return Kernel(function, options)


class Kernel:
    """A function that is compiled when it is first called; ``py_func`` is the function as written."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        update_wrapper(self, function)
        self.py_func: Any = function
        self._options = options
        self._made: dict[bool, Any] = {}

    def __call__(self, *args: Any) -> Any:
        return (self._made.get(False) or self.dispatcher(part=False))(*args)

    def dispatcher(self, *, part: bool) -> Any:
        """Return numba's function, as a part of other compiled ones or to be called from Python."""
        with _LOCK:  # of two threads one compiles
            if part not in self._made:
                from pinotwin.system.kernel_files import dispatcher

                options = {**self._options, **(_PART if part else {})}
                self._made[part] = dispatcher(self._of_parts(), options)
            return self._made[part]

    def _of_parts(self) -> FunctionType:
        """Return the function with only what it uses in its globals, and numba's functions as those that it calls."""
        code, names = self.py_func.__code__, self.py_func.__globals__
        used = dict.fromkeys(one.argval for one in get_instructions(code) if one.opname == "LOAD_GLOBAL")
        seen = {name: _part(names[name]) for name in used if name in names}
        cells = tuple(CellType(_part(cell.cell_contents)) for cell in self.py_func.__closure__ or ())
        function = FunctionType(code, seen, None, self.py_func.__defaults__, cells)
        update_wrapper(function, self.py_func)
        return function


def _part(value: Any) -> Any:
    return value.dispatcher(part=True) if isinstance(value, Kernel) else value
