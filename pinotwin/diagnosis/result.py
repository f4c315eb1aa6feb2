"""What a diagnosis found, and its public form, ``diagnosis.json``."""

from __future__ import annotations

import importlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from pinotwin.arrays import Floats, plain
from pinotwin.diagnosis.grade import KIND, OPEN, STATE, Grade, State, grade, is_open, left_anyway, printed
from pinotwin.diagnosis.rules import RULES
from pinotwin.effects import Effect
from pinotwin.log import Log
from pinotwin.logs.prepared import Prepared
from pinotwin.machine import Machine
from pinotwin.notebook import Drawn, Shown
from pinotwin.system.writing import as_path

Verdict = Literal["none", "explained", "partly_explained", "unexplained"]
HIDDEN = ("traces", "subject", "commands", "prepared", "sealed")  # what diagnosis.json does not hold


@dataclass(frozen=True)
class Gap:
    """The residual of one signal of one axis."""

    rms: float  # RMS of log minus model, on data not used to fit [N or N·m]
    nrmse: float  # the same over the RMS of the signal
    noise: float  # RMS of the noise
    after: float  # RMS once the named effects are modelled
    # RMS that the twin left of its own logs, cross-validated, as `identify` states it; NaN for none
    misfit: float = float("nan")
    # by how much the signal varies, against which the residual of a machine is judged; its RMS where NaN
    size: float = float("nan")
    unsure: float = 0.0  # what the twin's effort is less sure of in this motion than in its own logs
    worth: float = 0.0  # least of its variation that is open [1]

    @property
    def expected(self) -> float:
        """The error that is expected of the twin in this motion [unit of the signal]; NaN where no misfit is known."""
        return math.hypot(self.misfit, self.unsure)

    @property
    def variation(self) -> float:
        """By how much the signal varies, its RMS where that is not known [unit of the signal]."""
        return self.size if math.isfinite(self.size) else self.rms / max(self.nrmse, 1e-300)

    @property
    def level(self) -> float:
        """The expected error and the noise together, which the residual is held against [unit of the signal]."""
        return left_anyway(self.noise, self.expected)

    @property
    def small(self) -> bool:
        """Whether what stays beyond a healthy axis is not worth a word."""
        return self.after <= math.hypot(self.level, self.worth * self.variation)

    def is_open(self, signal: str = "u") -> bool:
        """Whether more of a signal stays, once the named effects are modelled, than of a healthy axis."""
        left = is_open(self.after, self.noise, self.expected, self.variation, signal=signal)
        return left and not self.small


@dataclass(frozen=True)
class Region:
    """Where a residual lies: a range that holds more of its power than of the time."""

    axis: str
    signal: str  # ``u`` or ``e``
    kind: str  # time, position, velocity, acceleration, frequency, load or other_axis
    range: tuple[float, float]  # lowest and highest value [unit]
    unit: str  # SI unit
    share: float  # of the squared residual
    time_share: float  # of the time
    # chance to see such a concentration anywhere in a residual without structure; None where that was not tested
    # (frequency bands)
    p_value: float | None
    other: str | None = None  # the other axis, for ``other_axis``


@dataclass(frozen=True)
class Shrink:
    """How far the residual of a signal of an axis falls: after = before sqrt(1 - share)."""

    before: float  # the residual, :attr:`Gap.rms` [unit of the signal]
    after: float  # what is left of it
    share: float  # of the squared residual that goes, measured on the rows that ``on`` names
    interval: tuple[float, float]  # 90 % interval of that share, which it holds
    promised: float  # the share that the fit itself promised
    on: str  # ``validation``, ``held-out blocks``, or ``fitted logs`` (of an event that no other holds)
    # whose residual it is: of a body on a link the axis that it moves most. None for the effect's own
    axis: str | None = None


def shrunk(
    before: float, share: float, interval: tuple[float, float], promised: float, on: str, axis: str | None
) -> Shrink:
    """Return how far a residual falls by a share of its square; what makes it larger explains nothing."""
    share, low, high, promised = (float(min(max(x, 0.0), 1.0)) for x in (share, *interval, promised))
    after = before * math.sqrt(1.0 - share)
    return Shrink(before, after, share, (min(low, share), max(high, share)), promised, on, axis=axis)


@dataclass(frozen=True)
class Size:
    """The size of a cause in the machine's own numbers."""

    name: str  # of the number, e.g. ``viscous.b``
    # what the model held; 0 for what it did not have (inf for a limit), NaN where it is no number of the model
    before: float
    after: float  # what these logs ask for
    unit: str  # of both
    interval: tuple[float, float]  # 90 % interval of ``after``


@dataclass(frozen=True)
class Found:
    """One named effect."""

    effect: str  # name in the table of effects
    axis: str | None  # axis, or None for the machine
    confidence: float  # probability that this is the effect, or one of those that are confusable with it
    shape: Mapping[str, float]  # shape values, SI
    theta: Mapping[str, float]  # coefficients, SI
    shrink: Mapping[str, Shrink]  # per signal, the effect alone
    alternatives: Sequence[Mapping[str, Any]]  # other effects with probability and reason
    # base parameters that move when it is admitted: name -> (before, after, in sigmas)
    moves: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    gain: float = 0.0  # squared residual closed on rows that were not fitted, over that of a good model
    size: Sequence[Size] = ()  # what changed from what to what
    # the effect at the shapes that were found, for :meth:`Diagnosis.apply`
    listed: Effect | None = field(default=None, repr=False)
    # axis -> how far its effort's residual falls by the effect alone, of every axis that the effect acts on
    acts: Mapping[str, Shrink] = field(default_factory=dict)
    # when it acts: ``kind`` (always, since, growing, after), ``from`` and ``time_constant`` [s], ``event``; or not told
    course: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Traces:
    """Plain arrays for plots, of one axis in one log."""

    axis: str
    log: int  # index of the log
    t: Floats  # time [s], shape (m,)
    before: Floats  # log minus model [N or N·m]
    after: Floats  # with the named effects


@dataclass(frozen=True, repr=False)
class Diagnosis(Drawn):
    """Where the residual lies, which effects cause it, and how far it falls.

    Attributes:
        sentence: the verdict in words.
        gap: axis -> signal -> residual.
        where: regions, the most telling first.
        effects: named effects, by the variance that each explains.
        confusable: groups that this log cannot distinguish.
        unexplained: axis -> signal -> share of the squared residual above the noise that stays.
        remains: axis -> what the remainder looks like.
        noise: ``repeats`` or ``assumed``.
        advice: what to do next.
        situation: ``structure`` (a machine) or ``change`` (a twin).
        shrink: axis -> signal -> shrink of all named effects together.
        quick: whether only the screen was run.
        traces: arrays for plots.
        machine: name of the machine.
        subject: what was diagnosed, for :meth:`apply`.
        possible: causes that were found but are less sure than `rules.named`: nothing is said by them.
        commands: advised command files: name -> channel -> values.
        warnings: what ``check`` says of these logs.
        differs: files that differ from runs of the same command, with which they are not pooled.
        detectable: the least changes of the plain causes that these logs, with commands or a twin of three, would have
            shown.
        evidence: the rows of evidence behind the causes, best first, likewise.
        recording: faults of the recording itself, before which no cause is named: fault, axis, number, confidence.
        missing_since_identification: effects that the twin lacked from the start, no part of the verdict.
        provenance: version, options, seed, and the logs with their fingerprints.
        prepared: logs that were diagnosed, with their motions.
        sealed: logs that nothing was fitted to, likewise.
    """

    sentence: str
    gap: Mapping[str, Mapping[str, Gap]]
    where: Sequence[Region]
    effects: Sequence[Found]
    confusable: Sequence[Sequence[str]]
    unexplained: Mapping[str, Mapping[str, float]]
    remains: Mapping[str, str]
    noise: str
    advice: Sequence[str]
    situation: str
    shrink: Mapping[str, Mapping[str, Shrink]]
    quick: bool = False
    traces: Sequence[Traces] = field(default=(), repr=False)
    machine: str = ""
    subject: Any = field(default=None, repr=False)
    possible: Sequence[Found] = ()
    commands: Mapping[str, Mapping[str, Floats]] = field(default_factory=dict, repr=False)
    warnings: Sequence[str] = ()
    differs: Sequence[str] = ()
    detectable: Sequence[Mapping[str, Any]] = ()
    evidence: Sequence[Mapping[str, Any]] = field(default=(), repr=False)
    recording: Sequence[Mapping[str, Any]] = ()
    missing_since_identification: Sequence[Mapping[str, Any]] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict, repr=False)
    prepared: Sequence[Prepared] = field(default=(), repr=False, compare=False)
    sealed: Sequence[Prepared] = field(default=(), repr=False, compare=False)

    @property
    def verdict(self) -> Verdict:
        """none, explained, partly_explained or unexplained: is a cause named, does a signal stay open?"""
        if self.effects:
            return "partly_explained" if self.unexplained else "explained"
        return "unexplained" if self.unexplained else "none"

    @property
    def logs(self) -> Sequence[Log]:
        """The logs that were diagnosed, in the names of the contract."""
        return [one.log for one in self.prepared]

    @property
    def validation(self) -> Sequence[Log]:
        """The logs that nothing was fitted to, likewise."""
        return [one.log for one in self.sealed]

    @property
    def causes(self) -> Sequence[Found]:
        """The named causes, by how much each shrinks the residual; the same as ``effects``."""
        return self.effects

    def grade(self, axis: str, signal: str = "u") -> Grade:
        """Return the one word for an axis and signal, see :mod:`pinotwin.diagnosis.grade`.

        What the verdict leaves open is never graded as explained, and a residual that no named effect acts on
        counts nothing as closed, whatever a nameless pattern would take away.
        """
        g = self.gap[axis][signal]
        if math.isnan(g.noise) and math.isnan(g.misfit):
            return "not judged"  # the log itself is in doubt
        named = self._acts(axis, signal)
        shrinks = named or (signal == "e" and g.after < g.rms)  # by what was named on another axis
        word = grade(
            g.rms, g.expected, g.noise, g.after if shrinks else None, size=g.variation, signal=signal
        )
        if word == "not explained" and g.small:
            word = "above misfit"
        if named and word in ("agrees", "within misfit", "above misfit") and g.after < g.rms:
            word = "gap explained"  # small, yet a cause of it was found
        if signal == "e" and word == "gap explained" and g.after > RULES.odd * g.level:
            word = "above misfit"  # the causes were sought in the efforts
        if signal in self.unexplained.get(axis, {}) and word != "partly explained":
            return "partly explained" if named and g.after < g.rms else "not explained"
        return word

    def alike(self, e: Found) -> list[str]:
        """Return the other causes that these logs cannot tell from this one, such as ``Y.coulomb``."""
        own = (e.effect, f"{e.axis}.{e.effect}")
        return [x for group in self.confusable if set(own) & {*group} for x in group if x not in own]

    def state(self, axis: str, signal: str | None = None) -> State:
        """Return the state of an axis of the machine, or of one of its signals, whatever the model is worth.

        The tracking error of a sound axis follows from what changed elsewhere; a rise of it that stays open does not.
        """
        row = self.gap.get(axis, {})
        if any(x["axis"] in (axis, None) for x in self.recording):
            return "cannot say"
        kinds = {s: KIND[self.grade(axis, s)] for s in ([signal] if signal else row)}
        if signal is None:
            still = any(self.grade(axis, s) in OPEN for s in row)
            if still or kinds.get("u") == "bad" or any(e.axis == axis for e in self.effects):
                return "changed"
        return STATE.get(kinds.get("u", next(iter(kinds.values()), "")), "cannot say")

    def _acts(self, axis: str, signal: str) -> bool:
        """Whether a named effect acts on a signal of an axis; on others than the effort only if it was tried."""
        if signal == "u":
            return any(e.axis in (axis, None) or axis in e.acts for e in self.effects)
        tried = [e for e in self.effects if e.axis == axis and signal in e.shrink]
        return bool(tried) or signal in self.shrink.get(axis, {})

    def to_dict(self) -> dict[str, Any]:
        """Return the content of diagnosis.json, in JSON's own types."""
        out = plain(
            {
                "schema": 2,
                "verdict": self.verdict,
                **{f.name: getattr(self, f.name) for f in fields(self) if f.name not in HIDDEN},
                "gap": {
                    a: {s: {**vars(g), "grade": self.grade(a, s)} for s, g in row.items()}
                    for a, row in self.gap.items()
                },
                "where": [
                    {k: v for k, v in vars(r).items() if k != "other" or v is not None} for r in self.where
                ],
                "effects": [{**_effect(e), "class": self.alike(e)} for e in self.effects],
                "possible": [_effect(e) for e in self.possible],
                "state": {a: self.state(a) for a in self.gap},
                "confidence_calibrated": not self.quick,
                "shrink": {a: {s: _shrink(x) for s, x in row.items()} for a, row in self.shrink.items()},
            }
        )
        assert isinstance(out, dict)
        return out

    def _shown(self) -> Shown:
        """Return title, columns, rows and a note for a notebook and for ``repr``."""
        rows = []
        for a, s, g in [(a, s, g) for a, row in self.gap.items() for s, g in row.items()]:
            numbers = f"{g.rms:.4g}", f"{g.after:.4g}", f"{g.misfit:.3g}", f"{g.noise:.3g}"
            rows.append((f"{a}.{s}", *numbers, printed(self.grade(a, s))))
        columns = ("RMS, SI", "residual", "with causes", "validation", "noise", "grade")
        return f"Diagnosis of {self.machine}: {self.verdict}", columns, rows, self.sentence

    def apply(self, folder: str | Path) -> Path:
        """Write the machine with the named effects added, and return the path of its YAML."""
        target = as_path(folder, "folder")
        return self.repaired().save(target)

    def repaired(self) -> Machine:
        """Return the machine with the named causes added, to be identified again.

        Raises:
            DataError: the diagnosis does not hold its machine.
        """
        from pinotwin.diagnosis.apply import repaired

        return repaired(self)

    def save(self, folder: str | Path, *, meshes: str | Path | None = None) -> Path:
        """Write what ``pinotwin diagnose`` writes: diagnosis.json, report.html, machine.html, machine/.

        Args:
            folder: where; an earlier diagnosis in it is replaced.
            meshes: folder of the URDF's meshes, for the picture.

        Returns:
            The folder.
        """
        pictures = importlib.import_module("pinotwin.report.pictures")
        pictures.save(self, target := as_path(folder, "folder"), meshes)
        return target


def _effect(e: Found) -> dict[str, Any]:
    sizes = [{"interval90" if k == "interval" else k: v for k, v in vars(x).items()} for x in e.size]
    own = {k: v for k, v in vars(e).items() if k != "listed"}
    acts = {axis: _shrink(x) for axis, x in e.acts.items()}
    on = {x.on for x in e.shrink.values()}
    shrink: dict[str, Any] = {s: _shrink(x) for s, x in e.shrink.items()}
    shrink["on"] = on.pop() if len(on) == 1 else "held-out blocks"
    return {**own, "size": sizes[0] if sizes else None, "sizes": sizes, "shrink": shrink, "acts": acts}


def _shrink(x: Shrink) -> dict[str, Any]:
    row = {"interval90" if k == "interval" else k: v for k, v in vars(x).items() if k != "on"}
    return {**row, "promised_interval": None}  # a key of the file: none is known
