"""The verdict in plain words: how well each axis is predicted on new data, and what to mind."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from pinotwin.diagnosis.phrases import joined
from pinotwin.report.blocks import Tile
from pinotwin.report.display import effort, percent
from pinotwin.twin import Twin

GRADES = ((0.05, "very good", "good"), (0.12, "good", "good"), (0.3, "fair", "fair"))
"""Held-out error against the effort's standard deviation, below which a word applies."""


def grade(error: float) -> tuple[str, str]:
    """Return word and colour for a held-out error relative to the effort's standard deviation."""
    if not math.isfinite(error):
        return "not judged", ""
    for limit, word, kind in GRADES:
        if error < limit:
            return word, kind
    return "poor", "bad"


def judged(row: Mapping[str, Any]) -> tuple[Mapping[str, float], str]:
    """Return the errors of an axis on data that were not fitted, and what data those are."""
    if row.get("validation"):
        return row["validation"], "On the validation log"
    return row.get("held_out") or {}, "Cross-validated on the log"


def known(row: Mapping[str, Any], name: str) -> float:
    """Return a figure of a twin's quality, NaN when it is not there (JSON has null for NaN)."""
    value = row.get(name)
    return math.nan if value is None else float(value)


def error_of(row: Mapping[str, Any], name: str) -> float:
    """Return one figure of an axis' held-out error, NaN when it is not known."""
    return known(judged(row)[0], name)


def headline(twin: Twin) -> str:
    """Return the verdict in one or two sentences."""
    axes = twin.quality.get("axes", {})
    if not axes:
        return "This twin carries no judgement of itself: it was not identified from a log."
    where = judged(next(iter(axes.values())))[1]
    errors = {name: error_of(row, "nrmse_std") for name, row in axes.items()}
    finite = {name: x for name, x in errors.items() if math.isfinite(x)}
    if not finite:
        return "The log is too short to judge the twin on data that were not fitted."
    worst = max(finite, key=lambda name: finite[name])
    size = f"{percent(finite[worst])} of its standard deviation ({_rms(twin, worst)})"
    if len(axes) == 1:
        return f"{where}, the twin predicts the motor effort of {worst} to {size}."
    words: dict[str, list[str]] = {}
    for name, error in errors.items():
        words.setdefault(_adverb(error), []).append(name)
    order = [word for word in _ADVERBS.values() if word in words]
    said = joined([f"{word} on {joined(words[word])}" for word in order])
    text = f"{where}, the twin predicts the motor effort {said}."
    return f"{text} The largest error is on {worst}: {size}."


_ADVERBS = {
    "very good": "very well",
    "good": "well",
    "fair": "fairly",
    "poor": "poorly",
    "not judged": "unjudged",
}


def _adverb(error: float) -> str:
    return _ADVERBS[grade(error)[0]]


def _rms(twin: Twin, axis: str) -> str:
    rotary = dict(zip(twin.machine.names, twin.machine.rotary, strict=True))
    rms = error_of(twin.quality["axes"][axis], "rms")
    scale = effort(bool(rotary.get(axis)), rms)
    return f"{rms * scale.factor:.3g} {scale.unit} RMS"


def axis_tiles(twin: Twin) -> list[Tile]:
    """Return one tile per axis: its error on data not fitted."""
    out = []
    for name, row in twin.quality.get("axes", {}).items():
        error = error_of(row, "nrmse_std")
        word, kind = grade(error)
        note = (
            f"{_rms(twin, name)} · {percent(error_of(row, 'nrmse'))} of the RMS effort · "
            f"in the fit {percent(known(row, 'fit_std'))}"
        )
        out.append(Tile(f"Axis {name}", percent(error), note, word, kind))
    return out


def cautions(twin: Twin) -> list[str]:
    """Return what to be careful about, most important first."""
    quality = twin.quality
    out = [str(line) for line in quality.get("warnings", ())]
    open_rows = [row.name for row in twin.parameters if not row.determined]
    if open_rows:
        out.append(
            f"{len(open_rows)} of {len(twin.parameters)} parameters are not determined by these "
            f"data ({_first(open_rows)}). Predictions of other motions that need them rely on the URDF."
        )
    out += _colour(quality.get("axes", {}))
    return out


def bodies(twin: Twin) -> tuple[tuple[str, ...], list[list[str]], list[str]]:
    """Return head and rows of a table of what each body weighs and who says so; and what bodies that can exist cost."""
    words = {"log": "the log", "URDF": "the URDF", "rod": "nobody: not identified"}
    rows = []
    for row in twin.bodies:
        low, high = row["interval95"] or (math.nan, math.nan)
        half = f" ± {(high - low) / 2.0:.2g}" if row["source"] == "log" else ""
        given = "dummy" if row["source"] == "rod" else f"{row['urdf']:.3g}"
        mass = f"{row['mass']:.3g}{half}"
        rows.append([row["joint"], mass, given, f"{row['share']:.2f}", words[row["source"]]])
    price = twin.quality.get("consistency") or {}
    said = [
        f"unseen error {price[key]:.3f} of that {of}"
        for key, of in (("unseen_over_free", "without bodies"), ("unseen_over_best", "of the best bodies"))
        if price.get(key)
    ]
    return ("body", "mass [kg]", "in the URDF", "share of the URDF", "told by"), rows, said


def _first(names: Sequence[str]) -> str:
    return ", ".join(names[:4]) + (" …" if len(names) > 4 else "")


def _colour(axes: Mapping[str, Any]) -> list[str]:
    """Say on which axes the residual still has structure."""
    names = [name for name, row in axes.items() if known(row, "lag1") > 0.5]
    if not names:
        return []
    return [
        f"The residual of {joined(names)} is not white: it has a systematic part, which the intervals below allow "
        "for. Run pinotwin diagnose to find the cause."
    ]
