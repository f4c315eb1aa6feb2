"""Printed texts use the field's words and short sentences; words of a private English are not used."""

from __future__ import annotations

import ast
import inspect
import json
import pydoc
import re
import runpy
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import pytest

from pinotwin.cli.diagnose import summary, where_lines
from pinotwin.cli.main import COMMANDS, main
from pinotwin.diagnosis.conclusion.advice import PAIRS, advise
from pinotwin.diagnosis.grade import KIND, Grade, printed
from pinotwin.diagnosis.phrases import explanation, moved, plain_sentence
from pinotwin.diagnosis.result import Diagnosis, Found, Gap, Region, Shrink, Size, Verdict
from pinotwin.effects import EFFECTS
from pinotwin.logs.quality.results import Severity
from pinotwin.report import verdict
from pinotwin.report.diagnosis import diagnosis_report
from pinotwin.report.diagnosis_verdict import headline
from pinotwin.simulation.run import FORMS
from pinotwin.system.phrases import (
    ADVERBS,
    AGAINST,
    BLIND,
    DAYS,
    DIAGNOSED,
    IDENTIFIED,
    JUDGED,
    LACKING_DAYS,
    MEANING,
    REGIONS,
    SIMULATED,
    SIMULATED_GRADES,
    STUDIED,
)
from tests.conftest import ROOT

UNASKED: Any = SimpleNamespace(
    change=False, new=SimpleNamespace(motion=SimpleNamespace(qr=None)), machine=SimpleNamespace(axes={})
)
"""A comparison of nothing, without a command."""
LONGEST = 30
"""Words of a sentence."""
NOT_USED = re.compile(
    r"\b(misfits?|gaps?|closes?|closed by|squared gap|leaves|left of|of its own|own logs|foretells?|told|tells|"
    r"asked|asks|kept back|in turn|stands? out|pushes|promised|surest|strayed|mend)\b",
    re.IGNORECASE,
)
NOT_IN_DOCS = re.compile(
    r"\b(push|habit|(is|are) said|tell apart|told apart|flatters?|foreign|rubs|ask(ing)?|spoken of|goes with|warmth|"
    r"is none|the other way round|foreseen|in hand|knows of)\b",
    re.IGNORECASE,
)
"""Beside those above, where prose is written by hand."""
MOST_WORDS, ALL_WORDS = 900, 16_466
"""Of a page of the docs, and of all of them; the second may only fall."""
DERIVATIONS = "derivations.md"
"""The appendix, which may be longer."""
GENERATED = ("effects.md", "figures.md", "bench_results.md")
"""Pages that a command writes."""
DOCS = [*sorted((ROOT / "docs").rglob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
WRITTEN = [page for page in DOCS if page.name not in GENERATED]
NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))
STORED = json.loads((ROOT / "tests" / "answers.json").read_text(encoding="utf-8"))["now"]


def sentences(text: str) -> list[str]:
    return [x for x in re.split(r"(?<=[.!?])\s+|\n", text) if x.strip()]


def wrong(text: str) -> list[str]:
    """Return the sentences with a word that is not used, or with too many."""
    return [x for x in sentences(text) if NOT_USED.search(x) or len(x.split()) > LONGEST]


def prose(text: str) -> str:
    """Return the prose of a Markdown page: cells, items and headings a line each, without code and targets of links."""
    text = re.sub(r"^```.*?^```|^(?: {4}[^\n]*\n)+|^:::.*?$", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"\n(?!\n|[#|*\-]|\d+\.)[ ]*", " ", text)  # a paragraph is wrapped as one pleases
    text = re.sub(r"!\[[^]]*\]\([^)]*\)", "", re.sub(r"`[^`]*`|\{\{[^}]*\}\}", "code", text))
    return re.sub(r"\]\([^)]*\)", "", text).replace("[", "").replace("|", "\n").replace("*", "")


def counted(text: str) -> int:
    """Return how many words a page has, code included."""
    return len(re.findall(r"\S*\w\S*", text))


def diagnosis(answer: dict) -> Diagnosis:
    """Return the diagnosis of which an answer was stored."""

    def shrink(x: dict) -> Shrink:
        on = x.get("on", "held-out blocks")
        return Shrink(
            x["before"], x["after"], x["share"], tuple(x["interval90"]), x["promised"], on, x["axis"]
        )

    def size(s: dict) -> Size:
        before, after = (float("nan") if s[k] is None else s[k] for k in ("before", "after"))
        return Size(s["name"], before, after, s["unit"], (after, after))

    def found(e: dict) -> Found:
        sizes = [size(s) for s in e["sizes"]]
        signals = {k: shrink(x) for k, x in e["shrink"].items() if isinstance(x, dict)}
        return Found(e["effect"], e["axis"], e["confidence"], {}, {}, signals, e["alternatives"], size=sizes)

    number = {"misfit": float("nan"), "size": float("nan")}
    gap = {
        axis: {
            s: Gap(**{**number, **{k: v for k, v in g.items() if k != "grade" and v is not None}})
            for s, g in row.items()
        }
        for axis, row in answer["gap"].items()
    }
    axis, signal = next((a, s) for a, row in gap.items() for s in row)
    where = [
        Region(axis, signal, "frequency", (1.0, 3.0), "Hz", 0.42, 0.02, None),
        Region(axis, signal, "velocity", (-0.01, 0.01), "m/s", 0.3, 0.1, 0.01),
    ]
    return Diagnosis(
        answer["sentence"],
        gap,
        where,
        [found(e) for e in answer["effects"]],
        [],
        answer["unexplained"],
        {},
        "assumed",
        advise(UNASKED, "assumed", [], [], [], [(min(group), max(group)) for group, _, _ in PAIRS])[0],
        answer["situation"],
        {},
        possible=[found(e) for e in answer["possible"]],
    )


@pytest.mark.parametrize("name", STORED)
def test_an_answer_is_in_plain_short_sentences(name: str) -> None:
    found = diagnosis(STORED[name])
    said = [*headline(found), *summary(found), *where_lines(found)]
    assert [x for text in said for x in wrong(text)] == []


def test_a_page_is_in_plain_words() -> None:
    found = diagnosis(next(x for x in STORED.values() if x["effects"]))
    body = diagnosis_report(found).partition("<body")[2]
    text = re.sub(r"<(script|style).*?</\1>|<[^>]*>", "\n", body, flags=re.DOTALL)
    assert [x for x in sentences(text) if NOT_USED.search(x)] == []


TABLES = (MEANING, IDENTIFIED, ADVERBS, SIMULATED, DIAGNOSED, DAYS, LACKING_DAYS, REGIONS, STUDIED)
TABLES += (AGAINST, BLIND, JUDGED)


def texts() -> Iterator[str]:
    for table in TABLES:
        yield from table.values()
    yield from (printed(grade) for grade in (*KIND, *SIMULATED_GRADES))
    yield from (meaning for _, meaning in SIMULATED_GRADES.values())
    for name, effect in EFFECTS.items():
        yield from (effect.title, explanation(name), effect.remedy)


@pytest.mark.parametrize("text", sorted({x for x in texts() if x}))
def test_grades_and_effects_are_in_plain_short_sentences(text: str) -> None:
    assert wrong(text) == []


@pytest.mark.parametrize("command", COMMANDS)
def test_help_is_in_plain_words(command: str, capsys) -> None:
    with pytest.raises(SystemExit):
        main([command, "--help"])
    text = capsys.readouterr().out.replace("--fail-on-gap", "")
    assert NOT_USED.findall(text) == []


@pytest.mark.parametrize(
    ("before", "after", "word"),
    [(1.0, 3.0, "rose"), (3.0, 1.0, "fell"), (0.0, 1.0, "appeared"), (-1.0, -2.0, "rose")],
)
def test_a_change_says_which_way(before: float, after: float, word: str) -> None:
    def size(before: float, after: float) -> Size:
        return Size("viscous.b", before, after, "N·s/m", (after, after))

    assert moved([size(before, after)]) == word
    assert moved([size(1.0, 3.0), size(3.0, 1.0)]) == "changed"
    assert moved([]) == "changed"


def test_names_of_effects_become_their_titles() -> None:
    assert plain_sentence("effort_scale of Y") == "scale of the effort of Y"


def test_a_private_word_and_a_long_sentence_are_noticed() -> None:
    assert wrong("the gap shrinks") == ["the gap shrinks"]
    assert wrong("word " * 31) != []
    assert wrong("the residual falls") == []


PRIVATE = re.compile(
    r"\bmisfit|squared gap|kept back|own logs|foretell|stands? out|\bcloses\b|told apart|surest", re.I
)


def literals() -> Iterator[tuple[str, str]]:
    """Yield file and text of every string of several words that is no docstring and no grade's code."""
    for path in sorted((ROOT / "pinotwin").rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        bare = {id(x.value) for x in ast.walk(tree) if isinstance(x, ast.Expr)}
        for node in ast.walk(tree):
            text = node.value if isinstance(node, ast.Constant) and id(node) not in bare else ""
            if isinstance(text, str) and " " in text.strip() and text not in (*KIND, *SIMULATED_GRADES):
                yield path.name, text


def page_texts() -> Iterator[tuple[str, str]]:
    """Yield file and text of what the pages say: their templates, and the strings of the modules that fill them."""
    for path in sorted((ROOT / "pinotwin").glob("*/templates/*.html")):
        text = path.read_text(encoding="utf-8")
        for tag in re.findall(r"\{[{%].*?[%}]\}", text, re.DOTALL):
            yield from ((path.name, " ".join(x.split())) for x in re.findall(r'"([^"]*)"', tag))
        bare = re.sub(r"\{#.*?#\}|\{%.*?%\}|<(script|style).*?</\1>", "\n", text, flags=re.DOTALL)
        for part in re.split(r"<[^>]*>", re.sub(r"\{\{.*?\}\}", "x", bare, flags=re.DOTALL)):
            yield path.name, " ".join(part.split())
    reports = {path.name for path in (ROOT / "pinotwin" / "report").glob("*.py")}
    yield from ((name, text) for name, text in literals() if name in reports)


def test_every_page_is_in_plain_short_sentences() -> None:
    found = list(page_texts())
    assert len(found) > 300
    assert [(name, x) for name, text in found for x in wrong(text)] == []


def test_no_text_of_the_package_has_a_private_word() -> None:
    assert [(name, text) for name, text in literals() if PRIVATE.search(text)] == []


def public() -> Iterator[str]:
    """Yield the docstrings that the page of the API shows."""
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    for name in re.findall(r"^::: ([\w.]+)", text, re.MULTILINE):
        found = pydoc.locate(name)
        own = vars(found) if inspect.isclass(found) else {}
        yield from (x.__doc__ for x in (found, *own.values()) if isinstance(x.__doc__, str))


def test_the_docstrings_of_the_api_are_in_plain_words() -> None:
    told = re.compile(r"\b(tell apart|told apart|mends?|closes?|foretells?|surest|the gap|misfits?)\b", re.I)
    said = [re.sub(r"^ *\w+: ", "", line) for text in public() for line in text.splitlines()]
    assert [x for x in said if told.search(x)] == []


@pytest.mark.parametrize("page", [*WRITTEN, *NOTEBOOKS], ids=lambda p: p.name)
def test_a_page_of_the_docs_is_in_plain_short_sentences(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    if page.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        text = "\n\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")
    text = prose(text)
    assert [*wrong(text), *(x for x in sentences(text) if NOT_IN_DOCS.search(x))] == []


def test_a_page_of_the_docs_answers_one_question() -> None:
    words = {page: counted(page.read_text(encoding="utf-8")) for page in WRITTEN if page.parent != ROOT}
    assert {p.name: n for p, n in words.items() if n > MOST_WORDS and p.name != DERIVATIONS} == {}
    assert sum(words.values()) <= ALL_WORDS


README_FIGURES = {
    "fault put into the effort of a real recording": "diagnosis.real",
    "fault on machines of another simulator": "diagnosis.foreign",
    "machine over days": "shop.first",
    "healthy machine of another simulator accused": "diagnosis.foreign_accused",
    "healthy real recordings": "diagnosis.real_healthy",
    "EMPS drive from its command: force": "emps.force",
    "EMPS drive from its command: position": "emps.position",
    "KUKA LWR4: torque": "lwr4.unseen",
    "Franka Panda: torque": "panda.unseen",
}
README_BENCH = {
    "effect withheld": "top-1 effect and axis, rho ≥ 0.1",
    "two effects withheld": "both of two, weaker rho ≥ 0.1",
    "effect outside the catalogue": "outside the catalogue recognised",
    "healthy machine accused": "healthy machine accused of anything",
}
"""Start of a row of the README -> the figure, or the row of docs/bench_results.md, that stands in its second cell."""


def test_the_numbers_of_the_readme_are_those_that_were_measured() -> None:
    hooks = runpy.run_path(str(ROOT / "docs" / "hooks.py"))
    bench = (ROOT / "docs" / "bench_results.md").read_text(encoding="utf-8")
    content = hooks["figures"]()
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = [[x.strip() for x in line.split("|")[1:3]] for line in readme.splitlines() if line.startswith("|")]
    for start, name in {**README_FIGURES, **README_BENCH}.items():
        (number,) = (number for what, number in rows if what.startswith(start))
        if name in README_BENCH.values():
            counts = re.search(rf"^\| {re.escape(name)} \|[^|]*\| (\d+)/(\d+) \|", bench, re.MULTILINE)
            assert counts, name
            assert number == f"{counts[1]} of {counts[2]}", start
        else:
            assert number == hooks["stated"](name, content), start


def test_every_figure_of_the_docs_was_measured() -> None:
    hooks = runpy.run_path(str(ROOT / "docs" / "hooks.py"))
    content = hooks["figures"]()
    filled = {page.name: hooks["filled"](page.read_text(encoding="utf-8"), content) for page in WRITTEN}
    assert [name for name, text in filled.items() if "{{" in text or "<!--" in text] == []
    with pytest.raises(KeyError):
        hooks["stated"]("emps.weight", content)


def test_a_figure_is_put_in_with_its_unit() -> None:
    stated = runpy.run_path(str(ROOT / "docs" / "hooks.py"))["stated"]
    row = {"value": 4.286, "unit": "%", "low": 4.231, "high": 2129.4, "published": 5.848}
    content = {"emps": {"figures": {"force": row, "right": {"value": 32.0, "of": 44}}}}
    names = ("emps.force", "emps.force.range", "emps.force.published", "emps.right")
    assert [stated(name, content) for name in names] == ["4.29 %", "4.23 to 2129 %", "5.85 %", "32 of 44"]


def test_every_word_of_a_result_is_in_the_glossary() -> None:
    glossary = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    words = {*get_args(Grade), *get_args(Verdict), *get_args(Severity), *SIMULATED_GRADES, *FORMS}
    words |= {printed(word) for word in words}
    words |= {word for _, word, _ in verdict.GRADES}
    assert [word for word in sorted(words) if f"`{word}`" not in glossary] == []
