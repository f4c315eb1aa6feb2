"""The machines of a bench: bundled, random or a user's folder; and the copy that a diagnosis sees."""

from __future__ import annotations

import functools
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from pinotwin.bench.catalogue import COVERED_BY, TAKEN_OUT
from pinotwin.errors import InputError, nearest
from pinotwin.machine import Machine
from pinotwin.machine.bundled import machines
from pinotwin.machine.from_model import new_folder
from pinotwin.machine.yaml_file import read_yaml
from pinotwin.virtual import VirtualMachine
from pinotwin.virtual.random_machine import write_random_machine

HEALTHY: dict[str, tuple[str, ...]] = {
    "trunnion": ("stribeck:C",),
    "laser_driller": ("joint_flexibility",),
    "emps": ("coulomb_asymmetric", "drive_flexibility", "stribeck", "presliding"),
}
"""Machine -> effects of its truth that its machine.yaml does not list: withheld in every case."""

Placed = Sequence[tuple[str, str, float]]  # (effect, axis, size) of what is put into a truth


@functools.cache
def sealed_folder(name: str) -> Path:
    """Return the folder of a machine with its truth: a bundled name, ``random:SEED`` or a folder."""
    kind, _, seed = name.partition(":")
    if kind == "random":
        if not seed.isdigit():
            raise InputError(f"machine {name!r}: a random machine is written random:SEED")
        return write_random_machine(new_folder() / f"sealed-{seed}", int(seed))
    if name in machines():
        return machines()[name]
    if not (Path(name) / "machine.yaml").is_file():
        known = nearest(name, [*machines(), "random:1"])
        raise InputError(f"no machine {name!r}, nor a folder with machine.yaml; {known}")
    return Path(name)


@functools.cache
def listing(name: str) -> Mapping[str, tuple[Any, ...]]:
    """Return what machine.yaml lists: axis -> items."""
    axes = read_yaml(sealed_folder(name) / "machine.yaml")["axes"]
    return {
        str(axis): tuple((spec or {}).get("effects", ("viscous", "coulomb"))) for axis, spec in axes.items()
    }


def is_listed(name: str, effect: str, axis: str) -> bool:
    """Whether the listing of an axis covers an effect, under its own name or another."""
    covers = COVERED_BY.get(effect, ())
    items = map(_named, listing(name)[axis])
    if effect == "stribeck":
        return any(n == "stribeck" or (n == "presliding" and s.get("stribeck", 1)) for n, s in items)
    return any(n in covers for n, _ in items)


def _named(item: Any) -> tuple[str, Mapping[str, Any]]:
    """Return the effect's name and the settings of an item of a listing."""
    name, given = (item, None) if isinstance(item, str) else next(iter(item.items()))
    return name, given or {}


def without(items: Sequence[Any], effect: str) -> list[Any]:
    """Return a listing that does not know an effect, but knows the rest of its friction still."""
    covers = COVERED_BY.get(effect, ())
    out: list[Any] = []
    for item in items:
        name, settings = _named(item)
        if name not in covers:
            out.append(item)
        elif name == "presliding" and effect == "stribeck":
            out.append({"presliding": {**settings, "stribeck": 0}})
        elif name == "presliding" and effect in ("presliding", "gms"):
            out += ["coulomb", "stribeck"] if settings.get("stribeck", 1) else ["coulomb"]
    return out


def public_machine(name: str, withheld: Placed = ()) -> Machine:
    """Return the machine as a diagnosis may see it: without its truth, and without some effects on its listing."""
    pairs = [(e, a) for e, a, _ in withheld if is_listed(name, e, a)]
    return _public(name, tuple(pairs))


@functools.lru_cache(maxsize=64)
def _public(name: str, pairs: tuple[tuple[str, str], ...]) -> Machine:
    source = sealed_folder(name)
    content = read_yaml(source / "machine.yaml")
    for effect, axis in pairs:
        spec = dict(content["axes"][axis] or {})
        spec["effects"] = without(spec.get("effects", ("viscous", "coulomb")), effect)
        content["axes"][axis] = spec
    folder = new_folder()
    shutil.copytree(source, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("virtual.yaml"))
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
    (folder / "machine.yaml").write_text(text, encoding="utf-8")
    return Machine.load(folder)


def virtual(name: str, *, off: Placed = (), on: Placed = (), seed: int = 0) -> VirtualMachine:
    """Return the virtual machine of a case: without what its listing lost (``off``), with what was put in (``on``)."""
    withhold = list(HEALTHY.get(name, ()))
    for effect, axis, _ in off:
        if is_listed(name, effect, axis):
            withhold += [f"{e}:{axis}" for e in TAKEN_OUT.get(effect, (effect,))]
    inject = [
        {"effect": e, "axis": a, "size": s, "seed": seed % 100003 + k} for k, (e, a, s) in enumerate(on)
    ]
    return VirtualMachine.load(sealed_folder(name), withhold=withhold, inject=inject)
