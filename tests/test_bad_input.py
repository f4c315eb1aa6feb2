"""Malformed machines, logs and options: one clear line, exit code 2, nothing half-written."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pinotwin.errors import TwinError
from pinotwin.twin import Twin
from tests.rig import TRUTH, URDF, YAML, good_log, run, write_log, write_machine

Channels = dict[str, np.ndarray]


def refused(capfd: pytest.CaptureFixture[str], out: Path, said: tuple[str, ...], *words: object) -> None:
    """Assert that a command is refused in one line that says ``said``, and leaves ``out`` alone."""
    before = _listing(out.parent)
    capfd.readouterr()
    code = run(*words)
    error = capfd.readouterr().err
    assert code == 2, error
    assert error.count("\n") == 1, error
    assert error.startswith("pinotwin"), error
    for text in said:
        assert text in error, error
    assert "Traceback" not in error
    assert _listing(out.parent) == before


def _listing(folder: Path) -> dict[str, bytes]:
    return {str(p): p.read_bytes() if p.is_file() else b"" for p in sorted(folder.rglob("*"))}


def swap(old: str, new: str) -> str:
    assert old in URDF
    return URDF.replace(old, new)


def lines(old: str, new: str) -> str:
    assert old in YAML
    return YAML.replace(old, new)


def axis(settings: str) -> str:
    return lines("joint: jb", f"joint: jb, {settings}")


def effect(item: str) -> str:
    return axis(f"effects: [{item}]")


ARM = '<link name="arm">'
NO_ARM = URDF[: URDF.index(ARM)] + '<link name="arm"/>' + URDF[URDF.index('<joint name="jx"') :]
RING = """<link name="p"/><link name="q"/>
<joint name="pq" type="fixed"><parent link="p"/><child link="q"/></joint>
<joint name="qp" type="fixed"><parent link="q"/><child link="p"/></joint></robot>"""
BOMB = (
    '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(10))
    + "]>"
    + swap('name="arm"', 'name="&k;"')
)

URDFS: list[tuple[str, str | bytes | None, tuple[str, ...]]] = [
    ("missing", None, ("rig.urdf: no such URDF file", "check `urdf`")),
    ("empty", "", ("rig.urdf: not valid XML", "export it again")),
    ("garbage", bytes(range(256)) * 4, ("rig.urdf: not valid XML",)),
    ("cut off", URDF[:300], ("rig.urdf: not valid XML", "line 6")),
    ("no urdf", "<html></html>", ("root element is <html>", "starts with <robot>")),
    ("namespace", swap("<robot ", '<robot xmlns="http://ros.org" '), ("namespace", "xmlns")),
    (
        "xacro",
        '<robot xmlns:xacro="x" name="r"><xacro:include filename="b"/></robot>',
        ("is a xacro file", "expand it first"),
    ),
    ("two documents", URDF + URDF, ("not valid XML", "Extra content")),
    ("entity bomb", BOMB, ("not valid XML", "amplification")),
    ("no link", '<robot name="r"/>', ("no <link>",)),
    ("two roots", swap("</robot>", '<link name="lost"/></robot>'), ("2 root links", "base, lost")),
    ("dangling", swap('child link="arm"', 'child link="amr"'), ("'jb'", "'amr'", "did you mean 'arm'")),
    ("no parent", swap('<parent link="slide"/>', ""), ("'jb'", "no <parent")),
    ("loop", swap('<parent link="base"/>', '<parent link="arm"/>'), ("jb, jx form a loop", "cut")),
    ("loop beside the tree", swap("</robot>", RING), ("joints pq, qp form a loop",)),
    (
        "two parents",
        swap(
            "</robot>",
            '<joint name="z" type="fixed"><parent link="base"/><child link="arm"/></joint></robot>',
        ),
        ("'arm' is the child of both 'jb' and 'z'",),
    ),
    ("link twice", swap('<link name="base"/>', '<link name="base"/>' * 2), ("link 'base'", "twice")),
    ("joint twice", swap('name="jb"', 'name="jx"'), ("joint 'jx'", "twice")),
    ("joint without name", swap(' name="jb"', ""), ("line 9", "<joint> has no name")),
    ("negative mass", swap('value="2"', 'value="-2"'), ("link 'arm'", "-2 kg is negative")),
    ("mass in words", swap('value="2"', 'value="2 kg"'), ("link 'arm' mass", "'2 kg'")),
    ("massless leaf", NO_ARM, ("joint 'jb' moves no inertia", "<inertial>")),
    ("inertial without mass", swap('<mass value="2"/>', ""), ("link 'arm'", "needs <mass>")),
    ("NaN inertia", swap('izz="0.02"', 'izz="nan"'), ("link 'arm' izz", "'nan'")),
    ("NaN origin", swap('xyz="0 0 0.1"', 'xyz="0 0 nan"'), ("'jb' origin xyz", "'nan'")),
    ("two numbers", swap('xyz="0 0 0.1"', 'xyz="0 0"'), ("'jb' origin xyz", "expected 3")),
    ("zero axis", swap('axis xyz="0 1 0"', 'axis xyz="0 0 0"'), ("'jb'", "'0 0 0' is no direction")),
    ("NaN axis", swap('axis xyz="0 1 0"', 'axis xyz="0 nan 0"'), ("'jb' axis", "'nan'")),
    ("limit in words", swap('lower="-2"', 'lower="-2deg"'), ("'jb' limit lower", "'-2deg'")),
    ("limits swapped", swap('lower="-2" upper="2"', 'lower="2" upper="-2"'), ("'jb'", "swap them")),
    ("negative limit", swap('velocity="10"', 'velocity="-10"'), ("'jb'", "velocity limit -10")),
    ("joint type", swap('"revolute"', '"revolut"'), ("'jb'", "did you mean 'revolute'")),
    ("floating axis", swap('"revolute"', '"floating"'), ("axes.B.joint", "'jb' is floating")),
]


@pytest.mark.parametrize(("urdf", "said"), [c[1:] for c in URDFS], ids=[c[0] for c in URDFS])
def test_malformed_urdf(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], urdf: str, said: tuple[str, ...]
) -> None:
    machine = write_machine(tmp_path / "rig", urdf)
    log, out = write_log(tmp_path / "log.csv", good_log()), tmp_path / "out"
    refused(capfd, out, (str(machine / "rig.urdf")[:-9], *said), "identify", machine, log, "--out", out)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('value="2"', 'value="0"', "without mass"),
        ('izz="0.02"', 'izz="2"', "triangle inequality"),
        ('izz="0.02"', 'izz="-2"', "negative"),
    ],
)
def test_a_body_that_cannot_be_is_named_and_the_machine_identified(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], old: str, new: str, said: str
) -> None:
    machine = write_machine(tmp_path / "rig", swap(old, new))
    log, out = write_log(tmp_path / "log.csv", good_log()), tmp_path / "out"
    assert run("check", machine, log) == 0
    named = [line for line in capfd.readouterr().out.splitlines() if "cannot exist" in line]
    assert len(named) == 1
    assert all(word in named[0] for word in ("warning jb", said, "correct the <inertial>"))
    assert run("identify", machine, log, "--no-loop", "--out", out) == 0
    assert Twin.load(out).quality["relative_error"] < 0.1


NO_B = lines("  B: {joint: jb}\n", "")

YAMLS: list[tuple[str, str | bytes | None, tuple[str, ...]]] = [
    ("missing", None, ("no machine.yaml", "found: rig.urdf")),
    ("empty", "", ("expected keys such as name, urdf, axes",)),
    ("garbage", bytes(range(256)) * 4, ("not a text file",)),
    ("a list", "- a\n", ("expected keys such as name",)),
    ("syntax", "name: [a\nurdf: x\n", ("line 2",)),
    ("tab", "name: a\n\turdf: x\n", ("line 2", "\\t")),
    ("a python object", YAML + "imus: !!python/object/apply:os.getcwd []\n", ("line 6", "tag")),
    ("a list as key", YAML + "? [a, b]\n: 1\n", ("line 6", "a key must be one word")),
    ("top key", YAML + "passiv: {}\n", ("passiv: unknown key", "did you mean 'passive'")),
    ("no name", lines("name: rig\n", ""), ("name: missing",)),
    ("a name that is a path", lines("name: rig", "name: ../rig"), ("name: '../rig'",)),
    ("urdf is no file name", lines("urdf: rig.urdf", "urdf: [a]"), ("urdf: expected",)),
    ("key twice", YAML + "name: other\n", ("line 6", "'name' is given twice")),
    ("axis twice", YAML + "  X: {joint: jb}\n", ("line 6", "'X' is given twice")),
    ("axes are a list", lines("  X: {joint: jx}\n  B: {joint: jb}\n", "  [X, B]\n"), ("axes: expected",)),
    ("axis is a word", lines("{joint: jb}", "jb"), ("axes.B: expected keys and values, found 'jb'",)),
    ("axis with a comma", lines("  B:", '  "a,b":'), ("axes: 'a,b'",)),
    ("axis key", lines("joint: jb", "joint: jb, zeroo: 1"), ("axes.B.zeroo", "did you mean 'zero'")),
    ("unknown joint", lines("joint: jb", "joint: jbb"), ("axes.B.joint", "did you mean 'jb'")),
    ("joint twice", lines("joint: jb", "joint: jx"), ("axes.B.joint", "'jx' is used twice")),
    ("axis and passive", YAML + "passive: {B: {joint: jb}}\n", ("passive.B", "under axes")),
    ("passive of an axis", YAML + "passive: {d: {joint: jb}}\n", ("passive.d.joint", "used twice")),
    ("passive key", NO_B + "passive: {d: {joint: jb, stifness: 3}}\n", ("did you mean 'stiffness'",)),
    ("soft spring", NO_B + "passive: {d: {joint: jb, stiffness: -5}}\n", ("passive.d.stiffness",)),
    ("unknown effect", effect("viscos"), ("axes.B.effects[0]", "did you mean 'viscous'")),
    ("effects are a word", axis("effects: viscous"), ("axes.B.effects", "expected a list")),
    ("effect twice", effect("viscous, viscous"), ("axes.B.effects", "twice")),
    ("effect is a number", effect("3"), ("axes.B.effects[0]", "found 3")),
    ("effect's key", effect("{stribeck: {vs: 3}}"), ("effects[0].stribeck.vs", "did you mean 'v_s'")),
    ("setting in words", effect("{stribeck: {v_s: fast}}"), ("stribeck.v_s", "'fast'")),
    ("setting below zero", effect("{stribeck: {v_s: -1}}"), ("stribeck.v_s", "positive")),
    ("setting NaN", effect("{stribeck: {v_s: .nan}}"), ("stribeck.v_s", "positive number")),
    ("table of width 0", effect("{position_table: {spacing: 0}}"), ("spacing", "positive")),
    ("half a harmonic", effect("{ripple: {harmonics: 2.5}}"), ("ripple.harmonics", "whole number")),
    (
        "empty search",
        effect("{ripple: {shortest: 2, longest: 1}}"),
        ("effects[0].ripple", "searched from 2 to 1"),
    ),
    ("wrist alone", effect("wrist_coupling"), ("wrist_coupling needs `with:`",)),
    ("rotor below zero", axis("rotor_inertia: -1"), ("axes.B.rotor_inertia", "negative")),
    ("limit of zero", axis("effort_limit: 0"), ("axes.B.effort_limit", "positive")),
    ("speed below zero", axis("min_speed: -1"), ("axes.B.min_speed", "negative")),
    (
        "singular transmission",
        YAML + "transmission: {X: {X: 1, B: 1}, B: {X: 1, B: 1}}\n",
        ("transmission", "singular"),
    ),
    ("motor of no axis", YAML + "transmission: {x: {X: 1}}\n", ("transmission.x", "did you mean 'X'")),
    ("unit", YAML + "columns: {X.q: {column: a, unit: mmm}}\n", ("columns.X.q.unit", "did you mean 'mm'")),
    ("factor 0", YAML + "columns: {X.q: {column: a, factor: 0}}\n", ("columns.X.q.factor",)),
    ("column key", YAML + "columns: {X.q: {colum: a}}\n", ("columns.X.q.colum", "'column'")),
    ("column of no axis", YAML + "columns: {x.q: a}\n", ("columns.x.q: no axis", "did you mean 'X'")),
    ("column of no link", YAML + "columns: {hand.fx: a}\n", ("columns.hand.fx: no link 'hand'",)),
    ("no such signal", YAML + "columns: {X.pos: a}\n", ("columns.X.pos: no such signal",)),
    ("imu on no link", YAML + "imus: {i: {link: arn}}\n", ("imus.i.link", "did you mean 'arm'")),
    ("imu key", YAML + "imus: {i: {lnk: arm}}\n", ("imus.i.lnk", "did you mean 'link'")),
    ("loop of no axis", YAML + "loop: {Q: {}}\n", ("loop.Q: unknown key",)),
    ("loop key", YAML + "loop: {X: {poles: 3}}\n", ("loop.X.poles", "'real_poles'")),
    ("half a pole", YAML + "loop: {X: {real_poles: 2.5}}\n", ("loop.X.real_poles", "whole number")),
    ("data key", YAML + "data: {cutof: 3}\n", ("data.cutof", "did you mean 'cutoff'")),
    ("data cutoff", YAML + "data: {cutoff: -3}\n", ("data.cutoff", "positive")),
    ("data drop", YAML + "data: {drop: [1, 2, 3]}\n", ("data.drop", "start and the end")),
    ("data order", YAML + "data: {order: 100}\n", ("data.order", "1 to 10")),
]


@pytest.mark.parametrize(("yaml", "said"), [c[1:] for c in YAMLS], ids=[c[0] for c in YAMLS])
def test_malformed_yaml(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], yaml: str, said: tuple[str, ...]
) -> None:
    machine = write_machine(tmp_path / "rig", yaml=yaml)
    log, out = write_log(tmp_path / "log.csv", good_log()), tmp_path / "out"
    refused(capfd, out, (str(machine), *said), "identify", machine, log, "--out", out)


def without(*names: str) -> Callable[[Channels], Channels]:
    return lambda c: {k: x for k, x in c.items() if k not in names}


def changed(name: str, how: Callable[[np.ndarray], np.ndarray]) -> Callable[[Channels], Channels]:
    return lambda c: {**c, name: how(c[name])}


def every(ending: str, how: Callable[[np.ndarray], np.ndarray]) -> Callable[[Channels], Channels]:
    return lambda c: {k: how(x) if k.endswith(ending) else x for k, x in c.items()}


def value(name: str, row: int, x: float) -> Callable[[Channels], Channels]:
    def spoil(c: Channels) -> Channels:
        c[name][row] = x
        return c

    return spoil


def holes(c: Channels) -> Channels:
    for k in range(3):  # more in a row than are bridged
        c["X.q"][k::15] = np.nan
    return c


RNG = np.random.default_rng(0)
LOGS: list[tuple[str, Callable[[Channels], Channels], tuple[str, ...]]] = [
    ("no clock", without("t"), ("no time channel t", "rate")),
    ("no position", without("X.q"), ("no channel X.q", "axis X", "did you mean 'X.qr'")),
    ("no effort", without("X.u", "B.u"), ("no axis has both effort and motion",)),
    ("efforts always zero", every(".u", np.zeros_like), ("no axis has both effort and motion",)),
    ("command of one axis", without("B.qr"), ("command missing for axis B", "B.qr")),
    ("positions all NaN", changed("X.q", lambda x: x * np.nan), ("X.q: holds no number",)),
    ("efforts all NaN", changed("X.u", lambda x: x * np.nan), ("X.u: holds no number",)),
    ("clock all NaN", changed("t", lambda t: t * np.nan), ("t: ", "does not advance")),
    ("everything NaN", every("", lambda x: x * np.nan), ("t: ", "does not advance")),
    ("clock stands", changed("t", np.zeros_like), ("t: ", "does not advance")),
    ("clock runs backward", changed("t", lambda t: t[::-1]), ("t: ", "does not advance")),
    ("stamps all twice", changed("t", lambda t: np.repeat(t[::2], 2)), ("t: ", "repeated stamps")),
    ("clock jumps all the time", changed("t", lambda t: t % 0.02), ("t: ", "resample")),
    ("random stamps", changed("t", lambda t: np.sort(RNG.uniform(0, 4, len(t)))), ("irregular",)),
    ("clock in ms", changed("t", lambda t: 1e3 * t), ("0.5 samples per second", "unit: ms")),
    ("clock in ns", changed("t", lambda t: 1e9 * (t + 1.7e9)), ("t: ", "unit")),
    ("one row", lambda c: {k: x[:1] for k, x in c.items()}, ("single row",)),
    ("five rows", lambda c: {k: x[:5] for k, x in c.items()}, ("only 5 rows", "record longer")),
    ("twenty rows", lambda c: {k: x[:20] for k, x in c.items()}, ("record longer",)),
    ("holes everywhere", holes, ("X.q: 402 of 2000 values are missing",)),
    ("nothing moves", every("q", np.zeros_like), ("no axis has both effort and motion",)),
    ("sentinel", value("X.q", 7, 1e30), ("X.q: 1e+30 in row 7", "no measurement")),
    ("overflow", value("X.u", 7, 1e300), ("X.u: 1e+300 in row 7", "no measurement")),
    ("load on no link", lambda c: {**c, "hand.fx": c["t"]}, ("'hand'", "no link of rig")),
    ("load never logged", lambda c: {**c, "arm.fx": c["t"] * np.nan}, ("arm.fx: holds no number",)),
    ("another machine", lambda c: {"t": c["t"], "Y.q": c["X.q"]}, ("no channel X.q", "Y.q")),
]


@pytest.mark.parametrize(("spoil", "said"), [c[1:] for c in LOGS], ids=[c[0] for c in LOGS])
def test_malformed_log(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    spoil: Callable[[Channels], Channels],
    said: tuple[str, ...],
) -> None:
    machine = write_machine(tmp_path / "rig")
    log, out = write_log(tmp_path / "log.csv", spoil(good_log())), tmp_path / "out"
    out.mkdir()
    (out / "twin.json").write_text("of an earlier run")
    refused(capfd, out, (str(log), *said), "identify", machine, log, "--out", out)


def spoiled_line(row: int, how: Callable[[str], str]) -> Callable[[list[str]], list[str]]:
    return lambda rows: [*rows[:row], how(rows[row]), *rows[row + 1 :]]


TEXTS: list[tuple[str, Callable[[list[str]], list[str]], tuple[str, ...]]] = [
    ("empty", lambda _: [""], ("holds no lines of data", "record")),
    ("header only", lambda rows: rows[:1], ("no rows of numbers",)),
    ("no header", lambda rows: rows[1:], ("no channel has a name of the contract",)),
    ("a word", spoiled_line(500, lambda r: "abc" + r[r.index(",") :]), ("line 501", "'t'", "'abc'")),
    ("a cell too many", spoiled_line(500, lambda r: r + ",1"), ("line 501", "8 cells", "7")),
    ("cut off", lambda rows: [*rows[:-1], rows[-1][:20]], ("cut off", "delete this last line")),
    ("unknown unit", spoiled_line(0, lambda r: r.replace("X.q,", "X.q [furlong],")), ("X.q",)),
]


@pytest.mark.parametrize(("spoil", "said"), [c[1:] for c in TEXTS], ids=[c[0] for c in TEXTS])
def test_malformed_text(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    spoil: Callable[[list[str]], list[str]],
    said: tuple[str, ...],
) -> None:
    machine, out = write_machine(tmp_path / "rig"), tmp_path / "out"
    log = write_log(tmp_path / "log.csv", good_log())
    log.write_text("\n".join(spoil(log.read_text().splitlines())) + "\n")
    refused(capfd, out, (str(log), *said), "identify", machine, log, "--out", out)


@pytest.fixture
def rig(tmp_path: Path) -> tuple[Path, Path]:
    return write_machine(tmp_path / "rig"), write_log(tmp_path / "log.csv", good_log())


OPTIONS: list[tuple[str, tuple[str, ...], tuple[str, ...]]] = [
    ("corner below zero", ("--cutoff", "-5"), ("--cutoff", "-5")),
    ("corner NaN", ("--cutoff", "nan"), ("--cutoff", "nan")),
    ("corner in words", ("--cutoff", "low"), ("--cutoff", "'low'")),
    ("corner far too low", ("--cutoff", "0.001"), ("record longer",)),
    ("decimation of 0", ("--decimate", "0"), ("--decimate", "at least 1")),
    ("decimation to nothing", ("--decimate", "100000"), ("rows for 8 parameters",)),
    ("unknown option", ("--cutof", "3", "--wat"), ("--wat",)),
    ("validation missing", ("--validate", "{tmp}/no.csv"), ("no.csv: no such file", "log.csv")),
    ("json is a folder", ("--json", "{tmp}"), ("is a folder",)),
    ("json unwritable", ("--json", "/proc/r.json"), ("/proc cannot be written to",)),
    ("out is a file", ("--out", "{tmp}/log.csv"), ("log.csv: is a file",)),
    ("out unwritable", ("--out", "/proc/out"), ("/proc cannot be written to",)),
    ("out without a name", ("--out", ""), ("--out: no name",)),
]


@pytest.mark.parametrize(("words", "said"), [c[1:] for c in OPTIONS], ids=[c[0] for c in OPTIONS])
def test_options_that_cannot_be(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    rig: tuple[Path, Path],
    words: tuple[str, ...],
    said: tuple[str, ...],
) -> None:
    filled = [word.format(tmp=tmp_path) for word in words]
    out = ["--out", tmp_path / "out"] if "--out" not in words else []
    refused(capfd, tmp_path / "out", said, "identify", *rig, *filled, *out)


def test_several_logs_must_fit_together(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], rig: tuple[Path, Path]
) -> None:
    machine, log = rig
    out = tmp_path / "out"
    half = {k: x[:1000] for k, x in good_log().items() if k[0] == "B"}
    other = write_log(tmp_path / "b.csv", half)
    said = ("different length", "log.csv 2000", "b.csv 1000")
    refused(capfd, out, said, "identify", machine, f"{log}+{other}", "--out", out)


def test_rates_that_differ_by_rounding_are_one_rate(tmp_path: Path, rig: tuple[Path, Path]) -> None:
    machine, log = rig
    drift = write_log(tmp_path / "b.csv", changed("t", lambda t: t * (1 + 1e-5))(good_log()))
    assert run("identify", machine, log, drift, "--out", tmp_path / "out", "--no-loop") == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("check", "no_such"), ("no_such: no such machine", "trunnion")),
        (("check", "{tmp}/no/machine.yaml"), ("no such file",)),
        (("check", ""), ("no machine named",)),
        (("check", "{tmp}/log.csv"), ("log.csv: expected keys such as name",)),
        (("check", "{tmp}/rig", "{tmp}/rig"), ("is a folder", "name a log")),
        (("chekc", "trunnion"), ("'chekc'", "check")),
        (("view", "{tmp}/rig", "--html", "{tmp}/v.html", "--posture", "Q=1"), ("posture", "'Q'")),
        (("view", "{tmp}/rig", "--html", "{tmp}/v.html", "--posture", "B=1mm"), ("'mm'", "turns")),
        (("view", "{tmp}/rig", "--html", "{tmp}/log.csv/v.html"), ("log.csv is not a folder",)),
        (("record", "{tmp}/rig", "--out", "{tmp}/l.txt"), ("--out: l.txt", ".csv or .parquet")),
        (("record", "{tmp}/rig", "--out", "{tmp}/l.csv", "--seconds", "nan"), ("--seconds",)),
        (("record", "{tmp}/rig", "--out", "{tmp}/l.csv", "--seed", "-1"), ("--seed",)),
        (
            ("record", "{tmp}/rig", "--out", "{tmp}/l.csv", "--trajectory", "slow_reversals", "--axis", "x"),
            ("--axis", "did you mean 'X'"),
        ),
    ],
    ids=lambda x: "-".join(x)[:40].replace("/", "") if isinstance(x, tuple) else None,
)
def test_other_commands(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    rig: tuple[Path, Path],
    words: tuple[str, ...],
    said: tuple[str, ...],
) -> None:
    filled = [word.format(tmp=tmp_path) for word in words]
    refused(capfd, tmp_path / "out", said, *filled)


# What a log does not say is no error, but it must be said.


def parameters(out: Path) -> dict[str, dict[str, object]]:
    content = json.loads((out / "twin.json").read_text())
    return {row["name"]: row for row in content["parameters"]}


def identified(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], spoil: Callable[[Channels], Channels]
) -> tuple[dict[str, dict[str, object]], str]:
    """Return the parameter table of a spoiled log, and what the command said of it."""
    machine = write_machine(tmp_path / "rig")
    log, out = write_log(tmp_path / "log.csv", spoil(good_log())), tmp_path / "out"
    assert run("identify", machine, log, "--out", out, "--no-loop") == 0
    said = capfd.readouterr()
    assert said.err == ""
    return parameters(out), said.out


def test_a_good_log_finds_the_truth_and_complains_of_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    found, said = identified(tmp_path, capfd, lambda c: c)
    assert "note" not in said
    for name, truth in TRUTH.items():
        row = found[name]
        assert row["determined"]
        assert abs(row["value"] - truth) < 4 * row["standard_error"] + 0.005 * abs(truth), name


SILENT_B: list[tuple[str, Callable[[Channels], Channels], str]] = [
    ("no effort channel", without("B.u"), "no effort B.u"),
    ("effort always zero", changed("B.u", np.zeros_like), "always zero"),
    ("effort never changes", changed("B.u", lambda u: 0 * u + 2.0), "rig"),
    ("stands still", every("B.q", lambda x: 0 * x + 0.3), "does not move"),
    (
        "trembles",
        changed("B.q", lambda x: 0.3 + 1e-6 * RNG.normal(size=len(x))),
        "does not move",
    ),
]


@pytest.mark.parametrize(("spoil", "warning"), [c[1:] for c in SILENT_B], ids=[c[0] for c in SILENT_B])
def test_what_an_axis_does_not_tell_is_not_determined(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    spoil: Callable[[Channels], Channels],
    warning: str,
) -> None:
    found, said = identified(tmp_path, capfd, spoil)
    assert warning in said
    for name in ("B.viscous.b", "B.coulomb.c"):
        row = found[name]
        assert row["value"] is None
        assert row["standard_error"] is None
        assert row["interval95"] is None
        assert row["determined"] is False
        assert "not determined" in row["verdict"]
    inertia = found["rigid_body.Iyy_jb*"]
    assert inertia["determined"] is False
    # What CAD said, and said so; the other axis tells the sum of the masses, and a body's inertia follows its mass.
    assert inertia["value"] == pytest.approx(inertia["prior"], rel=0.003)
    assert found["rigid_body.m_jx*"]["determined"]


DOUBTFUL: list[tuple[str, Callable[[Channels], Channels], str]] = [
    ("saturated", changed("X.u", lambda u: np.clip(u, -40, 40)), "X.u: saturated at -40"),
    ("degrees as rad", every("B.q", np.rad2deg), "outside the URDF's limits"),
    ("mm as m", every("X.q", lambda x: 1e3 * x), "looks like mm"),
    ("clock jumps back", changed("t", lambda t: t - 3 * (t > 2)), "clock runs backward"),
    ("clock jumps ahead", changed("t", lambda t: t + 3600 * (t > 2)), "a jump of the clock?"),
    ("one infinite value", value("X.q", 700, np.inf), "X.q: 1 values missing, first in row 700"),
    ("one missing stamp", value("t", 700, np.nan), "t: 1 stamps are missing"),
]


@pytest.mark.parametrize(("spoil", "warning"), [c[1:] for c in DOUBTFUL], ids=[c[0] for c in DOUBTFUL])
def test_a_doubtful_log_is_used_and_said_to_be_so(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    spoil: Callable[[Channels], Channels],
    warning: str,
) -> None:
    found, said = identified(tmp_path, capfd, spoil)
    assert found
    assert warning in said
    assert run("check", tmp_path / "rig", tmp_path / "log.csv") in (0, 1)
    assert warning in capfd.readouterr().out


# Saved twins


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("twin")
    log = write_log(folder / "log.csv", good_log())
    out = folder / "out"
    assert run("identify", write_machine(folder / "rig"), log, "--out", out, "--no-loop") == 0
    return out


def copy_of(saved: Path, folder: Path) -> Path:
    folder.mkdir()
    for name in ("twin.json", "machine.yaml", "rig.urdf", "misfit.npz", "covariance.npz"):
        (folder / name).write_bytes((saved / name).read_bytes())
    return folder


def edit(change: Callable[[dict[str, object]], object]) -> Callable[[Path], object]:
    def spoil(folder: Path) -> None:
        path = folder / "twin.json"
        content = json.loads(path.read_text())
        change(content)
        path.write_text(json.dumps(content))

    return spoil


DAMAGE: list[tuple[str, Callable[[Path], object], str]] = [
    ("no twin.json", lambda f: (f / "twin.json").unlink(), "no such file"),
    ("empty", lambda f: (f / "twin.json").write_text(""), "not valid JSON"),
    ("cut off", lambda f: (f / "twin.json").write_text('{"schema": "pinotwin'), "not valid JSON"),
    ("a list", lambda f: (f / "twin.json").write_text("[]"), "schema"),
    ("another schema", edit(lambda c: c.update(schema="pinotwin.twin/99")), "schema"),
    ("no theta", edit(lambda c: c.pop("theta")), "damaged"),
    ("theta too short", edit(lambda c: c["theta"].pop()), "damaged"),
    ("theta in words", edit(lambda c: c.update(theta="many")), "damaged"),
    ("effects of another kind", edit(lambda c: c.update(effects={"a": 1})), "damaged"),
    ("parameters of another kind", edit(lambda c: c.update(parameters=[1, 2])), "damaged"),
    ("an unknown effect", edit(lambda c: c["effects"][1].update(effect="magic")), "damaged"),
]


@pytest.mark.parametrize(("damage", "said"), [c[1:] for c in DAMAGE], ids=[c[0] for c in DAMAGE])
def test_damaged_twin(tmp_path: Path, saved: Path, damage: Callable[[Path], object], said: str) -> None:
    folder = copy_of(saved, tmp_path / "twin")
    Twin.load(folder)
    damage(folder)
    with pytest.raises(TwinError) as caught:
        Twin.load(folder)
    assert said in str(caught.value)
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_failed_run_leaves_an_earlier_twin_untouched(
    tmp_path: Path, saved: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = copy_of(saved, tmp_path / "twin")
    machine = write_machine(tmp_path / "rig")
    log = write_log(tmp_path / "log.csv", without("X.q")(good_log()))
    refused(capfd, folder, ("X.q",), "identify", machine, log, "--out", folder)
    assert (folder / "twin.json").read_bytes() == (saved / "twin.json").read_bytes()


def test_the_output_folder_is_as_open_as_any_other(saved: Path) -> None:
    (saved.parent / "plain").mkdir(exist_ok=True)
    assert saved.stat().st_mode == (saved.parent / "plain").stat().st_mode
