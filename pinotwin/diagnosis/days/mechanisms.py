"""Causes as columns: name -> equation -> (n,) or (n, p). A number is a relative change where the part is known.

A mechanism that comes with the motion stands in :func:`mechanisms`; what is smooth in a channel and has no name stands
in :func:`descriptions`, as the rival of every name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pinotwin.arrays import Floats, Ints
from pinotwin.diagnosis.days.reference import Reference
from pinotwin.diagnosis.days.stretch import Columns, Stretch
from pinotwin.dynamics.batch import regressor
from pinotwin.effects.tree import Tree
from pinotwin.signals import hats, rms

Acts = dict[str, Floats]
Ends = tuple[float, float]
READ, TOLD = "read", "told"
"""Marks of a cause that is in the reading of the effort alone, and of a body that the controllers are told of."""
GROUPS = {
    "friction": ("friction_scale", "coulomb", "viscous"),
    "onset": ("friction_since", "friction_at_start"),
    "cross": ("cross_friction", "motor_coulomb", "motor_viscous"),
    "offset": ("offset", "drift", "zero", "zero_since"),
    "body": ("inertia", "payload"),
    "flex": ("compliance",),
    "law": (
        "position_gain",
        "proportional_gain",
        "loop_gain",
        "integral",
        "velocity_feedforward",
        "acceleration_feedforward",
        "dead_band",
    ),
    "play": ("lost_motion", "lost_motion_by_load", "lost_motion_either_side", "load_moved"),
    "time": ("push", "cut"),
    "place": ("tooth", "snag"),
    "form": (),  # every other effect of the catalogue, and those that a user brings
    "scale": ("effort_scale", "effort_late", "torque_constant", "torque_fades"),
    "encoder": ("encoder_scale", "encoder_grows", "encoder_step", "encoder_period", "encoder_along"),
    "limit": ("limit",),
    "recording": ("effort_of_another_run", "command_late", "clock_scale"),
    "describe": ("describe",),
}
GROUP = {name: group for group, names in GROUPS.items() for name in names}


def group_of(name: str) -> str:
    """Return the group of a row; forms are what no other group has."""
    return GROUP.get(name, "form")


GROWS = ("drift", "torque_fades", "encoder_grows")
"""What grows with a log's own time: no other log tells how far it has come there."""
POSSIBLE = {
    **dict.fromkeys(("friction_scale", "coulomb", "viscous", "friction_since"), (-1.0, 9.0)),
    **dict.fromkeys(("position_gain", "loop_gain", "proportional_gain"), (-0.9, 9.0)),
    **dict.fromkeys(("torque_constant", "torque_fades"), (-0.95, 9.0)),
    **dict.fromkeys((x for x in GROUPS["play"] if x.startswith("lost_motion")), (0.0, 10.0)),
    "friction_at_start": (0.0, 99.0),
    "effort_scale": (-9.0, 9.0),
    "dead_band": (0.0, 9.0),
    "integral": (-1.5, 9.0),
    "velocity_feedforward": (-2.0, 9.0),
    "acceleration_feedforward": (-4.0, 9.0),
    "compliance": (-1.0, 1e4),
}
"""Numbers that a machine can have after the change; of lost motion a millimetre, for more is a tooth or a slip."""
ENCODER = 1e-4  # one number of what an encoder reads otherwise [m or rad]
PLAY = -0.5e-4  # one number of lost motion in the gap between the encoders: 0.1 mm, half to either side


def mechanisms(
    r: Reference, s: Stretch, name: str, left: dict[tuple[str, str], Floats], since: float
) -> dict[str, Acts]:
    """Return what may act on an axis beside what its equations leave, columns of shape (n,) or (n, p).

    ``since``: when the stretch begins, in lengths of it, counted through the logs: a drift goes on in the next.
    """
    c, size = s.axes[name], r.widths[name]["effort"]
    rubs, ramp = c["dry"] + c["viscous"], s.t / s.t[-1]
    twin = rubs + c["rest"]
    out: dict[str, Acts] = {
        "friction_scale": {"plant": rubs},
        "coulomb": {"plant": part_of(c, "dry", size)},
        "viscous": {"plant": part_of(c, "viscous", size)},
        "offset": {"plant": c["one"] * size},
        "drift": {"plant": np.column_stack([c["one"], since + ramp]) * size},
        "inertia": {"plant": c["a"] * size / np.std(c["a"])},
        "effort_late": {"plant": -c["du"] * 1e-3},
        "effort_scale": {"plant": twin},
        "torque_constant": {"plant": twin},
        "torque_fades": {"plant": twin * ramp},
    }
    if name in r.laws and "e" in c:
        law = r.laws[name]
        out["effort_late"]["law"] = law.unfiltered(out["effort_late"]["plant"], s.step)
        out["effort_scale"]["law"] = c["u"] - left[name, "law"] - law["du"] * c["du"]
        out |= {k: {"law": x} for k, x in law.columns(c).items() if k in GROUPS["law"]}
    else:
        del out["torque_constant"]  # nothing tells it from a reading
    if name in r.twists and "gap" in c:
        out |= _between_encoders(r, c, name, ramp)
    for other in r.axes:
        if other != name:
            x = s.axes[other]["q"]
            x = (x - x.mean()) / max(float(np.ptp(x)), 1e-300)
            columns = np.column_stack([c["sg"], c["sg"] * x]) * size
            out[f"cross_friction:{other}"] = {"plant": columns}
    rows = c["moving"] > 0.0
    if rows.any() and _alike(c["dry"][rows], c["viscous"][rows]):
        del out["coulomb"], out["viscous"]  # at one speed they are one
    return out


def knows(c: Columns, part: str, size: float) -> bool:
    """Whether the twin knows any dry or viscous friction, beside an effort of this size [N or N·m]."""
    return bool(np.std(c[part]) > 1e-9 * size)


def part_of(c: Columns, part: str, size: float) -> Floats:
    """Return dry or viscous friction as the twin knows it, (n,); of the size of the effort where it knows none."""
    if knows(c, part, size):
        return np.asarray(c[part])
    course = c["v" if part == "viscous" else "sg"]
    return np.asarray(course * size / max(rms(course), 1e-300))


def _alike(a: Floats, b: Floats) -> bool:
    """Whether two columns have one course: their correlation is 0.97 and more."""
    a, b = a - a.mean(), b - b.mean()
    return abs(float(a @ b)) > 0.97 * float(np.linalg.norm(a) * np.linalg.norm(b))


def _between_encoders(r: Reference, c: Columns, name: str, ramp: Floats) -> dict[str, Acts]:
    twist, place = r.twist(name, c), (c["q"] - c["q"].mean()) * ENCODER
    # Where the bearing is that a screw grows away from is not known: its load moves as it grows.
    scale = np.column_stack([c["one"] * np.std(place), place])
    moved: dict[str, Acts] = {"load_moved": {"encoders": c["one"] * ENCODER}} if name in r.zeros else {}
    return moved | {
        "lost_motion": {"encoders": PLAY * c["memory"]},
        "lost_motion_by_load": {"encoders": PLAY * np.tanh(-twist / (0.1 * np.std(twist)))},
        "compliance": {"encoders": twist},
        "encoder_scale": {"encoders": scale if name in r.zeros else place},
        "encoder_grows": {"encoders": scale * ramp[:, None]},
    }


def starts(s: Stretch, name: str, stand: float) -> Ints:
    """Return the rows of the log at which a command sets out after a stand [s], shape (k,); none without a command."""
    m, j = s.motion, s.motion.names.index(name)
    if m.qr is None or not np.isfinite(m.qr[:, j]).all():
        return np.zeros(0, dtype=np.intp)
    speed = np.abs(np.diff(m.qr[:, j], prepend=m.qr[0, j])) / m.step
    moves = np.flatnonzero(speed > 1e-4 * float(speed.max(initial=0.0)) + 1e-12)
    stood = np.diff(moves, prepend=-len(m)) * m.step > stand
    return np.asarray(moves[stood], dtype=np.intp)


def after_starts(s: Stretch, name: str, long: float, stand: float) -> Floats:
    """Return the direction of motion for ``long`` after every start and 0 else, after the low-pass, shape (n,)."""
    m = s.motion
    on = np.zeros(len(m))
    for row in starts(s, name, stand):
        on[row : row + int(long / m.step)] = 1.0
    return s.taken(on * np.sign(m.v[:, m.names.index(name)]))


def zeros(r: Reference, s: Stretch, left: Mapping[tuple[str, str], Floats]) -> dict[str, dict[str, Floats]]:
    """Return what a zero does to every effort, over how far it is off: ``zero:AXIS`` -> axis -> (n,)."""
    names, out = r.twin.machine.names, {}
    q = s.motion.q[s.rows]
    for name in r.axes:
        one, shift, moving = np.array(names) == name, 0.0, s.axes[name]["moving"]
        for _ in range(6):  # a slope alone, -d tau / d q, ends where a ripple turns
            step = max(0.5 * abs(shift), 1e-3)
            ends = q + (step - 0.5 * shift) * one, q - (step + 0.5 * shift) * one
            low, high = (r.twin.predict(x, 0.0 * q, 0.0 * q) for x in ends)
            turn = s.low((high - low) / (2.0 * step))
            x = turn[:, names.index(name)]
            before = shift
            shift = float((x * moving) @ left[name, "plant"]) / max(float((x * moving) @ x), 1e-300)
            if abs(shift - before) < 1e-2 * step:
                break
        if np.std(x) > 1e-3 * r.widths[name]["effort"]:
            out[f"zero:{name}"] = {k: turn[:, names.index(k)] for k in r.axes}
    return out


def bodies(r: Reference, s: Stretch) -> dict[str, dict[str, Floats]]:
    """Return what a body does on every axis: ``payload`` on the last link, ``payload:AXIS`` on that of an axis.

    Each has mass, first moments and inertia as columns (n, 5) by axis.
    """
    machine, out = r.twin.machine, dict[str, dict[str, Floats]]()
    if len(r.axes) < 2:
        return out  # nothing tells it from an inertia
    tree = Tree(r.twin.model, machine.names, machine.rotary)
    at = {name: machine.names.index(name) for name in r.axes}
    efforts = np.array([[r.widths[k]["effort"]] for k in r.axes])
    parts, m = 10 * np.array([[tree.joint(k) - 1] for k in r.axes]) + np.arange(10), s.motion
    every = regressor(tree.model, m.q, m.v, m.a, parts.ravel())[:, list(at.values())]
    for link, values in zip(r.axes, np.split(every, len(r.axes), axis=2), strict=True):
        body = np.concatenate([values[..., :4], values[..., [4, 6, 9]].sum(axis=2, keepdims=True)], axis=2)
        body *= np.any(np.abs(body).max(axis=0) > 1e-6 * efforts, axis=0)  # less: rounding of a URDF's angles
        cause = "payload" if link == r.axes[-1] else f"payload:{link}"
        out[cause] = {k: s.taken(body[:, j]) for j, k in enumerate(at)}
    return out


def motors(r: Reference, s: Stretch) -> dict[str, dict[str, Floats]]:
    """Return what friction of a motor that turns several axes does: ``motor_coulomb:AXIS`` -> axis -> (n,)."""
    machine, out = r.twin.machine, dict[str, dict[str, Floats]]()
    at = [machine.names.index(k) for k in r.axes]
    ratios = np.eye(len(at)) if machine.transmission is None else machine.transmission[np.ix_(at, at)]
    for motor, ratio in zip(r.axes, ratios, strict=True):
        if np.count_nonzero(ratio) > 1:
            shares, size = ratio / np.abs(ratio).max(), r.widths[motor]["effort"]
            v = sum(x * s.axes[k]["v"] for k, x in zip(r.axes, shares, strict=True))
            parts = {"coulomb": s.low(v / np.hypot(v, 0.003 * np.abs(v).max())), "viscous": v / np.std(v)}
            for part, x in parts.items():
                out[f"motor_{part}:{motor}"] = {k: c * x * size for k, c in zip(r.axes, shares, strict=True)}
    return out


def descriptions(
    r: Reference,
    s: Stretch,
    name: str,
    ends: dict[str, Ends],
    run: tuple[int, int] | None = None,
    *,
    program: bool = False,
) -> dict[str, Acts]:
    """Return smooth functions of every channel, (n, k) each, as an effort or dry friction of a fifth of the effort.

    ``ends``: axis -> ends of its travel in all logs; ``run``: which of how many stretches this is, for a function of
    time is another one in each, and none of it holds elsewhere; ``program``: whether all runs follow one command.
    """
    c, w = s.axes[name], 0.2 * r.widths[name]["effort"]
    out: dict[str, Floats] = {}

    def both(what: str, x: Floats, low: float, high: float, count: int, kinds: Sequence[str]) -> None:
        B = hats(x, low, high, count) * w
        for kind in kinds:
            out[kind + what] = B * c["sg"][:, None] if kind else B

    both("place", c["q"], *ends[name], 16, ("", "dry "))
    for other in r.axes:
        if other != name:
            o = s.axes[other]
            both(f"place of {other}", o["q"], *ends[other], 6, ("", "dry "))
            both(f"speed of {other}", o["v"], -r.top[other], r.top[other], 5, ("",))
    both("speed", c["v"], -r.top[name], r.top[name], 8, ("",))
    a, rest = 3.0 * float(np.std(c["a"])), 2.5 * float(np.std(c["rest"]))
    both("acceleration", c["a"], -a, a, 7, ("",))
    both("load", c["rest"], -rest, rest, 6, ("dry ",))
    if run is not None:
        B, (at, many) = hats(s.t, 0.0, s.t[-1], 9) * w, run
        for kind in ("", "dry "):
            out[f"{kind}time"] = np.kron(np.eye(many)[at], B * c["sg"][:, None] if kind else B)
    if program:
        out["program"] = hats(s.t, 0.0, s.t[-1], 40) * w
    return {f"describe:{what}": {"plant": x} for what, x in out.items()}


def one_program(r: Reference, logs: Sequence[Stretch]) -> bool:
    """Whether all stretches follow one command."""
    lengths = [len(s.t) for s in logs]
    commanded = all("qr" in s.axes[name] for s in logs for name in r.axes)
    if len(logs) < 2 or max(lengths) - min(lengths) >= 3 or not commanded:
        return False
    for name in r.axes:
        first, *others = (s.axes[name]["qr"][: min(lengths) - 3] for s in logs)
        if max(np.std(first - x) for x in others) > 0.05 * max(float(np.std(first)), 1e-300):
            return False
    return True
