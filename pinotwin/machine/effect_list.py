"""The effects of an axis from its list in machine.yaml, and back."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any, get_origin, get_type_hints

from msgspec import Meta

from pinotwin.effects import EFFECTS, Effect
from pinotwin.effects.known import kind_of, known, path_of
from pinotwin.errors import InputError, MachineError, nearest
from pinotwin.machine.parts import EffectList
from pinotwin.system.reading import Count, Number, Positive, read, read_keys

_One = Annotated[int, Meta(ge=1)]
_Harmonics = Annotated[_One | list[_One], Meta(description="a whole number from 1, or a list of them")]
_SIGNED = ("eps", "start", "stop", "width", "span")  # may be zero or less; all others are sizes


def make_effects(specs: Any, axis: str, rotary: bool, where: str) -> tuple[Effect, ...]:
    """Return the effects of one axis from its YAML list: names, settings by name, effects, ``module:Class``."""
    given = read(specs, EffectList, where)
    effects = [_make(spec, axis, rotary, f"{where}[{i}]") for i, spec in enumerate(given)]
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
        name, given = spec, None
    elif isinstance(spec, dict) and len(spec) == 1:
        name, given = next(iter(spec.items()))
    else:
        raise MachineError(f"{where}: expected an effect's name or {{name: settings}}, found {spec!r}")
    cls, values = _kind(name, where), {}
    fields, types, where = settings_of(cls), types_of(cls), f"{where}.{name}"
    for key, x in read_keys({} if given is None else given, types, where).items():
        several = types[key] is _Harmonics
        values[fields[key]] = tuple(x if isinstance(x, list) else [x]) if several else x
    effect = cls(axis=axis, rotary=rotary, **values)  # type: ignore[call-arg]
    for shape in effect.shapes():
        if not shape.lower < shape.upper:
            raise MachineError(
                f"{where}: {shape.name} would be searched from {shape.lower:g} to {shape.upper:g} "
                f"{shape.unit}; the lower end must be below the upper"
            )
    return effect


def _kind(name: Any, where: str) -> type[Effect]:
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


def settings_of(cls: type[Effect]) -> dict[str, str]:
    """Return YAML key -> dataclass field of what an effect lets the YAML set."""
    return {
        f.metadata.get("yaml", f.name): f.name
        for f in dataclasses.fields(cls)  # type: ignore[arg-type]
        if f.name not in ("axis", "rotary") and not f.metadata.get("internal")
    }


def types_of(cls: type[Effect]) -> dict[str, Any]:
    """Return YAML key -> type of each setting; numbers of an own effect may be zero or less."""
    hints = get_type_hints(cls)
    kinds = {int: Count, str: str, bool: bool}
    out = {}
    for key, field in settings_of(cls).items():
        number = Number if cls.name not in EFFECTS or key in _SIGNED else Positive
        out[key] = _Harmonics if get_origin(hints[field]) is tuple else kinds.get(hints[field], number)
    return out


def effect_spec(effect: Effect) -> Any:
    """Return the YAML item that makes this effect again."""
    settings: dict[str, Any] = {}
    kind = type(effect)
    for key, field in settings_of(kind).items():
        value = getattr(effect, field)
        searched = field == "period" and getattr(effect, "free_pitch", False)
        if not searched and value != getattr(kind, field, None):
            settings[key] = list(value) if isinstance(value, tuple) else value
    name = effect.name if EFFECTS.get(effect.name) is kind else path_of(kind)
    return {name: settings} if settings else name
