"""``check``: what is wrong with a machine or a log, and what a log can identify, before any fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pinotwin.arrays import Floats
from pinotwin.dynamics.excitation import Excitation, excitation
from pinotwin.dynamics.parameters import parameters
from pinotwin.dynamics.plausible import oversized_bodies
from pinotwin.errors import InputError, MachineError
from pinotwin.logs.files import LogLike, as_log
from pinotwin.logs.plausible import unseen
from pinotwin.logs.prepared import Prepared
from pinotwin.logs.quality.results import Finding, Quality, finding
from pinotwin.logs.settings import USUAL, Settings
from pinotwin.machine import Machine, MachineLike, as_machine
from pinotwin.machine.urdf import impossible_bodies
from pinotwin.machine.urdf_check import FREE, MOVING, incomplete, mimics, read_tree
from pinotwin.motion import Motion
from pinotwin.notebook import Card, Shown
from pinotwin.signals import rms

_SCALE = ("position_limit", "speed_limit", "effort_scale")
_POSITION = (*_SCALE, "axis_still", "position_unit", "command_disagrees")
_CONSEQUENCES: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("rows_doubled", "rows_lost", "command_jitter"), ("effort_strange", "command_late")),
    **dict.fromkeys(("rows_held", "interpolated"), ("effort_strange", "rows_doubled", "command_late")),
    "effort_noise": ("loop_unstable",),
    "effort_stands": ("loop_unstable",),
    "sentinel": (*_POSITION, "effort_limit", "effort_noise", "effort_lead", "few_digits"),
    "spikes": _POSITION,
    "position_unit": _SCALE,
    "position_exchanged": ("position_limit", "speed_limit"),
    "effort_exchanged": ("effort_limit", "effort_lead"),
    "effort_scale": ("effort_limit", "effort_weightless"),
    "effort_late": ("effort_lead",),
    "effort_early": ("effort_lead",),
}
"""Code of a cause -> codes that follow from it on the same axis: the cause alone is worth a line."""


@dataclass(frozen=True, repr=False)
class Check(Card):
    """What the examination of a machine, and of a log with it, found."""

    machine: Machine  # the machine
    findings: tuple[Finding, ...]  # about machine and log, gravest first
    quality: Quality | None = None  # of the log, None without one
    excited: Excitation | None = None  # what the log can tell of the base parameters; None where unknown
    determined: Mapping[str, bool] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether nothing forbids going on."""
        return not any(finding.severity == "error" for finding in self.findings)

    def _shown(self) -> Shown:
        rows = [(f.severity, f.channel, f.message) for f in self.findings if f.severity != "info"]
        known = f"{sum(self.determined.values())} of " if self.determined else ""
        told = f"{known}{len(self.machine.base)} base parameters" + (" can be identified" if known else "")
        heads = ("", "channel", "finding") if rows else ()
        return (f"Check of {self.machine.name}: {'ok' if self.ok else 'not usable'}", heads, rows, told)

    def as_dict(self) -> dict[str, Any]:
        """Return the result in JSON's types."""
        base = self.machine.base
        axes = {
            name: {"joint": x.joint, "rotary": x.rotary, "effects": [effect.name for effect in x.effects]}
            for name, x in self.machine.axes.items()
        }
        parameters = [
            {"name": label, "meaning": name, "unit": unit, "excited": self.determined.get(label)}
            for label, name, unit in zip(base.labels, base.names, base.units, strict=True)
        ]
        told = ("severity", "channel", "axis", "code", "message")
        return {
            "machine": self.machine.name,
            "ok": self.ok,
            "axes": axes,
            "base_parameters": parameters,
            "findings": [{key: getattr(one, key) for key in told} for one in self.findings],
            "log": None if self.quality is None else self.quality.as_dict(),
            "condition": None if self.excited is None else self.excited.condition,
        }


def check(machine: MachineLike, log: LogLike | None = None, *, settings: Settings = USUAL) -> Check:
    """Examine a machine, and what a log of it can identify.

    Args:
        machine: the machine; or its folder, URDF or bundled name, or a ``pin.Model``.
        log: a servo log of it or its file, raw or in the names of the contract.
        settings: what is decided by.
    """
    machine = as_machine(machine)
    findings = machine_findings(machine)
    if log is None:
        return Check(machine, tuple(findings))
    one = Prepared(machine, as_log(log), settings=settings)
    findings += one.findings
    excited = None
    if one.quality.ok and not any(f.code == "unusable" for f in one.findings):
        findings += unseen(machine, one.motion, one.efforts) if one.efforts else []
        try:
            excited = _excitation(machine, one.motion)
            findings += _excitation_findings(machine, excited)
        except InputError as error:
            findings.append(finding("unusable", why=str(error)))
    determined = {} if excited is None else {x: x in excited.determined for x in machine.base.labels}
    findings = sorted(_causes(findings), key=lambda f: ("error", "warning", "info").index(f.severity))
    return Check(machine, tuple(findings), one.quality, excited, determined)


def _causes(findings: Sequence[Finding]) -> list[Finding]:
    """Return findings without those that only follow from another one."""
    told: set[tuple[str, str]] = set()
    for f in findings:
        told |= {(axis, code) for axis in f.axis.split(", ") for code in _CONSEQUENCES.get(f.code, ())}

    def follows(f: Finding) -> bool:
        return ("", f.code) in told or all((axis, f.code) in told for axis in f.axis.split(", "))

    return [f for f in findings if not follows(f)]


def machine_findings(machine: Machine) -> list[Finding]:
    """Return what the tree of a machine, and its URDF, say."""
    root, model = read_tree(machine.urdf), machine.model
    out = [finding("urdf_invalid", part, problems=text) for part, text in incomplete(root).items()]
    out += [finding("body_impossible", joint, problem=x) for joint, x in impossible_bodies(model).items()]
    for joint, (radius, size) in oversized_bodies(model).items():
        out.append(finding("body_oversized", joint, radius=radius, size=size))
    out += [finding("joint_free", str(j.get("name"))) for j in root.findall("joint") if j.get("type") in FREE]
    followers = {joint: leader for joint, leader in mimics(root).items() if joint not in model.names}
    out += [finding("joint_mimics", joint, leader=repr(leader)) for joint, leader in followers.items()]
    moved = {j.find("child").get("link") for j in root.findall("joint") if j.get("type") in MOVING}  # type: ignore[union-attr]
    for link in root.findall("link"):
        if link.find("inertial") is None and link.get("name") in moved:
            out.append(finding("link_massless", str(link.get("name"))))
    without = machine.base.without_effect
    if without:
        shown = ", ".join(without[:6]) + (" ..." if len(without) > 6 else "")
        out.append(finding("no_effect", count=len(without), names=shown))
    return out


def _excitation(machine: Machine, motion: Motion, most: int = 20_000) -> Excitation:
    """Return what some usable rows of a log tell of the base parameters, joints weighed by effort."""
    inside = np.r_[*motion.segments]
    inside = inside[:: max(1, len(inside) // most)]
    w = machine.base.regressor(machine.model, motion.q[inside], motion.v[inside], motion.a[inside])
    rows = []
    for joint in range(machine.nv):
        u = motion.u[inside, joint]
        usable = motion.use[inside, joint] & np.isfinite(u)
        if (size := rms(u[usable])) > 0.0:
            rows.append(w[usable, joint] / size)
    if not rows:
        raise MachineError(f"{motion.source}: no axis has both motion and effort")
    return excitation(np.concatenate(rows), machine.base.labels, size=_usual_sizes(machine))


def _usual_sizes(machine: Machine) -> Floats:
    """Return the magnitude to expect of each base parameter: where CAD says zero, a tenth of others of its kind."""
    beta = np.abs(machine.base.from_standard(parameters(machine.model)))
    units = np.array(machine.base.units)
    floor = {unit: 0.1 * rms(beta[units == unit]) for unit in set(units)}
    return np.maximum(beta, [floor[unit] or 1e-3 for unit in units])


def _excitation_findings(machine: Machine, excited: Excitation) -> list[Finding]:
    out = []
    meaning = dict(zip(machine.base.labels, machine.base.names, strict=True))
    for group in excited.unexcited:
        names = [meaning[name] for name in group.names]
        code = "not_excited" if len(names) == group.free == 1 else "not_separable"
        out.append(finding(code, names="; ".join(names)))
    counts = {"count": len(excited.determined), "of": len(excited.names)}
    return [*out, finding("identifiable", **counts, condition=excited.condition)]
