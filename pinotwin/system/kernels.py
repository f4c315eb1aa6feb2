"""Compiled functions: numba is imported when the first of them is called.

:mod:`pinotwin.system.kernel_files` keeps what it compiles.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import update_wrapper
from typing import Any

_LOCK = threading.RLock()


def compiled(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Return a function that numba compiles when it is first called; to be used as a decorator.

    Args:
        function: it may call other such functions.
        options: of ``numba.njit``.
    """
    if function is None:
        return lambda other: Kernel(other, options)
    return Kernel(function, options)


class Kernel:
    """A function that is compiled when it is first called; ``py_func`` is the function as written."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        update_wrapper(self, function)
        self.py_func: Any = function
        self._options = options
        self._made: Any = None
        self._ready: Any = None

    def __call__(self, *args: Any) -> Any:
        if self._ready is None:
            self._ready = self.dispatcher()
        return self._ready(*args)

    def dispatcher(self) -> Any:
        """Return numba's function, which sees those that it calls as numba's, too."""
        with _LOCK:  # of two threads one compiles
            if self._made is None:
                from pinotwin.system.kernel_files import made

                made(self.py_func, self._options, self._resolve)
            return self._made

    def _resolve(self, dispatcher: Any) -> None:
        """Put numba's functions in place of those that the function calls."""
        self._made = dispatcher
        names = self.py_func.__globals__
        for name in self.py_func.__code__.co_names:
            if isinstance(names.get(name), Kernel):
                names[name] = names[name].dispatcher()
        for cell in self.py_func.__closure__ or ():
            if isinstance(cell.cell_contents, Kernel):
                cell.cell_contents = cell.cell_contents.dispatcher()
