"""The withheld bench in small, from the command: runs, resumes, is deterministic, writes its table."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace

import psutil
import pytest

from pinotwin.bench.cases import Case, draw_cases
from pinotwin.bench.oracle import evidence
from pinotwin.bench.produce import produce
from pinotwin.bench.run import Plan, answer, append, run_bench, written
from pinotwin.cli.main import main


@pytest.fixture(scope="module")
def cases():
    one = [c for c in draw_cases(["emps"], 1, situations=["structure"]) if c.kind != "double"]
    wanted = {"healthy": None, "outside": None, "left_out": None, "single": "viscous"}
    found = (
        next(c for c in one if c.kind == k and (e is None or c.effects[0][0] == e)) for k, e in wanted.items()
    )
    return [replace(c, number=k) for k, c in enumerate(found)]


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    return Plan(tmp_path_factory.mktemp("bench"), seconds=4.0, workers=1)


@pytest.fixture(scope="module")
def answers(cases, plan):
    return run_bench(cases, plan)


def test_a_small_bench_answers_every_case(cases, answers):
    assert [a.number for a in answers] == [c.number for c in cases]
    assert {a.kind for a in answers} == {"healthy", "outside", "left_out", "single"}
    for a in answers:
        assert a.verdict in ("none", "explained", "partly_explained", "unexplained")
        assert set(a.seconds) == {"produce", "diagnose", "oracle"}
        assert len(a.sizes) == len(a.truth)
        assert (a.oracle is None) == (a.kind == "healthy")


def test_an_oracle_sees_twice_as_much_of_an_effect_twice_as_large():
    small, large = (
        evidence(
            produce(
                Case(0, "emps", "structure", "single", (("quadratic_drag", "X", size),), 11), seconds=4.0
            ),
            None,
        )
        for size in (0.02, 0.04)
    )
    assert small > 1e-3
    assert large / small == pytest.approx(2.0, rel=0.15)  # the twin runs differ in their noise


def test_a_bench_goes_on_where_it_stopped(cases, plan, answers, tmp_path):
    lines = plan.file.read_text().splitlines()
    other = replace(plan, folder=tmp_path)
    other.file.write_text("\n".join([*lines[:2], lines[2][:40]]))  # broke off in the third
    stages = []
    again = run_bench(cases[:2], other, lambda stage, done: stages.append(stage))
    assert again == answers[:2]
    assert stages == []  # nothing was left to run
    assert len(written(other.file)) == 2


def test_the_same_case_gets_the_same_answer(cases, plan, answers):
    # A fresh run of the sealed case in another folder: only the times differ.
    again = answer(cases[0], plan)
    assert replace(again, seconds={}) == replace(answers[0], seconds={})


def test_a_dead_worker_in_the_middle_changes_no_answer(cases, answers, tmp_path):
    killed = []

    def kill_one(stage: str, done: float) -> None:
        """After the first answer, kill a worker: as many cases as there are workers are being done."""
        every = psutil.Process().children(recursive=True)
        # one that has ended has no command
        children = [p for p in every if p.status() != psutil.STATUS_ZOMBIE]
        workers = [p for p in children if "spawn_main" in " ".join(p.cmdline()) and p.children() == []]
        if not killed and workers:
            killed.append(max(workers, key=lambda p: sum(p.cpu_times()[:2])).pid)
            psutil.Process(killed[0]).kill()

    again = run_bench(cases, Plan(tmp_path, seconds=4.0, workers=2), kill_one)
    assert killed
    assert [replace(a, seconds={}) for a in again] == [replace(a, seconds={}) for a in answers]


def test_two_processes_on_one_folder_give_the_same_answers(tmp_path):
    words = ["blind", "--machines", "emps", "--situations", "structure", "--cases", "3", "--seconds", "4"]
    words += ["--workers", "1", "--quick", "--out"]
    line = [sys.executable, "-m", "pinotwin.cli.main", *words, str(tmp_path / "one")]
    both = [subprocess.Popen(line, stdout=subprocess.DEVNULL) for _ in "ab"]
    assert main([*words, str(tmp_path / "alone")]) == 0
    assert [p.wait(timeout=600) for p in both] == [0, 0]
    one, alone = (
        json.loads((tmp_path / name / "bench.json").read_text())["answers"] for name in ("one", "alone")
    )
    for row in (*one, *alone):
        row.pop("seconds")
    assert one == alone
    lines = (tmp_path / "one" / "cases.jsonl").read_text().splitlines()
    assert {json.loads(text)["number"] for text in lines} == {row["number"] for row in alone}


def test_a_diagnosis_that_breaks_off_is_a_wrong_answer_and_the_bench_goes_on(tmp_path):
    impossible = Case(0, "emps", "structure", "single", (("viscous", "nowhere", 0.1),), 1)
    (said,) = run_bench([impossible], Plan(tmp_path, seconds=4.0, workers=1))
    assert said.verdict == "error"
    assert "nowhere" in said.error
    assert not said.right()


def test_the_command_writes_table_page_and_json(tmp_path, capsys):
    out = tmp_path / "out"
    line = [
        "blind",
        "--machines",
        "emps",
        "--situations",
        "structure",
        "--cases",
        "2",
        "--seconds",
        "4",
        "--workers",
        "1",
        "--out",
        str(out),
    ]
    assert main(line) == 0
    assert "healthy machine accused of anything" in capsys.readouterr().out
    content = json.loads((out / "bench.json").read_text())
    assert content["planned"] == 2
    assert len(content["answers"]) == 2
    assert "The withheld bench" in (out / "bench.html").read_text()
    assert (out / "bench.md").read_text().startswith("# The withheld bench")
    assert len((out / "cases.jsonl").read_text().splitlines()) == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--seeds", "0"], "--seeds: must be at least 1"),
        (["--cases", "-1"], "--cases: must be at least 1"),
        (["--seconds", "1"], "--seconds: 1: expected 2 to 120"),
        (["--limit-minutes", "0"], "--limit-minutes: must be positive"),
        (["--machines", "nosuch"], "no machine 'nosuch'"),
    ],
)
def test_bad_arguments_are_refused(arguments, message, tmp_path, capsys):
    assert main(["blind", *arguments, "--out", str(tmp_path / "b")]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "b" / "cases.jsonl").exists()


def test_answers_of_other_code_are_not_used(cases, plan, answers, tmp_path, monkeypatch):
    monkeypatch.setattr("pinotwin.bench.run.fingerprint", lambda: "other")
    assert not set(written(plan.file)) & {plan.key(c) for c in cases}


def test_broken_lines_and_errors_are_run_again(cases, plan, answers, tmp_path):
    good = plan.file.read_text().splitlines()[0]
    key = json.loads(good)["key"]
    file = tmp_path / "cases.jsonl"
    file.write_text(good[:40])  # the disk was full
    append(file, key, answers[0])
    with file.open("a") as stream:
        stream.write(json.dumps({**json.loads(good), "key": "failed", "verdict": "error"}) + "\n{}\n[1]\n")
    assert set(written(file)) == {key}
