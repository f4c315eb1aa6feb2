"""Imitations of public bug reports, the cases ``public`` beside the recordings: is their README's answer given?

Each README holds the commands and, in words, the right answer; the table below says the same in names, numbers and
words. It was written from the READMEs, and a name that sends one to another part of the machine is never right.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.evidence import asking
from benchmarks.evidence.answers import Answers, Row, Runs

NEAR, SOON = 0.2, 0.7
"""A number is right within this share [1], an instant within this time [s]: nothing in the READMEs says how near."""
OPEN = ("unexplained", "partly_explained")


@dataclass(frozen=True)
class Right:
    """What a README calls right.

    Attributes:
        effects: all that may be named, one of which must be; none may be where it is empty.
        axis: of all of them.
        numbers: size of the first one [SI], in each of the ways to state it; any where it is empty.
        since: when it begins [s].
        said: pattern of what must be printed or written, whatever its case.
        faults: of the recording, one of which must be told.
        verdicts: that are right; any where it is empty.
        in_words: whether no name is needed where the words are there.
    """

    effects: tuple[str, ...] = ()
    axis: str = ""
    numbers: tuple[float, ...] = ()
    since: float | None = None
    said: str = ""
    faults: tuple[str, ...] = ()
    verdicts: tuple[str, ...] = ()
    in_words: bool = False


RIGHT = {
    "belt_jumps_a_tooth": Right(("encoder_step", "tooth_jump", "slip"), "X", (3e-3,), 4.3),
    "brake_releases_late": Right(
        ("coulomb", "friction_at_start", "brake"), "X", (130.0,), said=r"after.starts?\b|releases late"
    ),
    "calf_gear_ratio": Right(("effort_scale",), "calf", (0.522, 1.0 - 0.522)),
    "command_jitters": Right(faults=("command_jitter", "command_rough", "clock_jitter")),
    "corexy_idler_drags": Right(("coulomb", "motor_coulomb"), "X", (2.0,), said=r"at.the.motor|idler"),
    "current_limit_folds_back": Right(("saturation",), "X", (115.0,), 5.5),
    "cylinder_force_for_torque": Right(
        ("lever",), "boom", said=r"lever|cylinder|not a torque", in_words=True
    ),
    "decimal_and_field_comma": Right(said=r"comma|^axes:"),
    "gas_spring_lost_40_percent": Right(said=r"J2 (is not|cannot be) judged", verdicts=OPEN),
    "gas_spring_lost_40_percent, with a table": Right(("position_table", "counterbalance"), "J2"),
    "healthy_gain_accused": Right(verdicts=("none",)),
    "hobby_servo_dead_band": Right(("dead_band",), "J1", (0.0175,)),
    "joint_slips": Right(("zero", "zero_slip", "slip", "encoder_step"), "J2", (0.07,), 5.5),
    "joint_zero_off": Right(("zero", "encoder_zero"), "J2", (0.0873,)),
    "position_is_the_command": Right(said=r"no closed loop|without a closed loop|no loop"),
    "pulley_coupling_not_declared": Right(
        ("transmission",), said=r"transmission.*1\.(4[5-9]|5)", in_words=True
    ),
    "rows_doubled_with_command": Right(said=r"held for 2 rows|every second row|for two rows"),
    "rtde_target_current": Right(said=r"\.u\b.*actual_current"),
    "screw_grows": Right(("encoder_scale", "screw_growth"), "X", (80e-6,)),
    "stepper_loses_steps": Right(
        ("lost_steps", "encoder_step"), "X", said=r"steps? (were |are )?lost|lost steps?", in_words=True
    ),
    "torque_constant_falls_while_hot": Right(("effort_scale",), "X", (0.12, 0.136), said=r"\bgrow(s|ing)\b"),
    "two_columns_of_one_name": Right(said=r"\.qr\b.*q_d(.|\n)*tau_J|tau_J(.|\n)*\.qr\b.*q_d"),
    "unused_channels_of_one_name": Right(said=r"no (column found for the )?position|only a speed"),
    "worm_periodic_error": Right(
        ("encoder_error",), "RA", (12.0 / 206265.0, 16.0 / 206265.0), said=r"\b2(\.0+)? ?(°|deg)"
    ),
}
"""Case -> its README's right answer. A case that asks two questions has two lines, and is right with both."""
TABLE, WITH = ", with a table", "-with-table"
"""Ends the name of a second question, and of its folder."""


def public(runs: Runs) -> Answers:
    """Ask every case as its README says."""
    folder = runs.cases / "public"
    if not folder.is_dir():
        print(f"{folder} is not at hand: public cases are not asked")
        return Answers([], "")
    rows = asking.kept(runs.out, "public", RIGHT, lambda name: _asked(folder, runs.out / "public", name))
    cases = judged(rows)
    print(f"not as their READMEs say: {', '.join(x['case'] for x in cases if not x['right']) or 'none'}")
    return Answers(cases, "the commands of ../shared/cases/public")


def judged(rows: Sequence[Row]) -> list[Row]:
    """Return a row for each case: right if all of its questions are, passed over if one that is wrong is."""
    cases: dict[str, list[Row]] = {}
    for row in rows:
        wanted, answer = RIGHT[row["question"]], _read(Path(row["folder"]))
        told = {**row, "right": right(wanted, *answer), "first": first(wanted, *answer)}
        cases.setdefault(row["question"].removesuffix(TABLE), []).append(told)
    return [_case(name, asked) for name, asked in cases.items()]


def _case(name: str, rows: Sequence[Row]) -> Row:
    """Return how the questions of a case were answered together."""
    passed = any(not row["right"] and row["verdict"] in ("none", "explained") for row in rows)
    every = {key: all(row[key] for row in rows) for key in ("right", "first")}
    return {"case": name, **every, "passed_over": passed}


def _read(folder: Path) -> tuple[Row, str]:
    """Return the diagnosis of a question's folder, empty where there is none, and what was printed but for its name."""
    file = folder / "found" / "diagnosis.json"
    document: Row = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    said = (folder / "said.txt").read_text(encoding="utf-8")
    return document, said.replace(folder.name, "").replace(folder.name.removesuffix(WITH), "")


def commands(readme: str) -> list[list[str]]:
    """Return the commands of a README as words; what stands in brackets behind them is none."""
    line = readme.partition("command:")[2].partition("\n")[0].partition("   (")[0]
    return [one.split()[1:] for one in re.split(r"&&|;", line)]


def _asked(folder: Path, out: Path, name: str) -> Row:
    """Put the commands of one README, in a folder of ours that shows its files."""
    case = folder / name.removesuffix(TABLE)
    at = out / name.replace(TABLE, WITH)
    shutil.rmtree(at, ignore_errors=True)
    at.mkdir(parents=True)
    for file in case.iterdir():
        (at / file.name).symlink_to(file)
    text, failed = "", False
    for words in commands((case / "README").read_text(encoding="utf-8")):
        words = ["machine_with_table" if TABLE in name and x == "machine" else x for x in words]
        said = asking.pinotwin(*words, at=at)
        text += f"$ pinotwin {' '.join(words)}\n{said.text}"
        failed |= said.code != 0
    text += "".join(f.read_text(encoding="utf-8") for f in at.glob("m/machine.yaml"))
    (at / "said.txt").write_text(text, encoding="utf-8")
    document, _ = _read(at)
    named = [[e["effect"], e["axis"], e["confidence"]] for e in document.get("effects", [])]
    faults = [[x["fault"], x["axis"]] for x in document.get("recording", [])]
    verdict = document.get("verdict", "failed" if failed else "-")
    return {"verdict": verdict, "named": named, "recording": faults, "folder": str(at)}


def first(wanted: Right, document: Row, text: str) -> bool:
    """Return whether the first name and its axis are right, whatever its numbers and the names behind it."""
    alone = {**document, "effects": document.get("effects", [])[:1]} if document else {}
    return right(replace(wanted, numbers=(), since=None), alone, text)


def right(wanted: Right, document: Row, text: str) -> bool:
    """Return whether a diagnosis, empty where none was asked, and what was printed are what a README calls right."""
    effects = document.get("effects", [])
    faults = {x["fault"] for x in document.get("recording", [])}
    said = re.search(wanted.said, text + json.dumps(effects), re.I | re.M)
    return (
        "Traceback" not in text
        and all((e["effect"], e["axis"]) in {(x, wanted.axis) for x in wanted.effects} for e in effects)
        and (bool(effects) or not wanted.effects or wanted.in_words)
        and (not effects or _near(effects[0], wanted.numbers))
        and (wanted.since is None or any(abs(t - wanted.since) < SOON for t in _begins(document)))
        and (not wanted.faults or bool(faults & set(wanted.faults)))
        and (not wanted.said or said is not None)
        and (not wanted.verdicts or document.get("verdict") in wanted.verdicts)
    )


def _near(effect: Row, numbers: Sequence[float]) -> bool:
    """Return whether a number of an effect, or its change, is one of these [SI], whatever its sign; none is any."""
    size = effect.get("size", {})
    before, after = size.get("before"), size.get("after")
    change = [] if None in (before, after) else [after - before]
    told = [after, *change, *effect.get("theta", {}).values()]
    sizes = [abs(x) for x in told if isinstance(x, int | float)]
    return not numbers or any(abs(x - y) <= NEAR * y for x in sizes for y in numbers)


def _begins(document: Row) -> list[float]:
    """Return the instants at which a diagnosis says that something begins [s]."""
    spans = [w["range"][0] for w in document.get("where", []) if w["kind"] == "time"]
    return spans + [e["course"]["from"] for e in document.get("effects", []) if "from" in e.get("course", {})]
