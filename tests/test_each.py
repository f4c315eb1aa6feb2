"""Many logs, each diagnosed by itself: one table, resumable, and a bad log is one line of it."""

from __future__ import annotations

import csv
import errno
import functools
import json
import os
import signal
from collections.abc import Callable
from html import escape
from pathlib import Path

import pytest

from pinotwin.bench.engine import engine
from pinotwin.cli import each, each_table
from pinotwin.cli.main import main
from pinotwin.diagnosis.grade import KIND, STATE
from pinotwin.errors import OutputError
from pinotwin.report.days import days_report, finding
from pinotwin.system.writing import alone_in
from tests.rig import good_log, run, write_log, write_machine


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A twin, three nights (the last with another friction), a text that is no log."""
    folder = tmp_path_factory.mktemp("shop")
    machine = write_machine(folder / "rig")
    good = good_log()
    write_log(folder / "own.csv", good)
    for night in ("monday", "tuesday"):
        (folder / night).mkdir()
        write_log(folder / night / "log.csv", good)
    stiff = {**good, "X.u": good["X.u"] + 60.0 * _speed(good)}
    write_log(folder / "wednesday.csv", stiff)
    (folder / "broken.csv").write_text("this is\nno log\n")
    assert run("identify", machine, folder / "own.csv", "--out", folder / "twin", "--no-loop") == 0
    return folder


def _speed(log):
    import numpy as np

    return np.gradient(log["X.q"], log["t"])


def _logs(shop: Path) -> list[Path]:
    return [
        shop / "monday" / "log.csv",
        shop / "tuesday" / "log.csv",
        shop / "wednesday.csv",
        shop / "broken.csv",
    ]


@pytest.fixture(scope="module")
def done(shop: Path) -> tuple[int, dict]:
    code = run(
        "diagnose", shop / "twin", "--each", *_logs(shop), "--quick", "--workers", "2", "--out", shop / "out"
    )
    return code, json.loads((shop / "out" / "each.json").read_text())


def test_a_log_that_cannot_be_diagnosed_is_a_line_and_no_abort(done: tuple[int, dict]) -> None:
    code, table = done
    assert code == 2
    *diagnosed, broken = table["logs"]
    assert broken["verdict"] == "failed"
    assert "broken.csv" in broken["error"]
    assert broken["folder"] is None
    assert [row["verdict"] == "failed" for row in diagnosed] == [False] * 3
    assert table["counts"]["failed"] == 1


def test_the_changed_night_is_told_from_the_others(done: tuple[int, dict]) -> None:
    monday, tuesday, wednesday, _ = done[1]["logs"]
    assert monday["verdict"] == tuesday["verdict"] == "none"
    assert wednesday["verdict"] != "none"
    assert wednesday["signal"] == "X.u"
    assert wednesday["gap"] > 3.0 * monday["gap"]
    assert (wednesday["causes"][0]["axis"], wednesday["causes"][0]["effect"]) == ("X", "viscous")


def test_every_log_has_its_folder_and_two_of_one_stem_are_told_apart(
    shop: Path, done: tuple[int, dict]
) -> None:
    rows = done[1]["logs"]
    assert [Path(row["folder"]).name for row in rows[:3]] == ["monday_log", "tuesday_log", "wednesday"]
    for row in rows[:3]:
        found = json.loads((Path(row["folder"]) / "diagnosis.json").read_text())
        assert found["verdict"] == row["verdict"]
        assert (Path(row["folder"]) / "report.html").is_file()
    assert not (shop / "out" / "broken").exists()
    assert [p.name for p in (shop / "out").iterdir() if p.name.startswith(".")] == []


def test_the_table_is_also_csv(shop: Path, done: tuple[int, dict]) -> None:
    with (shop / "out" / "each.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["verdict"] for row in rows] == [row["verdict"] for row in done[1]["logs"]]
    assert tuple(rows[0]) == each_table.COLUMNS
    assert rows[2]["causes"].startswith("X.viscous")


def test_the_page_says_what_changed_from_which_log_on(shop: Path, done: tuple[int, dict]) -> None:
    page = (shop / "out" / "each.html").read_text()
    told = finding(done[1]["logs"])
    assert told.startswith("Changed in 1 of 3 logs. ")
    assert "in every log from wednesday on." in told  # of those that were diagnosed
    assert told.endswith("Not diagnosed: broken.csv.")
    assert escape(told) in page
    assert 'href="wednesday/report.html"' in page
    assert page.count(">unchanged<") == 5  # of two axes
    assert page.count(">changed<") == 1
    assert page.count(">cannot say<") == 2


def _row(name: str, grade: str, *causes: dict, verdict: str = "none", situation: str = "change") -> dict:
    row = {"log": f"{name}.csv", "folder": f"out/{name}", "verdict": verdict, "situation": situation}
    gaps, state = {"X": {"u": {"grade": grade}}}, STATE.get(KIND[grade], "cannot say")
    return {
        **row,
        "gaps": gaps,
        "state": {"X": state},
        "causes": list(causes),
        "error": None,
        "sentence": "A story",
    }


def _cause(axis: str | None, after: float) -> dict:
    size = {"name": "viscous.b", "before": 10.0, "after": after, "unit": "N·s/m", "interval90": [9.0, 31.0]}
    return {"effect": "viscous", "axis": axis, "confidence": 0.9, "size": size, "sizes": [size]}


def _page(*rows: dict) -> str:
    return days_report({"subject": "twin", "logs": rows}, Path("out"))


def test_sentence_and_chips_of_a_page_agree() -> None:
    calm, near = _row("a", "agrees"), _row("b", "above misfit")
    moved = _row("c", "gap explained", _cause("X", 20.0), verdict="explained")
    back, more = _row("d", "agrees"), _row("e", "partly explained", _cause("X", 30.0), verdict="explained")
    still = _row("f", "not explained", verdict="unexplained")
    assert finding([calm, near]) == "No change in 2 logs."
    assert finding([calm, still]) == "A residual without a named cause: f."
    some = finding([calm, moved, back, more])
    assert (
        some == "Changed in 2 of 4 logs. Viscous friction on axis X, friction coefficient 10 → 30 N·s/m: "
        "in 2 of 4 logs, first in c."
    )
    assert finding([calm, moved, more]).endswith("in every log from c on.")
    lost = {**calm, "folder": None, "gaps": {}, "state": {}, "error": "cannot be read"}
    assert finding([lost]) == "Not diagnosed: a.csv."
    page = _page(calm, near, moved, back, more, still, lost)
    counts = {"unchanged": 2, "changed": 3, "cannot say": 2}
    assert {word: page.count(f">{word}<") for word in counts} == counts
    assert "A story" in page
    assert "Numbers that moved" in page


def test_the_page_of_a_machine_says_what_its_model_lacks() -> None:
    rows = [_row("a", "agrees", situation="structure")] * 2
    assert finding(rows) == "No missing effect in 2 logs."
    load = _row("b", "gap explained", _cause(None, 20.0), verdict="explained", situation="structure")
    page = _page(*rows, load)
    assert "The model lacks an effect in 1 of 3 logs. Viscous friction, friction coefficient" in page
    assert (page.count(">as its model<"), page.count(">unlike its model<"), page.count("changed")) == (
        2,
        1,
        0,
    )


def test_a_second_run_works_on_what_is_missing_or_has_changed(
    shop: Path, done: tuple[int, dict], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    kept = {name: _stamp(shop, name) for name in ("monday_log", "wednesday")}
    good = good_log()
    write_log(shop / "tuesday" / "log.csv", {**good, "X.u": 1.0001 * good["X.u"]})
    old = _stamp(shop, "tuesday_log")
    (shop / "out" / ".wednesday.abcd1234.part").mkdir()  # of a killed run, of a log that is kept
    words = ["--quick", "--workers", "1", "--json", tmp_path / "t.json", "--out", shop / "out"]
    assert run("diagnose", shop / "twin", "--each", *_logs(shop)[:3], *words) == 0
    assert {name: _stamp(shop, name) for name in kept} == kept
    assert _stamp(shop, "tuesday_log") != old
    assert "3 logs (2 of an earlier run): 2 none" in capfd.readouterr().out
    assert [p.name for p in (shop / "out").iterdir() if p.name.startswith(".")] == []
    table = json.loads((tmp_path / "t.json").read_text())
    assert table["kept_of_an_earlier_run"] == 2
    assert table["logs"][0] == done[1]["logs"][0]
    # nothing is left to do: no process is started
    assert run("diagnose", shop / "twin", "--each", *_logs(shop)[:3], *words, "--fail-on-gap") == 1
    # another option is another question
    assert each.known_answer(each.jobs_of(_nights(shop), _asked(shop, seed=1), shop / "out")[0]) is None
    assert each.known_answer(each.jobs_of(_nights(shop), _asked(shop, seed=0), shop / "out")[0]) is not None


def _stamp(shop: Path, name: str) -> int:
    return (shop / "out" / name / "diagnosis.json").stat().st_mtime_ns


def _asked(shop: Path, seed: int) -> each.Asked:
    return each.Asked(
        str(shop / "twin"), (), None, None, {"quick": True, "seed": seed, "false_alarm": 0.02, "worth": 0.01}
    )


def _nights(shop: Path) -> list[str]:
    return [str(p) for p in _logs(shop)[:3]]


def dies(log: str, asked: each.Asked):
    """Kill this worker at the first log that is looked at, once; at ``always`` every time."""
    flag = Path(asked.subject)
    if "always" in log or not flag.exists():
        flag.write_text("")
        os.kill(os.getpid(), signal.SIGKILL)
    found = {"verdict": "none", "gap": {}, "effects": [], "log": log}
    return found, functools.partial(_filled, json.dumps(found))


def _filled(text: str, folder: Path) -> list[str]:
    (folder / "diagnosis.json").write_text(text)
    return []


def test_a_dead_worker_costs_a_retry_and_one_that_always_dies_a_line(tmp_path: Path) -> None:
    asked = each.Asked(str(tmp_path / "flag"), (), None, None, {"seed": 0})
    jobs = [each.Job(name, tmp_path / name, "x") for name in ("a", "b", "always", "c")]
    one: Callable = functools.partial(each.do_job, work=dies, asked=asked)
    with engine(2, apart=True) as run_all:
        rows = {
            job.log: each_table.failed(job.log, row) if isinstance(row, BaseException) else row
            for job, row in run_all(one, jobs, None)
        }
    assert {log: row["verdict"] for log, row in rows.items()} == {
        "a": "none",
        "b": "none",
        "c": "none",
        "always": "failed",
    }
    assert "worker died" in rows["always"]["error"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "b", "c", "flag"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["{twin}", "{log}", "--workers", "2"], "add --each"),
        (["nosuch", "--each", "{log}"], "nosuch"),
        (["{twin}", "--each", "{empty}"], "no logs in this folder"),
        (["{twin}", "--each", "{log}", "--workers", "0"], "--workers: 0"),
    ],
)
def test_bad_words_are_refused_before_the_work(
    words: list[str], message: str, shop: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    places = {"twin": shop / "twin", "log": shop / "own.csv", "empty": tmp_path / "empty"}
    filled = [word.format(**places) for word in words]
    assert main(["diagnose", *filled, "--out", str(tmp_path / "new" / "out")]) == 2
    assert message in capfd.readouterr().err
    assert not (tmp_path / "new").exists()


def test_a_folder_stands_for_the_logs_in_it(shop: Path) -> None:
    found = [Path(p).name for p in each.logs_in(str(shop))]
    assert found == ["broken.csv", "own.csv", "wednesday.csv"]


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pinotwin.bench.engine.engine", lambda *_, **__: engine(1))


def _run(tmp_path: Path, work: each.Work, *names: str) -> int:
    for name in names:
        (tmp_path / f"{name}.csv").write_text(name)
    asked = each.Asked("emps", (), None, None, {"quick": True})
    logs = [str(tmp_path / f"{name}.csv") for name in names]
    return each.each_answered(logs, asked, work, tmp_path / "out", workers=None, fail_on_gap=False).code


def _table(tmp_path: Path, name: str = "each.csv") -> dict[str, str]:
    text = (tmp_path / "out" / name).read_text()
    rows = json.loads(text)["logs"] if name == "each.json" else list(csv.DictReader(text.splitlines()))
    return {Path(row["log"]).stem: row["verdict"] for row in rows}


def _found(verdict: str) -> dict:
    return {"verdict": verdict, "gap": {}, "effects": []}


@pytest.mark.usefixtures("in_this_process")
def test_the_table_never_says_more_than_the_folders(tmp_path: Path) -> None:
    seen = []

    def work(log: str, asked: each.Asked):
        seen.append((_table(tmp_path), _table(tmp_path, "each.json")))
        found = _found("none" if len(seen) < 4 else "explained")
        return found, functools.partial(_filled, json.dumps(found))

    assert _run(tmp_path, work, "a", "b") == 0
    waiting = {"a": "waiting", "b": "waiting"}  # a line more of the CSV is an answer; the JSON waits for all
    assert seen == [({}, waiting), ({"a": "none"}, waiting)]
    assert _table(tmp_path) == _table(tmp_path, "each.json") == {"a": "none", "b": "none"}
    assert _run(tmp_path, work, "a", "b", "c") == 0
    kept = {"a": "none", "b": "none"}
    assert seen[2:] == [(kept, {**kept, "c": "waiting"})]
    (tmp_path / "b.csv").write_text("another night")
    names = [str(tmp_path / f"{name}.csv") for name in "abc"]
    assert [each.known_answer(job) is None for job in _jobs(tmp_path, names)] == [False, True, False]


def _jobs(tmp_path: Path, logs: list[str], **options: float) -> list[each.Job]:
    return each.jobs_of(
        logs, each.Asked("emps", (), None, None, {"quick": True, **options}), tmp_path / "out"
    )


@pytest.mark.parametrize("option", ["false_alarm", "worth"])
def test_another_bar_is_another_question(tmp_path: Path, option: str) -> None:
    (tmp_path / "a.csv").write_text("a night")
    one, other = (_jobs(tmp_path, [str(tmp_path / "a.csv")], **{option: x})[0] for x in (0.02, 0.1))
    assert one.made_of != other.made_of


@pytest.mark.usefixtures("in_this_process")
def test_a_full_disk_ends_the_command_and_costs_no_answer(tmp_path: Path) -> None:
    begun = []

    def work(log: str, asked: each.Asked):
        begun.append(Path(log).stem)
        full = begun == ["a", "b"]

        def fill(folder: Path) -> list[str]:
            if full:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder / "diagnosis.json"))
            return _filled(json.dumps(_found("none")), folder)

        return _found("none"), fill

    with pytest.raises(OutputError, match=r"out/b: cannot be written: No space left on device; nothing is"):
        _run(tmp_path, work, "a", "b", "c")
    assert begun == ["a", "b"]
    assert _table(tmp_path) == {"a": "none", "b": "waiting", "c": "waiting"} == _table(tmp_path, "each.json")
    assert _run(tmp_path, work, "a", "b", "c") == 0
    assert begun == ["a", "b", "b", "c"]
    assert _table(tmp_path) == dict.fromkeys("abc", "none")
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        *("a", "b", "c", "each.csv", "each.html", "each.json")
    ]


@pytest.mark.usefixtures("in_this_process")
def test_exit_code_2_has_its_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert _run(tmp_path, fails, "a", "b") == 2
    table = tmp_path / "out" / "each.csv"
    assert capfd.readouterr().err == f"pinotwin: 2 of 2 logs could not be diagnosed: see {table}\n"


def test_one_folder_is_for_one_command_at_a_time(tmp_path: Path) -> None:
    with alone_in(tmp_path / "out"), pytest.raises(OutputError, match="another pinotwin is writing here"):
        _run(tmp_path, fails, "a")


def test_a_file_in_the_place_of_an_answer_is_noticed_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "b").write_text("mine")
    with pytest.raises(OutputError, match="out/b: is a file"):
        _run(tmp_path, fails, "a", "b")
    assert not (tmp_path / "out" / "each.json").exists()


def fails(log: str, asked: each.Asked):
    raise LookupError(f"{log}: nobody foresaw this")


def test_an_error_that_nobody_foresaw_keeps_its_traceback(tmp_path: Path) -> None:
    asked = each.Asked("x", (), None, None, {"seed": 0})
    job = each.Job("a", tmp_path / "a", "x")
    with engine(1, apart=True) as run_all:
        ((_, error),) = run_all(functools.partial(each.do_job, work=fails, asked=asked), [job], None)
    row = each_table.failed(job.log, error)
    assert row["error"] == "LookupError: a: nobody foresaw this"
    assert "in fails" in row["traceback"]
    assert list(tmp_path.iterdir()) == []
