"""Python manners: file names do where objects do, wrong types are named, notebooks and help stay on one screen."""

from __future__ import annotations

import pydoc
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import pinotwin as pt
from pinotwin.cli.main import COMMANDS, main
from pinotwin.diagnosis import Diagnosis
from pinotwin.diagnosis.result import Gap
from pinotwin.errors import nearest
from pinotwin.logs.prepare import prepare
from tests.conftest import ROOT
from tests.simulated import known_twin, plain_machine, smooth_command

pandas = pytest.importorskip("pandas")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A machine, its twin and a log on disk."""
    home = tmp_path_factory.mktemp("manners")
    machine = plain_machine("emps")
    machine.save(home / "machine")
    twin = known_twin(machine)
    twin.save(home / "twin")
    command = smooth_command(machine, 6.0, 500.0)
    found = twin.simulate(command)
    made = {"t": command.t, "X.qr": command["X.qr"], "X.q": found["X.q"], "X.u": found["X.u"]}
    pt.Log(made).to_pandas().to_csv(home / "log.csv", index=False)
    return home


def test_paths_do_wherever_objects_do(folder):
    machine, twin, log = folder / "machine", folder / "twin", folder / "log.csv"
    assert pt.check(machine, log).ok
    assert len(pt.prepare(str(machine), [str(log)])) > 1000
    assert pt.Twin.load(twin).simulate(log)["X.q"].shape == pt.read(log).t.shape
    assert pt.decompose(twin, log).axes == ("X",)
    found = pt.identify(machine, str(log), validate=log, loop=False)
    again = pt.identify(pt.Machine.load(machine), pt.read(log), loop=False)
    np.testing.assert_allclose(found.theta, again.theta)


def test_a_table_will_do_as_a_log(folder):
    table = pandas.read_csv(folder / "log.csv")
    twin = pt.Twin.load(folder / "twin")
    np.testing.assert_array_equal(twin.simulate(table)["X.q"], twin.simulate(folder / "log.csv")["X.q"])


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: pt.identify(3, "log.csv"), "machine: expected a Machine, its folder, .* not int"),
        (lambda: pt.identify("emps", 3), "log: expected a Log, a file name or a pandas DataFrame, not int"),
        (lambda: pt.decompose({}, "log.csv"), "twin: expected a Twin or its folder, not dict"),
        (lambda: pt.identify("emps", "absent.csv"), "absent.csv"),
        (lambda: pt.check("emps", [1.0]), "not list"),
        (lambda: pt.Twin.load(3), "folder: expected a file or folder name, not int"),
        (lambda: pt.Machine.load(3), "path: expected a file or folder name, not int"),
        (lambda: pt.read(3), "paths: expected a file or folder name, not int"),
        (lambda: pt.resample(3, 100.0), "log: expected a Log, a file name"),
        (lambda: pt.new("emps", 3, out="m"), "log: expected a Log, a file name"),
        (lambda: pt.diagnose("emps", []), "no log given"),
        (lambda: known_twin(plain_machine("emps")).effort(3), "log: expected a Log, a file name"),
        (lambda: pt.export(None, "c", "x.c"), "twin: expected a Twin or its folder, not NoneType"),
    ],
)
def test_wrong_types_are_named_in_an_error_of_our_own(call, text):
    with pytest.raises(pt.InputError, match=text):
        call()


def test_pandas_there_and_back():
    log = pt.Log(
        {"t": np.arange(4.0), "X.q": np.array([1.0, 2.0, np.nan, 4.0])}, units={"X.q": "mm"}, notes=("a",)
    )
    table = log.to_pandas()
    assert table.attrs["units"] == {"X.q": "mm"}
    back = pt.Log.from_pandas(table)
    assert back.units == log.units
    for name in log.channels:
        np.testing.assert_array_equal(back[name], log[name])


def test_a_time_index_becomes_seconds_and_units_are_read():
    index = pandas.to_timedelta([0, 4, 8], unit="ms")
    table = pandas.DataFrame({"Y_ActPos [mm]": [1, 2, 3]}, index=index)
    log = pt.Log.from_pandas(table)
    np.testing.assert_allclose(log.t, [0.0, 0.004, 0.008])
    assert log.units == {"Y_ActPos": "mm"}
    with pytest.raises(pt.LogError, match="column 'name' does not hold numbers"):
        pt.Log.from_pandas(pandas.DataFrame({"t": [0.0], "name": ["x"]}))


def test_notebook_cells_are_short_and_escaped(folder):
    log = pt.Log({"t": np.arange(3.0), "<b>": np.ones(3)}, source="a<b>.csv")
    cells = [pt.Twin.load(folder / "twin"), pt.Machine.load(folder / "machine"), log]
    for cell in cells:
        text = cell._repr_html_()
        assert len(text) < 6000
        assert text.count("<tr>") <= 26
    assert "<b>" not in log._repr_html_()
    assert "&lt;b&gt;" in log._repr_html_()


def test_repr_is_one_short_screen(folder):
    log = pt.Log({"t": np.arange(3.0), "x": np.ones(3)}, source="a.csv")
    twin = pt.Twin.load(folder / "twin")
    machine = pt.Machine.load(folder / "machine")
    t = np.arange(0.0, 4.0, 0.002)
    channels = {"t": t}
    table = pt.Machine.load("trunnion")
    for k, axis in enumerate(table.axes):
        channels |= {f"{axis}.q": 0.1 * np.sin((2 + k) * t), f"{axis}.u": np.cos((2 + k) * t)}
    motion = prepare(table, pt.Log(channels))
    gap = {"Y": {"u": Gap(5.0, 0.05, 1.0, 5.0)}}
    found = Diagnosis("Nothing", gap, [], [], [], {}, {}, "assumed", [], "structure", {}, machine="mill")
    others = (
        pt.check(machine, folder / "log.csv"),
        pt.compare(twin, twin),
        pt.decompose(twin, folder / "log.csv"),
        pt.export(twin, "c", folder / "effort.c"),
        pt.new("XYZAC", folder / "log.csv", out=folder / "fresh"),
    )
    for one in (log, twin, machine, motion, found, *others):
        text = repr(one)
        assert text.startswith("<")
        assert len(text.splitlines()) <= 30
        assert len(text) < 3000
        assert one._repr_html_().startswith("<div>")
    assert "Y.u" in repr(found)
    assert "not judged" in repr(found)


def test_help_of_the_package_is_one_look():
    text = pydoc.plain(pydoc.render_doc(pt))
    assert len(text.splitlines()) < 90
    for name in dir(pt):
        if not name.startswith("__"):
            assert re.search(rf"\b{name}\b", pt.__doc__), f"{name} is not in the package's docstring"


def test_public_names_load_and_have_docstrings():
    names = [name for name in dir(pt) if not name.startswith("__")]
    assert 25 <= len(names) <= 36  # one for each command, and the nouns
    for name in names:
        value = getattr(pt, name)
        assert isinstance(value, dict) or value.__doc__, name


def test_types_are_for_users_too():
    assert (Path(pt.__file__).parent / "py.typed").is_file()


def test_pinotwin_alone_prints_the_help(capsys):
    assert main([]) == 0
    assert "commands:" in capsys.readouterr().out


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_a_description_an_example_and_defaults(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert f"example:\n  pinotwin {command} " in text
    assert max(map(len, text.splitlines())) <= 80
    assert "(None)" not in text
    assert "(False)" not in text


def test_docs_and_examples_take_public_names_through_the_front_door():
    """One way for one thing: what `pt.` has is not imported from inside."""
    places = [ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *(ROOT / "examples").glob("*.[pi]*")]
    texts = {p: p.read_text() for p in places}
    inside = [
        (path.name, name)
        for path, text in texts.items()
        for line in re.findall(r"from pinotwin[.\w]* import ([\w, ]+)", text)
        for name in line.split(", ")
        if name in dir(pt)
    ]
    assert inside == []
    assert [
        p.name for p, text in texts.items() if re.search(r"pt\.(identify|diagnose|check)\(\"", text)
    ] == []


@pytest.mark.parametrize(
    ("given", "first"),
    [("diagnos", "diagnose"), ("bration", "vibration"), ("PORT", "export"), ("identfy", "identify")],
)
def test_an_unknown_command_is_answered_with_those_that_contain_it_first(given, first, capfd) -> None:
    assert main([given, "trunnion"]) == 2
    assert f"no command {given!r}; did you mean {first!r}?" in capfd.readouterr().err


def test_names_that_contain_what_was_given_come_before_those_spelled_like_it() -> None:
    words = [f"word{k}" for k in range(30)] + ["talos_reduced", "full_talos_v2", "tales", "TALOS_arm"]
    assert nearest("talos", words).startswith(
        "did you mean 'TALOS_arm'? nearest of 34: TALOS_arm, talos_reduced, full_talos_v2, tales"
    )
    assert nearest("", words).startswith("some of 34")


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh", "fish"])
def test_a_shell_completes_every_command_and_its_options(shell: str, capfd) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--print-completion", shell])
    assert ended.value.code == 0
    script = capfd.readouterr().out
    assert all(command in script for command in COMMANDS)
    assert "fail-on-gap" in script


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_a_command_and_a_file(tmp_path: Path, capfd) -> None:
    with pytest.raises(SystemExit):
        main(["--print-completion", "bash"])
    (tmp_path / "completion").write_text(capfd.readouterr().out)
    (tmp_path / "monday.csv").touch()
    ask = 'COMP_WORDS=(pinotwin {}); COMP_CWORD={}; _shtab_pinotwin; echo "${{COMPREPLY[@]}}"\n'
    script = "source ./completion\n" + ask.format("diag", 1) + ask.format("check trunnion mon", 3)
    done = subprocess.run(["bash", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["diagnose", "monday.csv"]
