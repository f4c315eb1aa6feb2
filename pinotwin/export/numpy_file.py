"""One Python file with the inverse model of a machine: NumPy and nothing else."""

from __future__ import annotations

from importlib.resources import files
from pprint import pformat
from typing import Any

from pinotwin.export.header import header
from pinotwin.export.inverse import Inverse

_USE = """
Use:
    from {stem} import MODEL
    MODEL.reset(q[0], v[0], step)       # start of a stretch; step [s] is the sampling interval
    tau = MODEL.effort(q, v, a)         # one sample, in the order of MODEL.names
    tau = MODEL.run(q, v, a, step)      # a whole stretch, arrays of shape (n, nv)
"""


def numpy_text(inverse: Inverse, stem: str) -> str:
    """Return the text of the module.

    Args:
        inverse: what to write.
        stem: name of the file without ``.py``.
    """
    head = "\n".join(header(inverse)) + "\n" + _USE.format(stem=stem)
    return (
        f'"""{head}"""\n\n{runtime_text()}\n\nDATA = {literal(inverse.data)}\n\nMODEL = InverseModel(DATA)\n'
    )


def runtime_text() -> str:
    """Return the source of :mod:`pinotwin.export.runtime` without its docstring."""
    text = (files("pinotwin.export") / "runtime.py").read_text(encoding="utf-8")
    return text.split('"""', 2)[2].strip()


def literal(value: Any) -> str:
    """Return numbers as a Python literal of few digits and many items a line."""
    return pformat(_rounded(value), width=110, compact=True, sort_dicts=False)


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(x) for key, x in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(x) for x in value]
    return float(f"{value:.10g}") if isinstance(value, float) else value
