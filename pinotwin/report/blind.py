"""The report of the withheld bench: the table, what is confused with what, calibration.

It shows what is wrong as plainly as what is right: a figure below its bound is marked, and the confusion
matrix is published as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from pinotwin.report.blind_plots import calibration_figure, matrix_figure, rho_figure
from pinotwin.report.blocks import Block, Html, Plot, Tile, chip, notes, paragraph, table, tiles
from pinotwin.report.page import Page

STATES = {"aim": ("aim", "good"), "must": ("must", "fair"), "below": ("missed", "bad")}
"""State of a row -> words and kind of its chip."""


class Scored(Protocol):
    """What the page needs to know of a bench: the plain document of :mod:`pinotwin.bench.table`."""

    def document(self) -> Mapping[str, Any]:
        """Return the content of ``bench.json``."""
        ...


def bench_page(bench: Scored) -> Page:
    """Return the page of a scored bench."""
    d = bench.document()
    page = Page("The withheld bench", _subtitle(d))
    page = page.section("Result", paragraph(_headline(d), "verdict"), tiles(_tiles(d)))
    page = page.section(
        "Scores",
        *_scores(d),
        intro="An effect is put into the truth of a machine and "
        "withheld from its model; logs and model go to the diagnosis, the truth does "
        "not. rho is the power of the residual over the power of the noise, taken from "
        "simulations without noise.",
    )
    page = page.section("What is taken for what", *_confusion(d), intro=_TAKEN)
    page = page.section("How far a stated probability can be trusted", *_calibration(d))
    dots = Plot(rho_figure(d["answers"]), "Every single effect", "Each mark is one case.")
    page = page.section("By size of the residual", dots)
    return page.section("Diagnoses that broke off", *_errors(d))


_TAKEN = "Rows: what was put in. Columns: what was named first. Single effects with rho of at least 0.1."


def _subtitle(d: Mapping[str, Any]) -> str:
    kinds = ", ".join(f"{n} {k.replace('_', ' ')}" for k, n in d["cases"].items())
    return f"{len(d['answers'])} of {d['planned']} cases: {kinds} · {', '.join(d['machines'])}"


def _headline(d: Mapping[str, Any]) -> str:
    held = [r for r in d["scores"] if r["must"] and r["value"] is not None]
    below = [r["name"] for r in held if r["state"] == "below"]
    if not held:
        return "Too few cases for any score."
    if not below:
        return f"All {len(held)} scores reach what they must."
    return f"{len(held) - len(below)} of {len(held)} scores reach what they must; missed: {'; '.join(below)}."


def _tiles(d: Mapping[str, Any]) -> list[Tile]:
    wanted = (
        "healthy machine accused of anything",
        "top-1 effect and axis, rho ≥ 0.1",
        "both of two, weaker rho ≥ 0.1",
        "outside the catalogue recognised",
        "expected calibration error",
    )
    by_name = {r["name"]: r for r in d["scores"]}
    out = []
    for name in wanted:
        row = by_name[name]
        words, kind = STATES.get(row["state"], ("", ""))
        out.append(Tile(name, _figure(row), f"{_counts(row)}; must {row['must']}", words, kind))
    return out


def _scores(d: Mapping[str, Any]) -> list[Block]:
    rows = [
        [r["name"], _figure(r), _counts(r), r["must"], r["aim"], _state(r["state"]), r["note"]]
        for r in d["scores"]
    ]
    header = ("score", "figure", "counts", "must", "aim", "", "how it is counted")
    return [table(header, rows, numeric=(1, 2))]


def _figure(row: Mapping[str, Any]) -> str:
    if row["value"] is None:
        return "–"
    return f"{row['value']:.1%}" if row["kind"] == "share" else f"{row['value']:.3f}"


def _counts(row: Mapping[str, Any]) -> str:
    share = row["share"]
    return f"{share['hits']}/{share['of']}" if share else f"N = {row['count']}"


def _state(state: str) -> Html | str:
    if state not in STATES:
        return ""
    return chip(*STATES[state])


def _confusion(d: Mapping[str, Any]) -> list[Block]:
    have = d["confusion"]
    return [Plot(matrix_figure(have), "Measured", "Share of each row; counts in the cells.")] if have else []


def _calibration(d: Mapping[str, Any]) -> list[Block]:
    found = d["calibration"]
    if found is None:
        return [paragraph("Fewer than ten answers: too few to say.")]
    note = f"Expected calibration error {found['error']:.3f}, Brier score {found['brier']:.3f}."
    return [
        Plot(
            calibration_figure(found["bins"]),
            "Stated probability against how often it was right",
            note,
        )
    ]


def _errors(d: Mapping[str, Any]) -> Sequence[Block]:
    lines = [f"case {x['case']}: {x['error']}" for x in d["errors"]]
    return [notes(lines)] if lines else []
