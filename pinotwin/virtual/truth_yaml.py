"""Read ``virtual.yaml`` into :class:`~pinotwin.virtual.truth.Truth`; unknown keys are errors."""

from __future__ import annotations

import dataclasses
import types
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

import yaml

from pinotwin.errors import MachineError, nearest
from pinotwin.virtual.truth import Truth


def read_truth(path: Path) -> Truth:
    """Return the truth in a YAML file.

    Raises:
        MachineError: the file is not YAML, or a key or a value in it cannot be used.
    """
    try:
        raw = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise MachineError(f"{path}: not YAML: {' '.join(str(error).split())}") from None
    truth: Truth = build(Truth, raw, str(path))
    return truth


def build(kind: Any, raw: Any, where: str) -> Any:
    """Return ``raw`` (plain YAML) as an instance of ``kind`` (dataclass, tuple, mapping or number).

    Args:
        kind: the type to build.
        raw: what the YAML says.
        where: file and keys so far, for messages.
    """
    origin, args = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        inner = next(a for a in args if a is not type(None))
        return None if raw is None else build(inner, raw, where)
    if dataclasses.is_dataclass(kind):
        return _dataclass(kind, raw, where)
    if origin is Mapping or (isinstance(origin, type) and issubclass(origin, Mapping)):
        return {str(k): build(args[1], v, f"{where}[{k}]") for k, v in (raw or {}).items()}
    if origin is tuple:
        return _tuple(args, raw, where)
    return _scalar(kind, raw, where)


def _dataclass(kind: Any, raw: Any, where: str) -> Any:
    if raw is None:
        raw = {}
    if not isinstance(raw, Mapping):
        raise MachineError(f"{where}: expected keys and values, found {raw!r}")
    hints = get_type_hints(kind)
    for key in raw:
        if key not in hints:
            raise MachineError(f"{where}: unknown key {key!r}; {nearest(str(key), hints)}")
    values = {key: build(hints[key], value, f"{where}.{key}") for key, value in raw.items()}
    try:
        return kind(**values)
    except TypeError as error:
        raise MachineError(f"{where}: {error}") from None


def _tuple(args: tuple[Any, ...], raw: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(raw, list | tuple):
        raise MachineError(f"{where}: expected a list, found {raw!r}")
    kinds = [args[0]] * len(raw) if len(args) == 2 and args[1] is Ellipsis else list(args)
    if len(kinds) != len(raw):
        raise MachineError(f"{where}: expected {len(kinds)} values, found {len(raw)}")
    return tuple(build(k, v, f"{where}[{i}]") for i, (k, v) in enumerate(zip(kinds, raw, strict=True)))


def _scalar(kind: Any, raw: Any, where: str) -> Any:
    if kind is float and isinstance(raw, str):  # YAML 1.1 reads 1e-6 as a word
        try:
            raw = float(raw)
        except ValueError:
            raise MachineError(f"{where}: expected a number, found {raw!r}") from None
    if kind is bool or kind is str:
        good = isinstance(raw, kind)
    else:
        good = isinstance(raw, int | float) and not isinstance(raw, bool)
    if not good:
        raise MachineError(f"{where}: expected {kind.__name__}, found {raw!r}")
    return kind(raw)
