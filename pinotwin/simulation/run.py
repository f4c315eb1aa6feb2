"""``simulate``: what the machine will do for a command, from a cold start, nothing measured."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from pinotwin.arrays import Floats
from pinotwin.effects import Effect
from pinotwin.errors import DataError, InputError, TwinError, nearest
from pinotwin.log import Log
from pinotwin.logs.files.given import LogLike, as_log
from pinotwin.loop import LoopModel, Servo, close
from pinotwin.motion import Motion
from pinotwin.simulation import coupled, coupled_kernel, kernel
from pinotwin.simulation.blocks import lay_blocks
from pinotwin.simulation.command import Request, beginning, motor_coordinates, request
from pinotwin.simulation.plant import Plant, plant_of
from pinotwin.simulation.prediction import Prediction
from pinotwin.simulation.score import bound
from pinotwin.simulation.state import Command, Record
from pinotwin.system.threads import one_blas_thread
from pinotwin.twin.twin import TwinLike, as_twin

if TYPE_CHECKING:
    from pinotwin.twin import Twin

PASSES = 40
_RELAX = 0.5
_KEPT = 20  # passes that the next effort is combined from
_LOST = 0.05  # change after the last pass beyond which there is no answer
_SAME = 1e-3  # change of the effort between passes, RMS, as a share of its own

Loops = str | Mapping[str, Servo]
"""One of :data:`FORMS`, or controllers by axis."""
FORMS = ("coupled", "black", "vibration")


@dataclass(frozen=True, eq=False)
class Response:
    """What the machine does; arrays of shape (n, nv) in joint coordinates, SI.

    Attributes:
        request: what was asked.
        names: joint name of every column.
        q: position.
        v: velocity.
        a: acceleration.
        e: tracking error, command minus position.
        u: motor effort.
        d: generalised disturbance.
        loops: the closed loops that were used.
        substeps: internal steps a sample.
        notes: what deserves attention.
    """

    request: Request
    names: tuple[str, ...]
    q: Floats
    v: Floats
    a: Floats
    e: Floats
    u: Floats
    d: Floats
    loops: Mapping[str, LoopModel]
    substeps: int
    notes: tuple[str, ...]


def simulate(
    twin: TwinLike, log: LogLike, *, step: float | None = None, controller: Loops | None = None
) -> Prediction:
    """Return position, tracking error and effort that the machine will show for a command.

    Args:
        twin: the machine, with its loops; or its folder.
        log: ``t``, ``<axis>.qr`` and, if any, external loads ``<link>.fx`` ...; nothing else of it is
            used.
        step: longest internal step [s]; the log's own sampling is kept for the result.
        controller: None: the form that predicted held-out data best when the twin was identified
            (``twin.quality["simulation"]``). ``"coupled"``: the identified controllers around the
            identified plant; ``"black"``: the identified transfer functions; ``"vibration"``: as ``"black"``, but
            an axis on a passive joint takes the loop that holds the joint's vibration (thesis Eq.
            5.8); or controllers by axis, in place of identified ones.

    Returns:
        Channels ``t``, ``<axis>.q .e .u`` and ``<passive>.q .v .a``; SI, as the log counts them. ``<axis>.ql``
        too where the loop is closed on the load's encoder: the same as ``.q``, for the drive is stiff, and ``.e``
        is the command minus it.

    Raises:
        LogError: a command is missing or has holes.
        TwinError: the twin has no closed loop.
        DataError: the simulated machine leaves its command.
    """
    twin, log = as_twin(twin), as_log(log)
    found = respond(twin, log, step=step, controller=controller, full=bool(twin.machine.passive))
    asked, machine = found.request, twin.machine
    q, e, u = motor_coordinates(machine, *(asked.at_stamps(x) for x in (found.q, found.e, found.u)))
    channels = {"t": asked.t}
    for axis in machine.axes.values():
        if axis.lead:  # the log's effort is ahead of its position: what acts at t is written down before
            then = np.clip(asked.t + axis.lead, asked.t[0], asked.t[-1])
            u[:, axis.index] = CubicSpline(asked.t, u[:, axis.index])(then)
    for name, axis in machine.axes.items():
        for kind, x in (("q", q), ("e", e), ("u", u)):
            channels[f"{name}.{kind}"] = x[:, axis.index]
        if machine.regulated(name).endswith(".ql"):
            channels[f"{name}.ql"] = channels[f"{name}.q"]
    for name, part in machine.passive.items():
        channels[f"{name}.q"] = q[:, part.index]
        for kind, x in (("v", found.v), ("a", found.a)):
            channels[f"{name}.{kind}"] = asked.at_stamps(x)[:, part.index]
    return Prediction(
        channels,
        source=f"simulation of {asked.source}",
        notes=found.notes,
        twin=twin,
        command=bound(machine, log),
        controller=controller if isinstance(controller, str) else "given" if controller else preferred(twin),
    )


@one_blas_thread
def respond(
    twin: Twin,
    log: Log | Motion,
    *,
    step: float | None = None,
    controller: Loops | None = None,
    full: bool = True,
    every_step: bool = False,
) -> Response:
    """Return the whole response in joint coordinates; see :func:`simulate`.

    Effects that are no function of position, or of speed and direction, are evaluated on the response
    of a first pass and given to the next as an external effort, until they no longer change.

    Args:
        twin: the machine, with its loops.
        log: the command, or a motion that has one.
        step: longest internal step [s].
        controller: see :func:`simulate`.
        full: also keep v, a and d (else they have no rows).
        every_step: return one row an internal step instead of one a sample.
    """
    if step is not None and not step > 0.0:
        raise InputError(f"step: {step} s must be positive")
    if not twin.diagonal:
        raise TwinError(f"{twin.machine.name}: the twin holds no diagonal; identify it again")
    asked = request(twin.machine, log)
    form = controller if controller is not None else preferred(twin)
    plant = plant_of(twin, asked.qr, asked.vr)
    full = full or bool(plant.other) or any(effect.logged_effort for effect in twin.effects)
    given = _servos_in(form)
    if given is not None:
        servos, notes = _chosen_servos(twin, given)
        substeps = coupled.substeps(asked.step, step)
        asked, substeps = (asked.refined(substeps), 1) if every_step else (asked, substeps)
        stepper: _Stepper = partial(_run_coupled, twin, asked, plant, servos, substeps, full)
    else:
        loops, notes = chosen_loops(twin, form)
        notes = (*_rates(loops, asked.step), *notes)
        substeps = plant.substeps(asked.step, step)
        asked, substeps = (asked.refined(substeps), 1) if every_step else (asked, substeps)
        stepper = partial(_run, twin, asked, plant, loops, substeps, full)
    out = stepper(np.zeros((1, twin.machine.nv)))
    if plant.other:
        out, late = _repeat(twin, plant, out, stepper)
        notes = (*notes, *late)
    return replace(_logged(twin, out), notes=(*asked.notes, *notes))


def preferred(twin: Twin) -> str:
    """Return the form with which a twin is simulated unless told otherwise."""
    chosen = twin.quality.get("simulation", {}).get("use")
    if chosen not in FORMS:
        chosen = "coupled" if twin.servos and not twin.loops else "black"
    return str(chosen)


def _servos_in(form: Loops) -> dict[str, Servo] | None:
    """Return the controllers given in place of identified ones, or None for another form than coupled."""
    if isinstance(form, str):
        return {} if form == "coupled" else None
    given = {name: law for name, law in form.items() if isinstance(law, Servo)}
    return given if len(given) == len(form) > 0 else None


def is_coupled(form: Loops) -> bool:
    """Whether a form simulates controllers around the plant, not transfer functions."""
    return _servos_in(form) is not None


def _chosen_servos(twin: Twin, given: Mapping[str, Servo]) -> tuple[dict[str, Servo], tuple[str, ...]]:
    """Return the controllers to simulate with, and notes about axes without one."""
    axes = twin.machine.axes
    for name in given:
        if name not in axes:
            raise InputError(f"controller: no axis {name!r}; {nearest(name, axes)}")
    servos = {**twin.servos, **given}
    if not servos:
        raise TwinError(
            f"{twin.machine.name}: the twin has no controllers; identify it from a log that holds the "
            "command <axis>.qr of the axes that move"
        )
    ideal = [name for name in axes if name not in servos]
    return servos, (f"no controller of {', '.join(ideal)}: follows its command exactly",) if ideal else ()


def _repeat(twin: Twin, plant: Plant, out: Response, stepper: _Stepper) -> tuple[Response, tuple[str, ...]]:
    """Run again with the effects that have no table, until their effort stays the same.

    The next effort is the combination of the last ones whose change would be least (Anderson 1965,
    10.1145/321296.321305): a plain repetition diverges for a drive that twists, whose load rings in the
    loop.

    Raises:
        DataError: it does not settle.
    """
    asked, change = out.request, np.inf
    shape = out.q.shape
    extra = np.zeros(shape)
    tried: list[Floats] = []
    changes: list[Floats] = []
    names = ", ".join(sorted({effect.name for effect, _ in plant.other}))
    for _ in range(PASSES):
        update = _effort(plant.other, twin.scene(as_motion(twin, asked, out)))
        change = float(np.linalg.norm(update - extra) / max(float(np.linalg.norm(update)), 1e-300))
        if change <= _SAME:
            return out, ()
        tried, changes = [*tried, extra.ravel()][-_KEPT:], [*changes, (update - extra).ravel()][-_KEPT:]
        extra = _mixed(tried, changes).reshape(shape)
        out = stepper(extra)
    if change > _LOST:
        raise DataError(
            f"{twin.machine.name}: the effort of {names} does not settle (it changes by {change:.1g} of its size "
            f"after {PASSES} passes); take it out of the twin's machine to simulate, or give what twists or "
            "plays a joint of its own under `passive`"
        )
    return out, (f"{names}: effort still changes by {change:.1g} of its size after {PASSES} passes",)


def _mixed(tried: Sequence[Floats], changes: Sequence[Floats]) -> Floats:
    """Return the next effort to try, from those tried and how each changed, all of shape (n,)."""
    step = changes[-1]
    if len(tried) == 1:
        return tried[0] + _RELAX * step
    ahead = np.stack([changes[-1] - x for x in changes[:-1]], axis=1)
    back = np.stack([tried[-1] - x for x in tried[:-1]], axis=1)
    weights = np.linalg.lstsq(ahead, step, rcond=1e-8)[0]
    return np.asarray(tried[-1] + _RELAX * step - (back + _RELAX * ahead) @ weights)


def chosen_loops(twin: Twin, controller: Loops) -> tuple[dict[str, LoopModel], tuple[str, ...]]:
    """Return the loops to simulate with, and notes about axes without one."""
    axes = twin.machine.axes
    if controller == "black":
        loops = dict(twin.loops)
    elif controller == "vibration":
        loops = {**twin.loops, **wide_loops(twin)}
    elif isinstance(controller, str):
        raise InputError(f"controller: {controller!r}; {nearest(controller, FORMS)}")
    else:
        raise InputError(
            "controller: expected a form or axis -> Servo; see help(pinotwin.simulation.simulate)"
        )
    if not loops:
        raise TwinError(
            f"{twin.machine.name}: the twin has no closed loop; identify it from a log that holds the "
            "command <axis>.qr of the axes that move"
        )
    ideal = [name for name in axes if name not in loops]
    if not ideal:
        return loops, ()
    return loops, (f"no closed loop of {', '.join(ideal)}: follows its command exactly",)


def wide_loops(twin: Twin) -> dict[str, LoopModel]:
    """Return the loops that hold the vibration of a passive joint, by axis (thesis Eq. 5.8)."""
    rows = twin.quality.get("loops", {})
    kept = {name: row.get("with_vibration", {}).get("model") for name, row in rows.items()}
    return {name: LoopModel.from_dict(model) for name, model in kept.items() if model}


def as_motion(twin: Twin, asked: Request, found: Response) -> Motion:
    """Return a response as a motion, so that effects can be evaluated on it."""
    n = len(found.q)
    external = asked.external
    return Motion.exact(
        (twin.machine.names, twin.machine.rotary),
        asked.clock,
        *(found.q, found.v, found.a),
        u=found.u,
        step=asked.step,
        qr=asked.qr,
        vr=asked.vr,
        external=external if len(external) == n else None,
        source=asked.source,
    )


def _logged(twin: Twin, out: Response) -> Response:
    """Return a response with the effort as the twin's effort channel logs it: late, or off by a factor."""
    pairs = zip(twin.effects, twin.slices, strict=True)
    wrong = tuple((e, twin.theta[s]) for e, s in pairs if e.logged_effort)
    if not wrong:
        return out
    return replace(out, u=out.u + _effort(wrong, twin.scene(as_motion(twin, out.request, out))))


def _effort(effects: tuple[tuple[Effect, Floats], ...], motion: Motion) -> Floats:
    """Return the effort of some effects along a motion, shape (n, nv)."""
    nv = len(motion.names)
    total = np.zeros((len(motion), nv))
    for effect, theta in effects:
        total += effect.columns(motion).effort(theta, nv)
    return total


def _rates(loops: Mapping[str, LoopModel], step: float) -> tuple[str, ...]:
    """Return a note where the log is sampled otherwise than the loops were identified."""
    steps = {round(loop.step, 9) for loop in loops.values()}
    if all(abs(step / s - 1.0) < 0.01 for s in steps):
        return ()
    found = ", ".join(f"{1.0 / s:g} Hz" for s in sorted(steps))
    return (
        f"log at {1.0 / step:.6g} Hz, loops identified at {found}: the command was interpolated "
        "between the samples of the log",
    )


def _run(
    twin: Twin,
    asked: Request,
    plant: Plant,
    loops: Mapping[str, LoopModel],
    substeps: int,
    full: bool,
    extra: Floats,
) -> Response:
    blocks = lay_blocks(twin.machine, loops, twin.diagonal, asked.step / substeps)
    n, nv = asked.qr.shape
    load = np.ascontiguousarray(asked.external - extra)
    command = Command(asked.qr, asked.vr, load, asked.step, substeps, plant.limit)
    rows = n if full else 0
    q, e, u = (np.zeros((n, nv)) for _ in range(3))
    v, a, d = (np.zeros((rows, nv)) for _ in range(3))
    out = Record(q, e, u, v, a, d)
    state = plant.state(len(blocks.A))
    arrays = plant.arrays()
    kernel.settle(*arrays, blocks, _begun(command), state)
    row, joint = kernel.run(*arrays, blocks, command, state, out)
    _on_command(twin, asked, plant, row, joint)
    return Response(asked, twin.machine.names, out.q, out.v, out.a, out.e, out.u, out.d, loops, substeps, ())


def _on_command(twin: Twin, asked: Request, plant: Plant, row: int, joint: int) -> None:
    if row >= 0:
        raise DataError(
            f"{twin.machine.name}: the simulation leaves its command at t = {asked.clock[row]:.4g} s on "
            f"axis {twin.machine.names[joint]}: tracking error beyond {plant.limit[joint]:.3g}; the twin's "
            "loop and plant do not fit together, identify it again, or give a shorter step"
        )


def _begun(command: Command) -> Command:
    qr, vr = beginning(command.qr, command.vr, command.step)
    return command._replace(qr=qr, vr=vr)


def _run_coupled(
    twin: Twin,
    asked: Request,
    plant: Plant,
    servos: Mapping[str, Servo],
    substeps: int,
    full: bool,
    extra: Floats,
) -> Response:
    """Simulate the identified controllers around the identified plant."""
    machine = twin.machine
    n, nv = asked.qr.shape
    h = asked.step / substeps
    laws = coupled.servo_arrays(
        [servos.get(name) for name in machine.names], [name in machine.passive for name in machine.names], h
    )
    parts, tables = plant.arrays()
    load = np.ascontiguousarray(asked.external - extra)
    command = Command(asked.qr, asked.vr, load, asked.step, substeps, plant.limit)
    out = coupled.records(n, nv, full)
    modes = coupled.mode_arrays(plant.modes, command.step / command.substeps)
    state = coupled.state(laws, plant.tape.size, plant.tape.start, tables, modes)
    coupled_kernel.settle(parts, tables, laws, modes, _begun(command), state)
    row, joint = coupled_kernel.run(parts, tables, laws, modes, command, state, out)
    _on_command(twin, asked, plant, row, joint)
    M, C = twin.diagonal["inertia"], twin.diagonal["viscous"]
    index = {name: machine.axes[name].index for name in servos}
    loops = (
        {
            name: close(servo, float(M[index[name]]), float(C[index[name]]), axis=name)
            for name, servo in servos.items()
        }
        if full
        else {}
    )
    return Response(asked, machine.names, out.q, out.v, out.a, out.e, out.u, out.d, loops, substeps, ())


_Stepper = Callable[[Floats], Response]


def feedforward(twin: Twin, log: Log) -> Log:
    """Return the effort of every axis along its command as it stands, ``<axis>.u`` [N or N·m].

    Rigid body, friction, ripple, tables and external loads of the twin at the *commanded* position,
    velocity and acceleration (by cubic spline); nothing is simulated and nothing measured is used.

    Args:
        twin: the machine.
        log: ``t``, ``<axis>.qr`` and external loads.
    """
    asked = request(twin.machine, log)
    a = np.stack([CubicSpline(asked.clock, x)(asked.clock, 2) for x in asked.qr.T], axis=1)
    n = len(asked.clock)
    motion = Motion.exact(
        (twin.machine.names, twin.machine.rotary),
        asked.clock,
        *(asked.qr, asked.vr, a),
        step=asked.step,
        external=asked.external if len(asked.external) == n else None,
        source=asked.source,
    )
    effort = asked.at_stamps(twin.effort(motion))
    zero = np.zeros_like(effort)
    u = motor_coordinates(twin.machine, zero, zero, effort)[2]
    channels = {"t": asked.t, **{f"{k}.u": u[:, x.index] for k, x in twin.machine.axes.items()}}
    return Log(channels, source=f"feed-forward for {asked.source}", notes=asked.notes)
