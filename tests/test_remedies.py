"""Advice can be followed: every option, command, key and effect that a message names exists.

The messages are read from the source: every text of the package that is no docstring. What stands in it as
``--option``, ```pinotwin command```, ```key: value```, ``pt.name`` or "effect `name`" is looked up where it must exist.
"""

from __future__ import annotations

import argparse
import ast
import dataclasses
import functools
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

import pinotwin as pt
from pinotwin.cli.arguments import add_arguments
from pinotwin.cli.main import COMMANDS, command_of
from pinotwin.columns import AXIS_SIGNALS, Column
from pinotwin.effects import EFFECTS, LISTED
from pinotwin.log import Log
from pinotwin.logs.check import check
from pinotwin.machine.parts import Axis, DataSettings, Imu, LoopShape, MachineFile, Passive
from pinotwin.system.reading import kinds_of
from tests.rig import YAML, good_log, write_machine

PACKAGE = Path(pt.__file__).parent
OTHERS = ("pip", "mcap", "ros2", "xacro", "npm", "apt")  # commands of other programs
PAGES = ("viewer/",)  # CSS has --names of its own


def messages() -> Iterator[tuple[str, str, frozenset[str]]]:
    """Yield file, text with {} for values, and the names of arguments in that module."""
    for path in sorted(PACKAGE.rglob("*.py")):
        where = path.relative_to(PACKAGE).as_posix()
        if where.startswith(PAGES):
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        arguments = frozenset(n.arg for n in ast.walk(tree) if isinstance(n, ast.arg))
        silent = {id(part) for n in ast.walk(tree) for part in _silent(n)}
        for node in ast.walk(tree):
            if id(node) not in silent and (text := _text(node)) is not None:
                yield where, _of_template(text) if where.endswith("phrases.py") else text, arguments


def _silent(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the docstrings below a node, and the parts of a text that is yielded whole."""
    for statement in getattr(node, "body", None) if isinstance(getattr(node, "body", None), list) else ():
        if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
            yield statement.value
    if isinstance(node, ast.JoinedStr):
        yield from node.values


def _text(node: ast.AST) -> str | None:
    if isinstance(node, ast.JoinedStr):
        return "".join(str(v.value) if isinstance(v, ast.Constant) else "{}" for v in node.values)
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def _of_template(text: str) -> str:
    """Return a text for ``str.format`` as messages are written here: {} for values, single braces."""
    return re.sub(r"(?<!\{)\{\w+(:[^{}]*)?\}(?!\})", "{}", text).replace("{{", "{").replace("}}", "}")


@functools.cache
def options(command: str) -> frozenset[str]:
    parser = argparse.ArgumentParser()
    add_arguments(parser, command_of(command))
    return frozenset(text for action in parser._actions for text in action.option_strings)


@functools.cache
def keys() -> frozenset[str]:
    """Return every key that machine.yaml may hold."""
    out = {*kinds_of(MachineFile), *kinds_of(Axis), *LISTED}
    for kind in (Column, DataSettings, Imu, LoopShape, Passive, *EFFECTS.values()):
        out |= {f.metadata.get("yaml", f.name) for f in dataclasses.fields(kind)}
    return frozenset(out)


def wrong(where: str, text: str, arguments: frozenset[str] = frozenset()) -> list[str]:
    """Return what a text tells its reader to use that does not exist."""
    out = []
    every = frozenset().union(*(options(c) for c in COMMANDS)) | {"--help", "--version", "--print-completion"}
    own = where.removeprefix("cli/").removesuffix(".py")
    rest = text
    for quoted in re.findall(r"(?<!`)`([^`\n]+)`(?!`)", text):
        words = quoted.split()
        rest = rest.replace(quoted, "")
        if words[0] in OTHERS:
            continue
        if words[0] == "pinotwin":
            out += _wrong_command(words[1:])
        elif words[0].startswith("--"):
            out += [f"{words[0]}: no such option"] if words[0] not in every else []
        elif ":" in quoted:
            out += _wrong_yaml(quoted)
        elif re.fullmatch(r"[a-z_]+", quoted):
            known = quoted in keys() or quoted in arguments or quoted in COMMANDS or hasattr(pt, quoted)
            out += [] if known else [f"`{quoted}`: no key, effect, command or argument"]
    return out + _wrong_words(own, text, rest, every)


def _wrong_words(own: str, text: str, rest: str, every: frozenset[str]) -> list[str]:
    out = []
    for option in re.findall(r"(?<![\w(-])--[a-z][a-z-]*", rest):
        there = options(own) if own in COMMANDS and own != "demo" else every  # demo calls the others
        out += [] if option in there | {"--help"} else [f"{option}: no option of {own}"]
    for name in re.findall(r"\beffects? `?([a-z_]+)`", text):
        out += [] if name in LISTED or name in ("tau",) else [f"effect {name}: machine.yaml cannot list it"]
    for name in re.findall(r"\bpt\.([a-z_]+)\b", text):
        out += [] if hasattr(pt, name) else [f"pt.{name}: does not exist"]
    for section, key in re.findall(r"\b(columns|axes|passive|imus|loop|data)\.\{\}\.([a-z_]+)", text):
        out += [] if key in keys() or key in AXIS_SIGNALS else [f"{section}.{{}}.{key}: no such key"]
    return out


def _wrong_command(words: list[str]) -> list[str]:
    if not words or words[0] in ("{}", "COMMAND"):
        return []
    if words[0] not in COMMANDS:
        return [f"pinotwin {words[0]}: no such command"]
    given = [w.partition("=")[0] for w in words if w.startswith("--")]
    return [f"pinotwin {words[0]} {w}: no such option" for w in given if w not in options(words[0])]


def _wrong_yaml(text: str) -> list[str]:
    filled = re.sub(r"\{\}|\.\.\.|<[^>]*>", "X1", text)
    try:
        content = yaml.safe_load(filled)
    except yaml.YAMLError:
        return [f"`{text}`: is no YAML"]
    found = []
    waiting = [content]
    while waiting:
        one = waiting.pop()
        if isinstance(one, dict):
            found += [str(k) for k in one]
            waiting += one.values()
        elif isinstance(one, list):
            waiting += one
    names = re.compile(r"X1|[A-Z]\w*|imu\d|t|.*\..*")  # of axes, joints and channels: the user's own
    return [f"`{text}`: no key {k!r}" for k in found if k not in keys() and not names.fullmatch(k)]


def test_what_messages_name_exists() -> None:
    found = [f"{where}: {text!r}: {w}" for where, text, args in messages() for w in wrong(where, text, args)]
    assert found == []


def test_the_net_has_no_holes() -> None:
    texts = [text for _, text, _ in messages()]
    assert sum("--" in text for text in texts) > 60
    assert sum("`" in text for text in texts) > 25
    for text in (
        "add the effect `play`",
        "give `loop: {A: {poles: 3}}`",
        "see `pinotwin diagnos`",
        "`pinotwin identify --resmple 5`",
        "lower `minimum_speed`",
        "use pt.resampled",
        "--imu-lnk: not there",
        "give axes.{}.leed",
        "write `data: {leave: [1, 2]}`",
    ):
        assert wrong("logs/check.py", text), text
    for text in (
        "add the effect `delay`",
        "give `loop: {A: {real_poles: 3}}`",
        "`pinotwin identify --resample 5`",
        "lower `min_speed`",
        "start one with `mcap recover --port 1`",
        "give columns.{}.factor",
    ):
        assert wrong("logs/check.py", text) == [], text
    assert wrong("cli/record.py", "--imu-link: unknown") == []
    assert wrong("cli/check.py", "--imu-link: unknown")


def noted(channels: dict[str, np.ndarray], text: str, folder: Path) -> dict[str, str]:
    """Return code -> message of what `check` warns of in a log on a machine whose YAML holds a text, too."""
    if not (folder / "rig").exists():
        write_machine(folder / "rig")
    axis, _, key = text.partition("axes: ")
    (folder / "rig" / "machine.yaml").write_text(YAML.replace("{joint: jx}", key) if key else YAML + axis)
    found = check(pt.Machine.load(folder / "rig"), Log(channels, "x.csv")).findings
    return {f.code: str(f) for f in found if f.severity != "info"}


def reversed_effort(log: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {**log, "X.u": -log["X.u"]}


def in_degrees(log: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {**log, "B.q": np.rad2deg(log["B.q"]), "B.qr": np.rad2deg(log["B.qr"])}


def with_sentinels(log: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    u = log["X.u"].copy()
    u[700:712] = -9999.0
    return {**log, "X.u": u}


def exchanged(log: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {**log, "X.u": log["B.u"], "B.u": log["X.u"]}


def early(log: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {k: x[: len(x) - 3] if k != "X.u" else x[3:] for k, x in log.items()}


def in_milliseconds(log: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {**log, "t": 1e3 * log["t"]}


FOLLOWED = {
    "reversed effort": (reversed_effort, "columns: {X.u: {column: X.u, factor: -1.0}}\n"),
    "degrees": (in_degrees, "columns: {B.q: {column: B.q, unit: deg}, B.qr: {column: B.qr, unit: deg}}\n"),
    "sentinels": (with_sentinels, "as the message says"),
    "exchanged efforts": (exchanged, "columns: {X.u: {column: B.u}, B.u: {column: X.u}}\n"),
    "early effort": (early, "axes: {joint: jx, lead: 6.0 ms}"),
    "milliseconds": (in_milliseconds, "columns: {t: {column: t, unit: ms}}\n"),
}


@pytest.mark.parametrize("what", FOLLOWED)
def test_what_is_advised_ends_the_finding(what: str, tmp_path: Path) -> None:
    spoil, remedy = FOLLOWED[what]
    healthy = noted(good_log(), "", tmp_path)
    log = spoil(good_log())
    before = noted(log, "", tmp_path)
    new = {code: text for code, text in before.items() if code not in healthy}
    assert new
    said = re.search(r"\((data: .*)\)", " ".join(new.values()))
    if said:  # the message holds the very key: it is taken as it stands
        remedy = said[1]
    after = noted(log, remedy, tmp_path)
    expected = {"clock_gaps"} if said else set()  # rows that are left out leave a gap
    assert set(after) - set(healthy) == expected
