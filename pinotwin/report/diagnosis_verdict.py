"""The verdict of a diagnosis in plain words, and a tile per axis."""

from __future__ import annotations

from pinotwin.diagnosis.result import Diagnosis
from pinotwin.machine import Machine
from pinotwin.report import display
from pinotwin.report.blocks import Tile
from pinotwin.report.diagnosis_plots import signal_scale
from pinotwin.report.plain_words import effect_words, joined, on_axis, plain_sentence
from pinotwin.twin import Twin

OFF = 2.0  # times the noise, the gap of a tracking error from which it is said to differ,
LOOP = 0.1  # and of its size: what a loop foretells of it is no better on a healthy machine
MOST = 2  # axes of which the headline says what stays
SIGNALS = {"u": "motor effort", "e": "tracking error", "v": "vibration"}


def headline(d: Diagnosis) -> str:
    """Return the verdict in plain words."""
    if d.verdict == "none":
        return (
            "Log and model agree. What differs is noise, or too small to matter; these logs show no "
            "missing cause."
        )
    if d.verdict == "unexplained":
        where = joined([f"axis {a}" for a in d.remains or d.unexplained] or ["this machine"])
        return (
            f"Log and model differ on {where}, and none of the causes that pinotwin knows explains it. "
            f"{_stays(d)}"
        ).strip()
    named = joined([on_axis(e.effect, e.axis) for e in d.effects])
    text = f"Log and model differ, and the cause is most likely {named}. {_gone(d)}".strip()
    if d.verdict == "partly_explained":
        left = joined([f"axis {a}" for a in d.remains] or ["some axis"])
        text += f" Part of the gap on {left} stays without a cause. {_stays(d)}"
    return text.strip()


def _stays(d: Diagnosis) -> str:
    """Return what is left looks like, for the first axes of which something is."""
    seen = list(d.remains.items())[:MOST]
    return " ".join(f"What stays on axis {a}: {plain_sentence(words)}." for a, words in seen)


def _gone(d: Diagnosis) -> str:
    shrink = d.effects[0].shrink if d.effects else {}
    found = shrink.get("u") or shrink.get("v")
    if found is None:
        return ""
    if found.share <= 0.0:
        return "On data kept back the gap does not shrink by it yet: take it as a hint."
    share = display.percent(min(found.share, 1.0))
    where = "a log that it was not fitted to" if found.on == "validation" else "data kept back"
    return (
        f"Adding {effect_words(d.effects[0].effect)} to the model removes {share} of the squared gap "
        f"above the noise, on {where}."
    )


def axis_tiles(d: Diagnosis) -> list[Tile]:
    """Return one tile per axis: the gap as a share of the signal."""
    out = []
    rotary = rotary_axes(d)
    for axis, row in d.gap.items():
        for signal, gap in row.items():
            scale = signal_scale(signal, rotary.get(axis, False), gap.rms)
            note = (
                f"{SIGNALS.get(signal, signal)}: gap {gap.rms * scale.factor:.3g} {scale.unit} RMS, "
                f"noise {gap.noise * scale.factor:.3g} {scale.unit}"
            )
            word, kind = _grade(d, axis, signal)
            out.append(Tile(f"Axis {axis}", display.percent(gap.nrmse), note, word, kind))
    return out


def _grade(d: Diagnosis, axis: str, signal: str) -> tuple[str, str]:
    if axis in d.remains:
        named = any(e.axis == axis for e in d.effects)
        return ("partly explained", "fair") if named else ("not explained", "bad")
    if axis in d.unexplained:
        return "gap explained", "fair"
    gap = d.gap[axis][signal]
    differs = signal == "e" and gap.rms > OFF * gap.noise and gap.nrmse > LOOP
    return ("differs", "fair") if differs else ("agrees", "good")


def ground(d: Diagnosis) -> list[str]:
    """Return what the verdict rests on."""
    noise = {
        "repeats": "The noise floor was measured: it is what differs between repeated runs.",
        "assumed": "The noise floor had to be assumed, since no motion was recorded twice: small "
        "gaps may go unnoticed.",
    }
    out = ["Large print: usual size of log minus model over the usual size of the signal itself."]
    if any("e" in row for row in d.gap.values()):
        out.append(
            "The tracking error is foretold through each axis' loop. It is stated beside the motor "
            "effort, which decides."
        )
    if d.noise in noise:
        out.append(noise[d.noise])
    if d.quick:
        out.append("A quick look only: the candidates were screened, not re-checked.")
    return out


def machine_of(d: Diagnosis) -> Machine | None:
    """Return the machine that was diagnosed, None where the diagnosis does not hold it."""
    subject = d.subject.machine if isinstance(d.subject, Twin) else d.subject
    return subject if isinstance(subject, Machine) else None


def rotary_axes(d: Diagnosis) -> dict[str, bool]:
    """Return whether each axis turns; from the regions' units where the machine is not known."""
    machine = machine_of(d)
    if machine is not None:
        return dict(zip(machine.names, machine.rotary, strict=True))
    turning = {"rad", "rad/s", "rad/s²", "N·m"}
    return {r.axis: r.unit in turning for r in d.where if r.kind not in ("time", "frequency", "other_axis")}
