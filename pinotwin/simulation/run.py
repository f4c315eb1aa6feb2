"""``simulate``: what the machine will do for a command, from a cold start, nothing measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from pinotwin.arrays import Floats, Mask
from pinotwin.effects import Effect
from pinotwin.errors import DataError, InputError, TwinError, nearest, require
from pinotwin.log import Log
from pinotwin.logs.files import LogLike, as_log
from pinotwin.loop import LoopModel, Servo, close
from pinotwin.motion import Motion
from pinotwin.signals import rms
from pinotwin.simulation import coupled_kernel, kernel
from pinotwin.simulation.command import Request, beginning, motor_coordinates, request
from pinotwin.simulation.kernel import lay_blocks
from pinotwin.simulation.law import LONGEST, law_rows, substeps
from pinotwin.simulation.plant import Plant, plant_of
from pinotwin.simulation.prediction import Prediction
from pinotwin.simulation.score import bound
from pinotwin.simulation.state import Command, Record, at_rest
from pinotwin.solve.lead import put_back
from pinotwin.system.phrases import BEYOND
from pinotwin.system.threads import one_blas_thread
from pinotwin.twin.twin import TwinLike, as_twin

if TYPE_CHECKING:
    from pinotwin.twin import Twin

Loops = str | Mapping[str, Servo]  # One of :data:`FORMS`, or controllers by axis
FORMS = ("coupled", "black", "vibration")


@dataclass(frozen=True, eq=False)
class Response:
    """What the machine does; arrays of shape (n, nv) in joint coordinates, SI."""

    request: Request  # what was asked
    names: tuple[str, ...]  # joint name of every column
    q: Floats  # position
    v: Floats  # velocity
    a: Floats  # acceleration
    e: Floats  # tracking error, command minus position
    u: Floats  # motor effort
    d: Floats  # generalised disturbance
    loops: Mapping[str, LoopModel]  # the closed loops that were used
    substeps: int  # internal steps a sample
    notes: tuple[str, ...]  # what deserves attention


def simulate(
    twin: TwinLike, log: LogLike, *, step: float | None = None, controller: Loops | None = None
) -> Prediction:
    """Return position, tracking error and effort that the machine will show for a command.

    Args:
        twin: the machine, with its loops; or its folder.
        log: ``t``, ``<axis>.qr`` and, if any, external loads ``<link>.fx`` ...; nothing else of it is used.
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
            u[:, axis.index] = put_back(asked.t, u[:, axis.index], -axis.lead)
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
        notes=(*found.notes, *beyond(twin, asked)),
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
    """Return the whole response in joint coordinates, by the arguments of :func:`simulate`; ``full`` keeps v, a and d.

    Effects that are no function of position, or of speed and direction, are evaluated on the response of a first pass
    and given to the next as an external effort, until they no longer change. ``step`` is the longest internal one [s];
    ``every_step`` returns one row an internal step.
    """
    if step is not None and not step > 0.0:
        raise InputError(f"step: {step} s must be positive")
    if not twin.diagonal:
        raise TwinError(f"{twin.machine.name}: the twin holds no diagonal; identify it again")
    asked = request(twin.machine, log)
    form = controller if controller is not None else preferred(twin)
    plant = plant_of(twin, asked.qr, asked.vr)
    full = full or bool(plant.other) or any(effect.logged_effort for effect in twin.effects)
    longest = LONGEST if step is None else step
    closed, notes = _closed(twin, form)
    if is_coupled(form):
        count = substeps(asked.step, longest)
    else:
        count = plant.substeps(asked.step, longest)
        notes = (*_rates(closed, asked.step), *notes)
    asked, count = (asked.refined(count), 1) if every_step else (asked, count)
    run = _Run(twin, asked, plant, closed, is_coupled(form), count, full)
    out = run.under(np.zeros((1, twin.machine.nv)))
    if plant.other:
        out, late = _repeat(run, out)
        notes = (*notes, *late)
    wrong = tuple(pair for pair in twin.pairs if pair[0].logged_effort)
    if wrong:  # as the twin's effort channel logs it: late, or off by a factor
        out = replace(out, u=out.u + _effort(wrong, twin.scene(as_motion(twin, out))))
    return replace(out, notes=(*asked.notes, *notes))


def preferred(twin: Twin) -> str:
    """Return the form with which a twin is simulated unless told otherwise."""
    chosen = twin.quality.get("simulation", {}).get("use")
    if chosen not in FORMS:
        chosen = "coupled" if twin.servos and not twin.loops else "black"
    return str(chosen)


def is_coupled(form: Loops) -> bool:
    """Whether a form simulates controllers around the plant, not transfer functions."""
    return form == "coupled" if isinstance(form, str) else len(form) > 0


def _closed(twin: Twin, form: Loops) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return what closes the loop of every axis, controllers or transfer functions, and notes about axes without."""
    axes, given = twin.machine.axes, {} if isinstance(form, str) else form
    if isinstance(form, str) and form not in FORMS:
        raise InputError(f"controller: {form!r}; {nearest(form, FORMS)}")
    if not isinstance(form, str) and not (form and all(isinstance(x, Servo) for x in form.values())):
        raise InputError(
            "controller: expected a form or axis -> Servo; see help(pinotwin.simulation.simulate)"
        )
    for name in given:
        require(name, axes, "controller: no axis", InputError)
    what = "controllers" if is_coupled(form) else "closed loop"
    found: dict[str, Any] = {**twin.servos, **given} if is_coupled(form) else dict(twin.loops)
    if form == "vibration":
        found |= wide_loops(twin)
    if not found:
        raise TwinError(
            f"{twin.machine.name}: the twin has no {what}; identify it from a log that holds the "
            "command <axis>.qr of the axes that move"
        )
    ideal = [name for name in axes if name not in found]
    return found, (
        f"no {what.removesuffix('s')} of {', '.join(ideal)}: follows its command exactly",
    ) if ideal else ()


def _repeat(run: _Run, out: Response, passes: int = 40) -> tuple[Response, tuple[str, ...]]:
    """Run again with the effects that have no table, until their effort stays the same, to a thousandth of its RMS.

    The last efforts are combined (Anderson 1965, 10.1145/321296.321305): a drive that twists diverges otherwise.
    """
    twin, other, change = run.twin, run.plant.other, np.inf
    extra = np.zeros(out.q.shape)
    tried: list[Floats] = []
    changes: list[Floats] = []
    names = ", ".join(sorted({effect.name for effect, _ in other}))
    for _ in range(passes):
        update = _effort(other, twin.scene(as_motion(twin, out)))
        change = float(np.linalg.norm(update - extra) / max(float(np.linalg.norm(update)), 1e-300))
        if change <= 1e-3:
            return out, ()
        tried, changes = [*tried, extra.ravel()][-20:], [*changes, (update - extra).ravel()][-20:]
        extra = _mixed(tried, changes).reshape(out.q.shape)
        out = run.under(extra)
    if change > 0.05:
        raise DataError(
            f"{twin.machine.name}: the effort of {names} does not settle (it changes by {change:.1g} of its size "
            f"after {passes} passes); take it out of the twin's machine to simulate, or give what twists or "
            "plays a joint of its own under `passive`"
        )
    return out, (f"{names}: effort still changes by {change:.1g} of its size after {passes} passes",)


def _mixed(tried: Sequence[Floats], changes: Sequence[Floats], relax: float = 0.5) -> Floats:
    """Return the next effort to try, from those tried and how each changed, all of shape (n,)."""
    step = changes[-1]
    if len(tried) == 1:
        return tried[0] + relax * step
    ahead = np.stack([changes[-1] - x for x in changes[:-1]], axis=1)
    back = np.stack([tried[-1] - x for x in tried[:-1]], axis=1)
    weights = np.linalg.lstsq(ahead, step, rcond=1e-8)[0]
    return np.asarray(tried[-1] + relax * step - (back + relax * ahead) @ weights)


def wide_loops(twin: Twin) -> dict[str, LoopModel]:
    """Return the loops that hold the vibration of a passive joint, by axis (thesis Eq. 5.8)."""
    rows = twin.quality.get("loops", {})
    kept = {name: row.get("with_vibration", {}).get("model") for name, row in rows.items()}
    return {name: LoopModel.from_dict(model) for name, model in kept.items() if model}


def as_motion(twin: Twin, found: Response) -> Motion:
    """Return a response as a motion, so that effects can be evaluated on it."""
    asked = found.request
    return _along(twin, asked, found.q, found.v, found.a, u=found.u, qr=asked.qr, vr=asked.vr)


def _along(twin: Twin, asked: Request, *state: Floats, **more: Floats) -> Motion:
    """Return positions, velocities and accelerations (n, nv) at the rows of a command as a motion."""
    return Motion.exact(
        (twin.machine.names, twin.machine.rotary),
        asked.clock,
        *state,
        step=asked.step,
        external=asked.external if len(asked.external) == len(asked.clock) else None,
        source=asked.source,
        **more,
    )


def _effort(effects: tuple[tuple[Effect, Floats], ...], motion: Motion) -> Floats:
    """Return the effort of some effects along a motion, shape (n, nv)."""
    return sum((effect.along(motion, theta) for effect, theta in effects), start=np.zeros(motion.q.shape))


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


@dataclass(frozen=True, eq=False)
class _Run:
    """A simulation made ready: the twin, what is asked, its plant and what closes the loops."""

    twin: Twin
    asked: Request
    plant: Plant
    closed: Mapping[str, Any]
    coupled: bool
    substeps: int
    full: bool

    def under(self, extra: Floats) -> Response:
        """Return the response under an effort (n, nv) that holds the machine back."""
        asked, (n, nv), machine, plant = self.asked, self.asked.qr.shape, self.twin.machine, self.plant
        load, h = np.ascontiguousarray(asked.external - extra), asked.step / self.substeps
        command = Command(asked.qr, asked.vr, load, asked.step, self.substeps, plant.limit)
        qr, vr = beginning(command.qr, command.vr, command.step)
        rows = (n, n, n, *[n if self.full else 0] * 3)  # q, e and u always
        out, loop = Record(*(np.zeros((k, nv)) for k in rows)), coupled_kernel if self.coupled else kernel
        if self.coupled:
            closed, rooms = self._controllers(h)
        else:
            blocks = lay_blocks(machine, self.closed, self.twin.diagonal, h)
            closed, rooms = (blocks,), {"blocks": len(blocks.A)}
        given = (plant.parts, plant.tables, *closed)
        state = at_rest(plant.tables, plant.start.copy(), **rooms)
        loop.settle(*given, command._replace(qr=qr, vr=vr), state)
        row, joint = loop.run(*given, command, state, out)
        if row >= 0:
            raise DataError(
                f"{machine.name}: the simulation diverges from its command at t = {asked.clock[row]:.4g} s on "
                f"axis {machine.names[joint]}: tracking error beyond {plant.limit[joint]:.3g}; the twin's "
                "loop and plant do not fit together, identify it again, or give a shorter step"
            )
        return Response(
            asked, machine.names, **out._asdict(), loops=self.loops(), substeps=self.substeps, notes=()
        )

    def _controllers(self, h: float) -> tuple[tuple[Any, ...], dict[str, int]]:
        """Return the kinds of joints, controllers and loads on springs at an internal step [s], and their room."""
        names, passive = self.twin.machine.names, self.twin.machine.passive
        kinds = dict.fromkeys(names, coupled_kernel.IDEAL) | dict.fromkeys(passive, coupled_kernel.PASSIVE)
        kinds |= dict.fromkeys(self.closed, coupled_kernel.SERVO)
        laws, modes = law_rows([self.closed.get(name) for name in names], h), self.plant.hanging(h)
        room = {"late": int(laws["whole"].max(initial=0.0)) + 2, "modes": len(modes.joint)}
        return (np.array([kinds[name] for name in names]), laws, modes), room

    def loops(self) -> dict[str, LoopModel]:
        """Return the closed loops; those of controllers are made only for a whole response."""
        if not self.coupled or not self.full:
            return {} if self.coupled else dict(self.closed)
        M, C = self.twin.diagonal["inertia"], self.twin.diagonal["viscous"]
        at = {name: self.twin.machine.axes[name].index for name in self.closed}
        return {k: close(x, float(M[at[k]]), float(C[at[k]]), axis=k) for k, x in self.closed.items()}


def feedforward(twin: Twin, log: Log) -> Log:
    """Return the effort of every axis along its command as it stands, ``<axis>.u`` [N or N·m].

    Rigid body, friction, ripple, tables and external loads of the twin at the *commanded* position,
    velocity and acceleration (by cubic spline); nothing is simulated and nothing measured is used.
    """
    asked = request(twin.machine, log)
    a = np.stack([scipy.interpolate.CubicSpline(asked.clock, x)(asked.clock, 2) for x in asked.qr.T], axis=1)
    effort = asked.at_stamps(twin.effort(_along(twin, asked, asked.qr, asked.vr, a)))
    zero = np.zeros_like(effort)
    u = motor_coordinates(twin.machine, zero, zero, effort)[2]
    channels = {"t": asked.t, **{f"{k}.u": u[:, x.index] for k, x in twin.machine.axes.items()}}
    return Log(channels, source=f"feed-forward for {asked.source}", notes=asked.notes)


def beyond(twin: Twin, asked: Request, most: int = 2000) -> tuple[str, ...]:
    """Return a note about where an effect along the travel is less known than the twin's misfit, of ``most`` rows."""
    step = max(len(asked.qr) // most, 1)
    q, v, names = asked.qr[::step], asked.vr[::step], (twin.machine.names, twin.machine.rotary)
    motion = Motion.exact(names, asked.clock[::step], q, v, np.zeros_like(v), step=step * asked.step)
    if twin.misfit is None:
        return ()
    error, found = twin.effort_error(motion), []
    for effect in twin.effects:
        own = twin.misfit.summary.get(str(effect.axis))
        if not effect.local or own is None:
            continue
        j = motion.index(str(effect.axis))
        strange = error[:, j] > own["moving"]
        if places := _places(q[:, j], strange):
            size = float(np.hypot(rms(error[strange, j]), own["moving"]))
            of = {"axis": effect.axis, "unit": "rad" if motion.rotary[j] else "m", "effort": own["unit"]}
            found.append(
                BEYOND["axis"].format(**of, places=", ".join(places), share=strange.mean(), error=size)
            )
    return (BEYOND["note"].format(axes="; ".join(found)),) if found else ()


def _places(q: Floats, strange: Mask, count: int = 50) -> list[str]:
    """Return the ranges of some positions (n,) [m or rad] in which most are strange, of ``count`` even parts."""
    edges = np.linspace(q.min(), q.max(), count + 1)
    part = np.clip(np.searchsorted(edges, q, side="right") - 1, 0, count - 1)
    share = np.bincount(part, strange, count) / np.maximum(np.bincount(part, minlength=count), 1)
    turns = edges[np.flatnonzero(np.diff(np.r_[False, share > 0.5, False]))]
    return [f"{low:.3g} to {high:.3g}" for low, high in turns.reshape(-1, 2)]
