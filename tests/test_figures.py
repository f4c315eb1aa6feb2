"""The file of figures says where each figure is from, and its page is what the file says."""

from __future__ import annotations

import importlib
import re

import pytest

from benchmarks.evidence import command, store


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
