"""The parameter table: value, interval, verdict; what is not determined shows no number."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from pinotwin.report.blocks import Html, macro
from pinotwin.twin import Parameter
from pinotwin.units import rounded


def parameter_table(rows: Sequence[Parameter], axes: Sequence[str], fold: int = 12) -> Html:
    """Return all parameters by axis, sortable; effects of more coefficients than ``fold`` are folded away."""
    return macro("parameters", [(title, *_parts(part, fold)) for title, part in _groups(rows, axes).items()])


def _groups(rows: Sequence[Parameter], axes: Sequence[str]) -> Mapping[str, list[Parameter]]:
    """Return the rows of each axis, then those of passive joints and of what belongs to none."""
    out: dict[str, list[Parameter]] = {f"Axis {name}": [] for name in axes}
    for row in rows:
        owner = _owner(row, axes)
        out.setdefault(f"Axis {owner}" if owner in axes else owner, []).append(row)
    return {title: part for title, part in out.items() if part}


def _owner(row: Parameter, axes: Sequence[str]) -> str:
    """Return the axis of a parameter; of the rigid body, the joint that ends its name."""
    first = row.effect.split(".")[0]
    if first != "rigid_body":
        return first
    last = row.name.rstrip("*").rsplit("_", 1)[-1]
    return last if last in axes else "Rigid body"


_Shown = list[tuple[Parameter, list[tuple[str, str]]]]


def _parts(rows: Sequence[Parameter], fold: int) -> tuple[_Shown, list[tuple[str, str, _Shown]]]:
    """Return the rows that stand open, and those of each long effect with a line about them."""
    effects: dict[str, list[Parameter]] = {}
    for row in rows:
        effects.setdefault(row.effect, []).append(row)
    long = {k: part for k, part in effects.items() if len(part) > fold and not k.startswith("rigid_body")}
    short = [(row, _numbers(row)) for row in rows if row.effect not in long]
    return short, [
        (key, _summary(part), [(row, _numbers(row)) for row in part]) for key, part in long.items()
    ]


def _summary(rows: Sequence[Parameter]) -> str:
    known = [row.value for row in rows if row.determined]
    span = f"{min(known):.3g} to {max(known):.3g} {rows[0].unit}" if known else "none determined"
    return f"{len(rows)} coefficients, {len(known)} determined: {span}"


def _numbers(row: Parameter) -> list[tuple[str, str]]:
    """Return value, interval, relative error and prior, each with a sort key where its text is no number."""
    if not row.determined:
        return [("not determined", ""), ("–", ""), ("–", ""), ("–", "")]
    known = math.isfinite(row.error) and row.error > 0.0
    low, high = row.interval()
    value = rounded(row.value, row.error)[0]
    ends = [rounded(x, row.error)[0] for x in (low, high)] if known else []
    share = row.error / abs(row.value) if known and row.value else math.nan
    return [
        (value, ""),
        (f"{ends[0]} … {ends[1]}", f"{high - low:.3g}") if known else ("–", ""),
        (_share(1.96 * share), f"{share:.3g}" if math.isfinite(share) else ""),
        ("–", "") if row.prior is None else (f"{row.prior:.4g}", ""),
    ]


def _share(x: float) -> str:
    if not math.isfinite(x):
        return "–"
    if x > 9.99:
        return "> 999 %"
    return f"{100 * x:.2g} %" if x < 0.995 else f"{100 * x:.0f} %"
