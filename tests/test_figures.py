"""README and docs state what the file of figures holds, and the file says where each figure is from."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

from benchmarks.evidence import command, store

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
MARK = re.compile(r"<!--\w+\.\w+-->")
MARKED = re.compile(r"(?P<number>-?\d+(?:\.\d+)?)(?: of (?P<of>\d+))?[^\d<\n|]{0,12}<!--(?P<name>[\w.]+)-->")


def wrong(text: str, content: dict) -> list[str]:
    """Return what is wrong with the marked numbers of a text."""
    marked = list(MARKED.finditer(text))
    out = [f"{n} unreadable marks" for n in [len(MARK.findall(text)) - len(marked)] if n]
    for found in marked:
        part, _, name = found["name"].partition(".")
        try:
            figure = content[part]["figures"][name]
        except KeyError:
            out.append(f"{found['name']}: no such figure")
            continue
        digits = len(found["number"].partition(".")[2])
        off = abs(figure["value"] - float(found["number"])) > 0.501 * 10.0**-digits
        if off or (found["of"] and int(found["of"]) != figure["of"]):
            out.append(f"{found['name']}: stated {found['number']}, measured {figure['value']}")
    return out


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_marked_numbers_are_those_that_were_measured(page: Path) -> None:
    assert wrong(page.read_text(encoding="utf-8"), store.read()) == []


def test_a_wrong_number_is_noticed() -> None:
    content = {"emps": {"figures": {"force": {"value": 4.286}, "right": {"value": 32.0, "of": 44}}}}
    assert wrong("force 4.3 %<!--emps.force-->, **4.29 %**<!--emps.force-->", content) == []
    assert wrong("right: 32 of 44<!--emps.right-->", content) == []
    assert wrong("force 4.2 %<!--emps.force-->", content) == ["emps.force: stated 4.2, measured 4.286"]
    assert wrong("right: 32 of 45<!--emps.right-->", content) != []
    assert wrong("force 4.3 %<!--emps.weight-->", content) == ["emps.weight: no such figure"]
    assert wrong("force about <!--emps.force-->", content) == ["1 unreadable marks"]


def test_every_figure_of_the_readme_is_marked() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    said = readme.partition("## How good is it")[2].partition("\n## ")[0]
    assert "docs/figures.md" in said
    bare = re.sub(r"\([^()]*(?:published|source)[^()]*\)", "", said)  # figures of others
    unmarked = [m[0] for m in re.finditer(r"\d+(?:\.\d+)? ?%(?!\**<!--)", bare)]
    assert unmarked == []


def test_the_page_is_what_the_file_says() -> None:
    assert store.PAGE.read_text(encoding="utf-8") == store.page(store.read())


def test_every_figure_says_how_it_was_measured() -> None:
    for part, one in store.read().items():
        for key in ("what", "command", "seeds"):
            assert one[key].strip(), (part, key)
        assert re.fullmatch(r"\d{4}-\d\d-\d\d", one["date"]), part
        for name, row in one["figures"].items():
            figure = store.Figure(**row)
            assert figure.name == name
            if figure.low is not None and figure.high is not None:
                assert figure.low <= figure.value * (1 + 1e-3), name
                assert figure.value <= figure.high * (1 + 1e-3), name


@pytest.mark.parametrize("part", command.parts())
def test_every_part_can_be_run_alone(part: str) -> None:
    module = importlib.import_module(f"benchmarks.evidence.{part}")
    assert callable(module.figures)
    assert module.SEEDS
    assert module.__doc__.strip().endswith(".")


def test_figures_take_the_place_of_earlier_ones_of_their_part(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(store, "FILE", tmp_path / "figures.json")
    monkeypatch.setattr(store, "PAGE", tmp_path / "figures.md")
    given = tmp_path / "loop.json"
    given.write_text('[{"name": "median", "what": "e and u", "value": 2.1, "published": 2.38}]')
    words = ["--add", "loop", str(given), "--what", "Loops.", "--command", "score loop", "--seeds", "430:454"]
    assert command.main(words) == 0
    assert store.value("loop.median") == 2.1
    store.keep("loop", "Loops.", [store.Figure("worst", "e and u", 9.0)], command="score", seeds="430:454")
    store.keep("emps", "A drive.", [store.Figure("force", "force", 4.0)], command="x", seeds="none")
    assert list(store.read()) == ["emps", "loop"]
    assert set(store.read()["loop"]["figures"]) == {"worst"}
    assert "| 9 % |" in store.PAGE.read_text()
    with pytest.raises(ValueError, match="kind"):
        store.Figure("a", "b", 1.0, kind="measured")  # type: ignore[arg-type]
