"""The verdict in plain words: how well each axis is predicted on new data, and what to mind."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from pinotwin.report.blocks import Html, Tile, tiles
from pinotwin.report.display import percent, scale_of
from pinotwin.system.phrases import ADVERBS, IDENTIFIED, joined
from pinotwin.twin import Twin

GRADES = ((0.05, "very good", "good"), (0.12, "good", "good"), (0.3, "fair", "fair"))
"""Held-out error against the effort's standard deviation, below which a word applies."""


def grade(error: float) -> tuple[str, str]:
    """Return word and colour for a held-out error relative to the effort's standard deviation."""
    if not math.isfinite(error):
        return "not judged", ""
    return next((row[1:] for row in GRADES if error < row[0]), ("poor", "bad"))


def judged(row: Mapping[str, Any]) -> tuple[Mapping[str, float], str]:
    """Return the errors of an axis on data that were not fitted, and what data those are."""
    which = "validation" if row.get("validation") else "held_out"
    return row.get(which) or {}, which


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
        return IDENTIFIED["unjudged"]
    where = IDENTIFIED[judged(next(iter(axes.values())))[1]]
    errors = {name: error_of(row, "nrmse_std") for name, row in axes.items()}
    finite = {name: x for name, x in errors.items() if math.isfinite(x)}
    if not finite:
        return IDENTIFIED["short"]
    worst = max(finite, key=lambda name: finite[name])
    size = IDENTIFIED["size"].format(share=percent(finite[worst]), rms=_rms(twin, worst))
    words = {k: [name for name, error in errors.items() if grade(error)[0] == k] for k in ADVERBS}
    said = joined([f"{ADVERBS[k]} on {joined(names)}" for k, names in words.items() if names])
    text = IDENTIFIED["one" if len(axes) == 1 else "several"]
    return f"{text.format(where=where, worst=worst, size=size, said=said)} {_from_command(twin)}".rstrip()


def _from_command(twin: Twin) -> str:
    """Return how well effort and tracking error follow from the command alone; empty where that was not judged."""
    found = twin.quality.get("simulation") or {}
    tracking, mean = found.get("tracking"), found.get("held_out", {}).get(found.get("use"))
    if tracking is None or mean is None:
        return ""
    effort = 2.0 * mean - tracking  # the mean is that of both
    words = {"effort": ADVERBS[grade(effort)[0]], "tracking": ADVERBS[grade(tracking)[0]]}
    return IDENTIFIED["command"].format(of_effort=percent(effort), of_tracking=percent(tracking), **words)


def _rms(twin: Twin, axis: str) -> str:
    rotary = dict(zip(twin.machine.names, twin.machine.rotary, strict=True))
    rms = error_of(twin.quality["axes"][axis], "rms")
    return scale_of("u", bool(rotary.get(axis)), rms).text(rms)


def axis_tiles(twin: Twin) -> Html:
    """Return one tile per axis: its error on data not fitted."""
    out = []
    for name, row in twin.quality.get("axes", {}).items():
        error = error_of(row, "nrmse_std")
        shares = {"share": percent(error_of(row, "nrmse")), "fit": percent(known(row, "fit_std"))}
        note = IDENTIFIED["tile"].format(rms=_rms(twin, name), **shares)
        out.append(Tile(f"Axis {name}", percent(error), note, *grade(error)))
    return tiles(out)


def cautions(twin: Twin) -> list[str]:
    """Return what to be careful about, most important first."""
    quality = twin.quality
    out = [str(line) for line in quality.get("warnings", ())]
    rows = [row.name for row in twin.parameters if not row.determined]
    if rows:
        names = ", ".join(rows[:4]) + (" …" if len(rows) > 4 else "")
        counts = {"open": len(rows), "all": len(twin.parameters)}
        out.append(IDENTIFIED["open"].format(names=names, **counts))
    coloured = [name for name, row in quality.get("axes", {}).items() if known(row, "lag1") > 0.5]
    if coloured:
        out.append(IDENTIFIED["coloured"].format(axes=joined(coloured)))
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
    of = {"unseen_over_free": "of an unconstrained fit", "unseen_over_best": "at the best URDF weight"}
    said = [
        f"held-out error with these bodies: {price[k]:.3f} times that {of[k]}" for k in of if price.get(k)
    ]
    return ("body", "mass [kg]", "in the URDF", "share of the URDF", "known from"), rows, said
