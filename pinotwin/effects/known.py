"""Which effects there are: the built-in ones, and those of users, which :func:`known` looks up.

An own effect is named as an object or a class in Python, as ``module:Class`` in machine.yaml, by an entry point of the
group ``pinotwin.effects``, or by ``--effects file.py`` on the command line.
"""

from __future__ import annotations

import functools
import importlib
import importlib.metadata
import importlib.util
import inspect
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from pathlib import Path
from types import ModuleType
from typing import Any, ParamSpec, TypeVar

from pinotwin.effects import friction, load, position, ripple, sensing, servo, transmission
from pinotwin.effects.effect import Effect, OneAxis
from pinotwin.effects.hysteresis import Hysteresis
from pinotwin.effects.presliding import Presliding
from pinotwin.effects.rigid_body import InertialCoupling, RigidBody, WristCoupling
from pinotwin.errors import InputError, MachineError, require

EFFECTS: dict[str, type[Effect]] = {
    effect.name: effect
    for effect in (
        RigidBody,
        friction.Viscous,
        friction.ViscousAsymmetric,
        friction.Coulomb,
        friction.CoulombAsymmetric,
        friction.Stribeck,
        Presliding,
        friction.LoadFriction,
        friction.ViscousThermal,
        friction.QuadraticDrag,
        Hysteresis,
        position.Offset,
        ripple.Ripple,
        ripple.RippleModulated,
        position.PositionTable,
        position.Spring,
        InertialCoupling,
        WristCoupling,
        transmission.DriveFlexibility,
        transmission.JointFlexibility,
        transmission.Backlash,
        sensing.Delay,
        sensing.EffortScale,
        sensing.EncoderError,
        load.Payload,
        load.ExternalForce,
        load.GeometricError,
        servo.Feedforward,
        servo.LoopGain,
        servo.Saturation,
    )
}
"""Name -> effect. ``LISTED`` has those that machine.yaml may list under an axis."""

LISTED: tuple[str, ...] = tuple(name for name, effect in EFFECTS.items() if not effect.unlisted)
"""Names that an axis may list in machine.yaml."""

EffectLike = Effect | type[Effect] | str  # An effect, its class, ``module:Class``, or the name of a known one

_BROKEN: tuple[type[Exception], ...] = (ArithmeticError, AttributeError, ImportError, LookupError, NameError)
_BROKEN += (OSError, SyntaxError, TypeError, ValueError)  # what a file with a mistake raises
P = ParamSpec("P")
T = TypeVar("T")
_GIVEN: ContextVar[tuple[type[Effect], ...]] = ContextVar("given effects", default=())


def effect_name(key: str) -> str:
    """Return the plain name of an effect from its key, ``Y.ripple#2`` -> ``ripple``."""
    return key.rsplit(".", 1)[-1].split("#")[0]


def known(effects: Iterable[Effect] = ()) -> Mapping[str, type[Effect]]:
    """Return every effect by name: built-in, installed, given, and those of a machine or twin."""
    own = (*_installed(), *_GIVEN.get(), *(type(e) for e in effects))
    return {**{kind.name: kind for kind in own}, **EFFECTS}


@contextmanager
def given(effects: Iterable[EffectLike]) -> Iterator[None]:
    """Know further effects inside a ``with`` block, beside those that are given already."""
    token = _GIVEN.set((*_GIVEN.get(), *map(kind_of, effects)))
    try:
        yield
    finally:
        _GIVEN.reset(token)


def given_files(paths: Iterable[str]) -> AbstractContextManager[None]:
    """Know the effects that some Python files define inside a ``with`` block; see :func:`effects_of_file`."""
    return given([kind for path in paths for kind in effects_of_file(path)])


def with_given(function: Callable[P, T]) -> Callable[P, T]:
    """Let the keyword ``effects`` of a function be known while it runs."""

    @functools.wraps(function)
    def inner(*args: P.args, **options: P.kwargs) -> T:
        effects: Any = options.get("effects") or ()
        with given(effects):
            return function(*args, **options)

    return inner


def kind_of(effect: EffectLike) -> type[Effect]:
    """Return the class of an effect, checked."""
    if isinstance(effect, Effect):
        return check_effect(type(effect))
    if isinstance(effect, type) and issubclass(effect, Effect):
        return check_effect(effect)
    if isinstance(effect, str):
        if ":" in effect:
            return resolve(effect)
        names = known()
        require(effect, names, "unknown effect", InputError)
        return names[effect]
    raise InputError(f"expected an Effect, its class or module:Class, not {type(effect).__name__}")


def check_effect(kind: type[Effect]) -> type[Effect]:
    """Return an effect's class; InputError if it is abstract, no dataclass, or has no name of its own."""
    where = f"effect {kind.__module__}:{kind.__qualname__}"
    missing = sorted(getattr(kind, "__abstractmethods__", ()))
    if kind.coefficients is OneAxis.coefficients and not hasattr(kind, "linear"):
        missing.append("coefficients")
    if missing:
        raise InputError(f"{where}: does not define {', '.join(missing)}")
    if "axis" not in vars(kind).get("__dataclass_fields__", {}):
        raise InputError(f"{where}: write @dataclass(frozen=True) above it, with the field axis: str")
    name = getattr(kind, "name", "")
    if not isinstance(name, str) or not name.isidentifier():
        raise InputError(f"{where}: name: expected a word such as root_drag, found {name!r}")
    if EFFECTS.get(name, kind) is not kind:
        raise InputError(f"{where}: {name} is a built-in effect; choose another name")
    return kind


def path_of(kind: type[Effect]) -> str:
    """Return ``module:Class``, by which machine.yaml names an own effect; MachineError for one inside a function."""
    if "<locals>" in kind.__qualname__:
        raise MachineError(
            f"effect {kind.name}: its class stands inside a function; move it to the top of a module, "
            "so that a saved machine can name it"
        )
    return f"{kind.__module__}:{kind.__qualname__}"


def resolve(path: str) -> type[Effect]:
    """Return the class of an effect that ``module:Class`` names."""
    module_name, _, name = path.partition(":")
    for kind in _GIVEN.get():
        if kind.__qualname__ == name:
            return kind
    remedy = f"put the module on the Python path, or name its file with --effects {module_name}.py"
    if module_name == "__main__":
        remedy = "it was defined in a notebook or script: name a file that holds it with --effects FILE.py"
    try:
        found: Any = importlib.import_module(module_name)
    except _BROKEN as error:
        raise InputError(f"effect {path}: {error}; {remedy}") from None
    for part in name.split("."):
        found = getattr(found, part, None)
    if not (isinstance(found, type) and issubclass(found, Effect)):
        raise InputError(f"effect {path}: module {module_name} holds no effect {name!r}; {remedy}")
    return check_effect(found)


def effects_of_file(path: str | Path) -> tuple[type[Effect], ...]:
    """Return the effects that a Python file defines; their module is called as the file is."""
    file = Path(path).resolve()
    if not file.is_file() or file.suffix != ".py":
        raise InputError(f"--effects: {path}: no such file; give a Python file (.py) with effects")
    module = _loaded(file)
    kinds = [x for x in vars(module).values() if isinstance(x, type) and issubclass(x, Effect)]
    own = [x for x in kinds if x.__module__ == module.__name__ and not inspect.isabstract(x)]
    if not own:
        raise InputError(f"--effects: {path}: defines no effect; derive a class from pinotwin.Effect")
    return tuple(map(check_effect, own))


def _loaded(file: Path) -> ModuleType:
    """Return the module of a file, run once."""
    there = sys.modules.get(file.stem)
    if there is not None:
        if Path(getattr(there, "__file__", None) or "").resolve() == file:
            return there
        raise InputError(
            f"--effects: {file.name}: Python has a module {file.stem!r} already; rename the file"
        )
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[file.stem] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except _BROKEN as error:
        del sys.modules[file.stem]
        raise InputError(
            f"--effects: {file.name}: {type(error).__name__}: {error}; correct the file"
        ) from None
    return module


@functools.cache
def _installed() -> tuple[type[Effect], ...]:
    """Return the effects of installed packages."""
    return tuple(resolve(point.value) for point in importlib.metadata.entry_points(group="pinotwin.effects"))
