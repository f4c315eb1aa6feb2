"""The parameter table: value, interval, verdict; what is not determined shows no number."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from pinotwin.report.blocks import Html, chip, escape
from pinotwin.report.display import rounded
from pinotwin.twin import Parameter

_FOLD = 12
"""Effects with more coefficients than this (position tables) are folded away."""
_COLUMNS = (
    ("parameter", "text", ""),
    ("value", "number", "num"),
    ("unit", "", ""),
    ("95 % interval", "number", "num"),
    ("± relative", "number", "num"),
    ("before", "number", "num"),
    ("verdict", "text", ""),
)


def verdict_kind(row: Parameter) -> str:
    """Return the colour of a parameter's verdict: ``good``, ``fair``, ``bad`` or grey."""
    if not row.determined:
        return ""
    word = row.verdict.split(":")[0]
    return {"good": "good", "fair": "fair"}.get(word, "bad")


def parameter_table(rows: Sequence[Parameter], axes: Sequence[str]) -> Html:
    """Return the table of all parameters, grouped by axis, sortable by column."""
    head = "".join(
        f'<th class="{kind}"{f" data-sort={sort}" if sort else ""}>{escape(title)}</th>'
        for title, sort, kind in _COLUMNS
    )
    bodies = "".join(_bodies(title, part) for title, part in _groups(rows, axes).items())
    return Html(
        f'<div class="card scroll"><table class="parameters"><thead><tr>{head}</tr></thead>'
        f"{bodies}</table></div>"
    )


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


def _bodies(title: str, rows: Sequence[Parameter]) -> str:
    """Return a table body for an axis, and one of its own for each long effect."""
    effects: dict[str, list[Parameter]] = {}
    for row in rows:
        effects.setdefault(row.effect, []).append(row)
    long = {
        key: part for key, part in effects.items() if len(part) > _FOLD and not key.startswith("rigid_body")
    }
    short = [row for row in rows if row.effect not in long]
    group = f'<tr class="group"><td colspan="{len(_COLUMNS)}">{escape(title)}</td></tr>'
    body = f"<tbody>{group}{''.join(_row(row) for row in short)}</tbody>"
    for key, part in long.items():
        inner = "".join(_row(row) for row in part)
        body += f'<tbody class="folded">{_summary(key, part)}{inner}</tbody>'
    return body


def _summary(key: str, rows: Sequence[Parameter]) -> str:
    known = [row.value for row in rows if row.determined]
    span = f"{min(known):.3g} to {max(known):.3g} {rows[0].unit}" if known else "none determined"
    text = f"{len(rows)} coefficients, {len(known)} determined: {span}"
    return (
        f'<tr class="summary"><td class="mono">{escape(key)}</td>'
        f'<td colspan="{len(_COLUMNS) - 2}">{escape(text)}</td>'
        '<td><button class="fold">show all</button></td></tr>'
    )


def _row(row: Parameter) -> str:
    name = f'<span class="mono">{escape(row.name)}</span>'
    if row.meaning:
        name += f'<div class="sub">{escape(row.meaning)}</div>'
    if row.kind == "shape":
        name += '<div class="sub">searched</div>'
    value, interval, relative, before = _numbers(row)
    cells = [("", name, row.name), value, ("", escape(row.unit), ""), interval, relative, before]
    cells.append(("", _verdict(row), row.verdict))
    kinds = [kind for _, _, kind in _COLUMNS]
    return "<tr>" + "".join(_cell(c, k) for c, k in zip(cells, kinds, strict=True)) + "</tr>"


def _verdict(row: Parameter) -> str:
    word, _, why = row.verdict.partition(":")
    label = "not determined" if not row.determined else word
    if row.determined:
        return chip(label, verdict_kind(row), hint=why.strip()).text
    detail = why.strip() if word == label else row.verdict
    sub = f'<div class="sub">{escape(detail)}</div>' if detail and detail != label else ""
    return chip(label).text + sub


def _cell(cell: tuple[str, str, str], kind: str) -> str:
    style, text, key = cell
    classes = " ".join(x for x in (kind, style) if x)
    return f'<td class="{classes}" data-key="{escape(key)}">{text}</td>'


def _numbers(row: Parameter) -> Iterable[tuple[str, str, str]]:
    """Return value, interval, relative error and prior; no number at all where none is known."""
    if not row.determined:
        return (("open", "not determined", ""), ("", "–", ""), ("", "–", ""), ("", "–", ""))
    known = math.isfinite(row.error) and row.error > 0.0
    low, high = row.interval()
    value = rounded(row.value, row.error)[0]
    ends = [rounded(x, row.error)[0] for x in (low, high)] if known else []
    share = row.error / abs(row.value) if known and row.value else math.nan
    before = "–" if row.prior is None else f"{row.prior:.4g}"
    return (
        ("", value, repr(row.value)),
        ("", f"{ends[0]} … {ends[1]}" if known else "–", repr(high - low) if known else ""),
        ("", _share(1.96 * share), repr(share) if math.isfinite(share) else ""),
        ("", before, "" if row.prior is None else repr(row.prior)),
    )


def _share(x: float) -> str:
    if not math.isfinite(x):
        return "–"
    if x > 9.99:
        return "> 999 %"
    return f"{100 * x:.2g} %" if x < 0.995 else f"{100 * x:.0f} %"
