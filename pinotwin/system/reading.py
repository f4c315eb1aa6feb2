"""A value of a YAML file as its type says; anything else is refused with its whole path and what is expected there.

msgspec converts the values; the same types make the JSON Schema by which editors check a machine.yaml.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterable, Mapping
from types import UnionType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
from msgspec import Meta

from pinotwin.arrays import mapped
from pinotwin.errors import MachineError, nearest

_MOST = sys.float_info.max
Number = Annotated[float, Meta(ge=-_MOST, le=_MOST, description="a number")]
Positive = Annotated[float, Meta(gt=0.0, le=_MOST, description="a positive number")]
NotNegative = Annotated[float, Meta(ge=0.0, le=_MOST, description="a number that is not negative")]
Count = Annotated[int, Meta(ge=0, description="a whole number from 0")]


def from_file(kind: Any = None) -> dict[str, Any]:
    """Return the metadata of a field that the file states as another type, or, without one, does not state."""
    return {"file": kind}


def kinds_of(cls: type) -> dict[str, Any]:
    """Return key -> type of what a file states of a dataclass."""
    hints = get_type_hints(cls, include_extras=True)
    kinds = {f.name: f.metadata.get("file", hints[f.name]) for f in dataclasses.fields(cls)}
    return {key: kind for key, kind in kinds.items() if kind is not None}


def read(value: Any, kind: Any, where: str) -> Any:
    """Return a value as a type says, of a dataclass what is stated, by field; else MachineError with its path."""
    part = next((one for one in get_args(kind) if dataclasses.is_dataclass(one)), kind)
    if dataclasses.is_dataclass(part) and get_origin(kind) in (None, UnionType):
        return read_keys(value, kinds_of(part), where)  # type: ignore[arg-type]
    if dataclasses.is_dataclass(part) and get_origin(kind) is tuple:
        if not isinstance(value, list):
            raise MachineError(f"{where}: expected a list, found {value!r}")
        return [read(x, part, f"{where}[{i}]") for i, x in enumerate(value)]
    if get_origin(kind) in (dict, Mapping):
        named = {str(key): {} if x is None else x for key, x in _keys_of(value, where).items()}
        return {key: read(x, get_args(kind)[1], _join(where, key)) for key, x in named.items()}
    if kind is str and isinstance(value, int | float) and not isinstance(value, bool):
        return str(value)  # a name of digits
    try:
        plain = mapped(value, lambda x: x.tolist() if isinstance(x, np.generic | np.ndarray) else x)
        out = msgspec.convert(plain, kind, strict=False)
    except msgspec.ValidationError:
        raise MachineError(f"{where}: expected {_words(kind)}, found {value!r}") from None
    if any(isinstance(x, float) and not abs(x) <= _MOST for x in (out if isinstance(out, tuple) else [out])):
        raise MachineError(f"{where}: expected a finite number, found {value!r}")
    return out


def made(value: Any, kind: Any, where: str) -> Any:
    """Return a value as a type says, each dataclass in it made of what is stated; raises as :func:`read` does."""
    try:
        return msgspec.convert(read(value, kind, where), kind)
    except msgspec.ValidationError as error:
        raise MachineError(f"{where}: {error}") from None


def read_keys(value: Any, kinds: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the values that are stated under known keys, each as its type says; raises as :func:`read` does."""
    stated = _keys_of(value, where)
    for key in stated:
        known_key(key, kinds, where)
    return {key: read(x, kinds[key], _join(where, key)) for key, x in stated.items() if x is not None}


def _keys_of(value: Any, where: str) -> dict[Any, Any]:
    if not isinstance(value, dict):
        raise MachineError(f"{where}: expected keys and values, found {value!r}")
    return value


def known_key(key: Any, known: Iterable[str], where: str) -> None:
    """Refuse a key that is not known with its path and the nearest known one."""
    if key not in (names := tuple(known)):
        raise MachineError(f"{_join(where, key)}: unknown key; {nearest(str(key), names)}")


def schema(kind: Any) -> dict[str, Any]:
    """Return the JSON Schema of what :func:`read` reads as a type."""
    if dataclasses.is_dataclass(kind):
        rows = {key: schema(one) for key, one in kinds_of(kind).items()}  # type: ignore[arg-type]
        return {"type": "object", "properties": rows, "additionalProperties": False}
    if get_origin(kind) is dict:
        return {"type": "object", "additionalProperties": schema(get_args(kind)[1])}
    return msgspec.json.schema(kind)


def _words(kind: Any) -> str:
    kind = next((one for one in get_args(kind) if get_origin(one) is Annotated), kind)  # of an optional one
    if get_origin(kind) is Annotated:
        return str(kind.__metadata__[0].description)
    if get_origin(kind) is Literal:
        return " or ".join(map(str, get_args(kind)))
    if get_origin(kind) is tuple:
        return "a list" if Ellipsis in get_args(kind) else f"a list of {len(get_args(kind))}"
    plain = {bool: "true or false", float: "a number", int: "a whole number", str: "text"}
    return next((plain[one] for one in (kind, *get_args(kind)) if one in plain), "text")


def _join(where: str, key: Any) -> str:
    return f"{where}.{key}" if where else str(key)
