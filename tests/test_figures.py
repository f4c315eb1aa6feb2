"""README and docs state what the file of figures holds, and the file says where each figure is from."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

from benchmarks.evidence import command, marks, store
from tests.not_measured import NOT_MEASURED

ROOT = Path(__file__).resolve().parents[1]
PAGES = [p for p in marks.pages(ROOT / "docs") if p.name not in ("figures.md", "bench_results.md")]
BENCH = ROOT / "docs" / "bench_results.md"
MADE = re.compile(r"<!-- measured -->.*?<!-- end of measured -->", re.S)
"""Written by `benchmarks.evidence.diagnosis`, counts marked."""


def plain(page: Path) -> str:
    """Return a page with its line breaks as spaces, so that a paragraph may be wrapped anew."""
    return " ".join(page.read_text(encoding="utf-8").split())


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_marked_numbers_are_those_that_were_measured(page: Path) -> None:
    assert marks.wrong(page.read_text(encoding="utf-8"), store.read()) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_a_number_that_looks_measured_is_marked_or_listed(page: Path) -> None:
    """Measured numbers carry a mark; settings, definitions and published ones stand in tests/not_measured.py."""
    text = MADE.sub("", page.read_text(encoding="utf-8"))
    for snippet in NOT_MEASURED.get(page.name, ()):
        words = r"\s+".join(map(re.escape, snippet.split()))
        text, found = re.subn(words, lambda m: re.sub(r"[^\n]", "#", m[0]), text)
        assert found, f"no longer on {page.name}: {snippet}"
    assert list(marks.unmarked(text)) == []


def test_the_list_names_pages_that_there_are() -> None:
    assert set(NOT_MEASURED) <= {page.name for page in PAGES}


def test_the_bench_says_above_its_table_what_stands_in_it() -> None:
    """`pinotwin blind` writes the rows; its command, day and commit stand on top."""
    said, _, rows = BENCH.read_text(encoding="utf-8").partition("## All rows")
    assert re.search(r"pinotwin blind .*--seed \d+", said)
    assert re.search(r"on \d{4}-\d\d-\d\d \(commit [0-9a-f]{7}\)", said)
    for hits, of in re.findall(r"\b(\d+) of (\d+)\b", said):
        assert re.search(rf"\b{hits}/{of}\b", rows), f"{hits} of {of}"


CONTENT = {
    "emps": {
        "figures": {
            "force": {"value": 4.286, "low": 4.231, "high": 4.342, "published": 5.848},
            "right": {"value": 32.0, "of": 44},
            "scale": {"value": 1.73e-4},
        }
    }
}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("force 4.3 %<!--emps.force-->, **4.29 %**<!--emps.force-->", []),
        ("right: 32 of 44<!--emps.right-->", []),
        ("4.2 to 4.3 %<!--emps.force.range-->, 5.85<!--emps.force.published-->", []),
        ("scale 1.7e-4<!--emps.scale-->", []),
        ("force 4.2 %<!--emps.force-->", ["emps.force: stated 4.2, measured 4.286"]),
        ("right: 32 of 45<!--emps.right-->", ["emps.right: stated 32 45, measured 32.0 44"]),
        ("4.2 to 4.4 %<!--emps.force.range-->", ["emps.force.range: stated 4.2 4.4, measured 4.231 4.342"]),
        ("force 4.2 to 4.3 %<!--emps.force-->", ["emps.force: stated 4.2 4.3, measured 4.286"]),
        ("force 4.3 %<!--emps.weight-->", ["emps.weight: no such figure"]),
        ("32<!--emps.right.range-->", ["emps.right.range: no such figure"]),
        ("force about <!--emps.force-->", ["1 unreadable marks"]),
    ],
)
def test_a_wrong_number_is_noticed(text: str, said: list[str]) -> None:
    assert marks.wrong(text, CONTENT) == said


def test_numbers_are_written_anew_with_as_many_digits() -> None:
    text = "**{} %**<!--emps.force-->, {}<!--emps.force.range-->, {}<!--emps.right-->, {}<!--emps.scale-->"
    old, new = (
        text.format("4.1", "4.20 to 4.30", "30 of 44", "1.1e-3"),
        text.format("4.3", "4.23 to 4.34", "32 of 44", "1.7e-4"),
    )
    assert marks.renewed(old, CONTENT) == new
    assert marks.renewed(new, CONTENT) == new
    assert marks.renewed("5 %<!--emps.weight-->", CONTENT) == "5 %<!--emps.weight-->"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("an error of 2.3 % in the mean", ["an error of 2.3 %"]),
        ("named in 3 of 10 cases", ["named in 3 of 10"]),
        ("| clock | 0.014 | 4.9<!--emps.force--> |", ["| clock | 0.014"]),
        ("off by 14 µs, by 1.2 to 3 ppm", ["off by 14 µs", "off by 14 µs, by 1.2 to 3 ppm"]),
        ("2.3 %<!--emps.force-->, `5 %`, [6 %](x.md), 20 s at 500 Hz", []),
        ("```\n7 %\n```\n\n    8 of 9\n", []),
    ],
)
def test_what_looks_measured(text: str, found: list[str]) -> None:
    assert list(marks.unmarked(text)) == found


def test_the_readme_links_the_figures() -> None:
    said = plain(ROOT / "README.md").partition("## How good is it")[2].partition("## Documentation")[0]
    assert "docs/figures.md" in said
    assert len(re.findall(r"<!--[\w.]+-->", said)) >= 8


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
