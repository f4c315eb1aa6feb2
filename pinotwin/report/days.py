"""The page of ``pinotwin diagnose --each``: the state of every axis log by log, and the numbers that moved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from pinotwin.diagnosis.conclusion.sizes import size_text, told
from pinotwin.diagnosis.phrases import on_axis
from pinotwin.report.blocks import Html, Page, Plot, chip, macro, paragraph, table
from pinotwin.report.comparison import in_pairs, over_labels, sizes_of
from pinotwin.report.figures import effect_colour
from pinotwin.system.phrases import DAYS, LACKING_DAYS, STATES, capital, joined

Row = Mapping[str, Any]
Key = tuple[str, str]  # effect and axis of a cause, "" for the machine's own
COLOURS = {"unchanged": "good", "changed": "bad"}  # State of an axis -> colour of its chip


def days_report(document: Mapping[str, Any], out: Path) -> str:
    """Return the page of many logs as one HTML text; ``out`` is the folder that their own pages lie below."""
    rows, words = document["logs"], _words(document["logs"])
    axes = list(dict.fromkeys(axis for row in rows for axis in row["state"]))
    lines = []
    for row in rows:
        states = [row["state"].get(axis, "cannot say") for axis in axes]
        named = STATES[row["situation"] or "change"]
        chips = (chip(named[state], COLOURS.get(state, "")) for state in states)
        causes = "; ".join(f"{_cause(c)} ({c['confidence']:.0%})" for c in row["causes"])
        said = causes or ("" if row["verdict"] == "none" else str(row["sentence"]))
        lines.append((_link(row, out), *chips, row["error"] or said))
    page = Page(words["title"], str(document["subject"]))
    page = page.section("", paragraph(finding(rows), "verdict"), table(("log", *axes, "cause"), lines))
    plots = [plot for key in _keys(rows) if (plot := _course(rows, key)) is not None]
    return page.section(words["numbers"], *in_pairs(plots), intro=words["bars"]).html()


def finding(rows: Sequence[Row]) -> str:
    """Return what many logs say, in sentences: what has changed from which log on, what could not be judged."""
    words = _words(rows)
    lost = [row for row in rows if row["folder"] is None]
    judged = [row for row in rows if row["folder"] is not None]
    moved = [row for row in judged if row["causes"]]
    still = [row for row in judged if row["verdict"] in ("unexplained", "partly_explained")]
    left = [row for row in still if "changed" in row["state"].values()]
    unsaid = [row for row in still if row not in left]
    first = words["changed" if moved else "none"].format(count=len(moved), logs=len(judged))
    out = [first] if moved or (judged and not still) else []
    out += [_since(judged, key) for key in _keys(rows)]
    named = {"left": left, "unsaid": unsaid, "lost": lost}
    return " ".join([*out, *(words[k].format(logs=joined([*map(_name, x)])) for k, x in named.items() if x)])


def _words(rows: Sequence[Row]) -> Mapping[str, str]:
    """Return the words for logs of a twin, of which something changes, or of a machine, which lacks something."""
    structure = any(row["situation"] == "structure" for row in rows)
    return {**DAYS, **LACKING_DAYS} if structure else DAYS


def _name(row: Row) -> str:
    """Return the name of a log: that of its folder, which no other has."""
    return Path(row["folder"] or row["log"]).name


def _since(rows: Sequence[Row], key: Key) -> str:
    """Return from which log on a cause is named, and how often."""
    has = [_named(row, key) is not None for row in rows]
    first, last = has.index(True), len(has) - 1 - has[::-1].index(True)
    what = _cause(_named(rows[last], key) or {})
    form = "since" if all(has[first:]) else "once" if sum(has) == 1 else "some"
    given = {"what": capital(what), "log": _name(rows[first])}
    return DAYS[form].format(**given, count=sum(has), logs=len(has))


def _keys(rows: Sequence[Row]) -> list[Key]:
    """Return every cause that is named, by effect and axis."""
    return list(dict.fromkeys((c["effect"], c["axis"] or "") for row in rows for c in row["causes"]))


def _named(row: Row, key: Key) -> Mapping[str, Any] | None:
    return next((c for c in row["causes"] if (c["effect"], c["axis"] or "") == key), None)


def _cause(cause: Mapping[str, Any]) -> str:
    """Return a cause with its first number."""
    numbers = told(sizes_of(cause["sizes"]))
    size = f", {size_text(numbers[0], 3)}".replace("->", "→") if numbers else ""
    return f"{on_axis(cause['effect'], cause['axis'])}{size}"


def _link(row: Row, out: Path) -> Html:
    """Return the name of a log, as a link where it has a page of its own."""
    if row["folder"] is None:
        return macro("bold", _name(row))
    return macro("link", quote(f"{Path(row['folder']).relative_to(out).as_posix()}/report.html"), _name(row))


def _course(rows: Sequence[Row], key: Key) -> Plot | None:
    """Return the first number of a cause from log to log with its 90 % interval; None for one without numbers."""
    found = [next(iter(told(sizes_of((_named(row, key) or {}).get("sizes")))), None) for row in rows]
    known = [size for size in found if size is not None]
    if not known:
        return None
    low, high = (
        np.array([0.0 if s is None else abs(s.interval[k] - s.after) for s in found]) for k in (0, 1)
    )
    y = [None if size is None else size.after for size in found]
    figure = over_labels([*map(str, range(len(rows)))], y, effect_colour(key[0]), (high, low))
    marked = range(0, len(rows), 1 + len(rows) // 30)
    short = [
        name if len(name) < 17 else f"{name[:8]}…{name[-7:]}" for k in marked if (name := _name(rows[k]))
    ]
    figure.update_xaxes(type="category", tickvals=[*marked], ticktext=short)
    unit = "" if known[0].unit == "-" else known[0].unit
    return Plot(figure.update_yaxes(title_text=unit, rangemode="tozero"), on_axis(key[0], key[1] or None))
