"""Reading machine.yaml: every key is known or refused with its path and the nearest known key."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_origin, get_type_hints

import numpy as np
import yaml

from pinotwin.effects import EFFECTS, Effect
from pinotwin.effects.known import kind_of, known, path_of
from pinotwin.errors import InputError, MachineError, nearest

DEFAULT_EFFECTS: tuple[Any, ...] = ("viscous", "coulomb")


_MOST_BYTES = 10_000_000
_MOST_NODES = 50_000


class _Loader(yaml.SafeLoader):
    """SafeLoader that refuses a key given twice and keeps `y`, `no`, `on` as text.

    YAML 1.1 reads the axis name ``Y`` as text but ``y`` and ``no`` as truth values; axis names must stay
    names.
    """


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    seen: dict[Any, Any] = {}
    for key_node, value_node in node.value:
        line = key_node.start_mark.line + 1
        if not isinstance(key_node, yaml.ScalarNode):
            raise MachineError(f"line {line}: a key must be one word, not a list or a mapping")
        key = loader.construct_object(key_node, deep=True)
        if key in seen:
            raise MachineError(f"line {line}: key {key!r} is given twice")
        seen[key] = loader.construct_object(value_node, deep=True)
    return seen


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)
_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag != "tag:yaml.org,2002:bool"]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the mapping in a YAML file.

    Raises:
        MachineError: no such file, a syntax error (with its line), or not a mapping.
    """
    if not path.is_file():
        raise MachineError(f"{path}: no such file; give a machine folder or its machine.yaml")
    try:
        content = _content(path)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f" line {mark.line + 1}:" if mark is not None else ""
        problem = getattr(error, "problem", None) or "not valid YAML"
        raise MachineError(f"{path}:{line} {problem}") from None
    except UnicodeDecodeError:
        raise MachineError(f"{path}: not a text file in UTF-8; save it as one") from None
    except (ValueError, OverflowError) as error:  # a date that is none, a number of thousands of digits
        raise MachineError(f"{path}: {error}; correct this value") from None
    except RecursionError:
        raise MachineError(f"{path}: lists in lists without end; a machine has a few levels") from None
    except OSError as error:
        raise MachineError(f"{path}: cannot be read: {error.strerror}; check its access") from None
    except MachineError as error:
        raise MachineError(f"{path}: {error}") from None
    if not isinstance(content, dict):
        raise MachineError(f"{path}: expected keys such as name, urdf, axes at the top level")
    return content


def _content(path: Path) -> Any:
    if path.stat().st_size > _MOST_BYTES:
        raise MachineError(f"is larger than {_MOST_BYTES} bytes; give a machine.yaml")
    loader = _Loader(path.read_text(encoding="utf-8-sig"))
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _size(node, {}, ())
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _size(node: yaml.Node, known: dict[yaml.Node, int], above: tuple[yaml.Node, ...]) -> int:
    """Return how many nodes there are once every alias is written out; refuse rings and floods."""
    if node in known:
        return known[node]
    if node in above:
        raise MachineError(f"line {node.start_mark.line + 1}: an alias that holds itself; write it out")
    parts = node.value if isinstance(node, yaml.CollectionNode) else []
    inner = [n for part in parts for n in (part if isinstance(part, tuple) else (part,))]
    size = 1 + sum(_size(n, known, (*above, node)) for n in inner)
    if size > _MOST_NODES:
        raise MachineError(
            f"holds more than {_MOST_NODES} entries, aliases written out; a machine has hundreds"
        )
    known[node] = size
    return size


def check_keys(given: Mapping[Any, Any], known: Sequence[str], where: str) -> None:
    """Refuse keys that are not known.

    Raises:
        MachineError: with the path of the key and the nearest known one.
    """
    for key in given:
        if key not in known:
            raise MachineError(f"{where}{key}: unknown key; {nearest(str(key), known)}")


def mapping(value: Any, where: str) -> dict[str, Any]:
    """Return ``value`` as a mapping (an empty one for nothing).

    Raises:
        MachineError: it is something else.
    """
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise MachineError(f"{where.rstrip('.')}: expected keys and values, found {value!r}")
    return value


def number(value: Any, where: str, *, positive: bool = False) -> float:
    """Return ``value`` as a finite float.

    Raises:
        MachineError: it is not a number, or not positive where it must be.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise MachineError(f"{where}: expected a number, found {value!r}")
    try:
        x = float(value)
    except (ValueError, OverflowError):
        raise MachineError(f"{where}: expected a number, found {value!r}") from None
    if not np.isfinite(x) or (positive and x <= 0.0):
        raise MachineError(f"{where}: expected a {'positive' if positive else 'finite'} number, found {x:g}")
    return x


def whole(value: Any, where: str, least: int, most: int | None = None) -> int:
    """Return ``value`` as a whole number from ``least`` to ``most``.

    Raises:
        MachineError: it is none.
    """
    x = number(value, where)
    if x != int(x) or x < least or (most is not None and x > most):
        upper = "" if most is None else f" to {most}"
        raise MachineError(f"{where}: expected a whole number from {least}{upper}, found {value!r}")
    return int(x)


def make_effects(specs: Any, axis: str, rotary: bool, where: str) -> tuple[Effect, ...]:
    """Return the effects of one axis from its YAML list.

    Each item is a name, a mapping of one name to its settings, or an effect or its class. An own effect is
    named as ``module:Class``.

    Raises:
        MachineError: with the path of what is wrong.
    """
    if isinstance(specs, str) or not isinstance(specs, (list, tuple)):
        raise MachineError(f"{where}: expected a list such as [viscous, coulomb], found {specs!r}")
    effects = [_make(spec, axis, rotary, f"{where}[{i}]") for i, spec in enumerate(specs)]
    names = [effect.name for effect in effects]
    for effect in effects:
        if names.count(effect.name) > 1 and not effect.several:
            raise MachineError(f"{where}: {effect.name} is listed twice")
    return tuple(effects)


def _make(spec: Any, axis: str, rotary: bool, where: str) -> Effect:
    if isinstance(spec, Effect):
        _kind(type(spec), where)
        return dataclasses.replace(spec, axis=axis, rotary=rotary)  # type: ignore[type-var]
    if isinstance(spec, str | type):
        name, settings = spec, dict[str, Any]()
    elif isinstance(spec, dict) and len(spec) == 1:
        name, settings = next(iter(spec.items()))
        settings = mapping(settings, f"{where}.{name}.")
    else:
        raise MachineError(f"{where}: expected an effect's name or {{name: settings}}, found {spec!r}")
    cls = _kind(name, where)
    fields, types = settings_of(cls), get_type_hints(cls)
    check_keys(settings, tuple(fields), f"{where}.{name}.")
    values = {
        fields[key]: _setting(
            value, types[fields[key]], f"{where}.{name}.{key}", signed=cls.name not in EFFECTS
        )
        for key, value in settings.items()
        if value is not None
    }
    effect = cls(axis=axis, rotary=rotary, **values)  # type: ignore[call-arg]
    _check_search(effect, f"{where}.{name}")
    return effect


def _kind(name: Any, where: str) -> type[Effect]:
    """Return the class of an effect that an axis may list."""
    if isinstance(name, str) and ":" not in name and name not in (names := known()):
        usable = [n for n, kind in names.items() if not kind.unlisted]
        raise MachineError(f"{where}: unknown effect {name!r}; {nearest(name, usable)}")
    try:
        kind = kind_of(name)
    except InputError as error:
        raise MachineError(f"{where}: {error}") from None
    if kind.unlisted:
        raise MachineError(f"{where}: {kind.name} {kind.unlisted}")
    return kind


def _check_search(effect: Effect, where: str) -> None:
    for shape in effect.shapes():
        if not shape.lower < shape.upper:
            raise MachineError(
                f"{where}: {shape.name} would be searched from {shape.lower:g} to {shape.upper:g} "
                f"{shape.unit}; the lower end must be below the upper"
            )


def settings_of(cls: type[Effect]) -> dict[str, str]:
    """Return YAML key -> dataclass field of what an effect lets the YAML set."""
    return {
        f.metadata.get("yaml", f.name): f.name
        for f in dataclasses.fields(cls)  # type: ignore[arg-type]
        if f.name not in ("axis", "rotary") and not f.metadata.get("internal")
    }


_SIGNED = ("eps", "start", "stop", "width", "span")  # may be zero or less; all others are sizes


def _setting(value: Any, kind: Any, where: str, *, signed: bool) -> Any:
    """Return a setting as the type of the effect's field; of an own effect every number may be zero or less."""
    if get_origin(kind) is tuple:
        items = value if isinstance(value, list) else [value]
        return tuple(whole(x, where, 1) for x in items)
    if kind is str:
        if not isinstance(value, str):
            raise MachineError(f"{where}: expected text, found {value!r}")
        return value
    if kind is bool:
        return truth(value, where)
    if kind is int:
        return whole(value, where, 0)
    return number(value, where, positive=not signed and where.rpartition(".")[2] not in _SIGNED)


def truth(value: Any, where: str) -> bool:
    """Return ``value`` as true or false.

    Raises:
        MachineError: it is neither.
    """
    if str(value).lower() not in ("true", "false"):
        raise MachineError(f"{where}: expected true or false, found {value!r}")
    return str(value).lower() == "true"


def effect_spec(effect: Effect) -> Any:
    """Return the YAML item that makes this effect again."""
    settings: dict[str, Any] = {}
    for f in dataclasses.fields(effect):  # type: ignore[arg-type]
        if f.name in ("axis", "rotary") or f.metadata.get("internal"):
            continue
        value = getattr(effect, f.name)
        if value == f.default or (f.name == "period" and getattr(effect, "free_pitch", False)):
            continue
        plain = [x for x in value] if isinstance(value, tuple) else value
        settings[f.metadata.get("yaml", f.name)] = plain
    kind = type(effect)
    name = effect.name if EFFECTS.get(effect.name) is kind else path_of(kind)
    return {name: settings} if settings else name
