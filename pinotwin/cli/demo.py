"""``pinotwin demo``: the whole chain on a bundled machine; also on the real EMPS drive if at hand."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from pinotwin.cli.output import add_common, say, write_json

CHAIN = (
    ("record", "trunnion", "--seconds", "24", "--seed", "1", "--out", "{out}/log.csv"),
    ("record", "trunnion", "--seconds", "12", "--seed", "2", "--out", "{out}/unseen.csv"),
    ("check", "trunnion", "{out}/log.csv"),
    (
        "identify",
        "trunnion",
        "{out}/log.csv",
        "--validate",
        "{out}/unseen.csv",
        "--out",
        "{out}/twin",
    ),
    ("simulate", "{out}/twin", "{out}/unseen.csv", "--out", "{out}/predicted.csv"),
    ("view", "{out}/twin", "{out}/log.csv", "--html", "{out}/machine.html"),
)
REAL = ("identify", "emps", "{emps}", "--out", "{out}/emps_twin")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_common(parser, out="folder for what the demo writes (out/demo)")


def run(args: argparse.Namespace) -> int:
    """Run the commands of the chain one after the other, showing each as a user would type it."""
    from pinotwin.cli.main import main

    out = Path(args.out or "out/demo")
    out.mkdir(parents=True, exist_ok=True)
    done: list[dict[str, Any]] = []
    for words in _commands(out):
        say(f"\n$ pinotwin {' '.join(words)}")
        code = main(words)
        done.append({"command": ["pinotwin", *words], "exit_code": code})
        if code != 0:
            break
    if args.json:
        write_json(args.json, {"commands": done})
    if done[-1]["exit_code"] == 0:
        say(f"\nopen {out / 'twin' / 'report.html'} and {out / 'machine.html'} in a browser")
    return int(done[-1]["exit_code"])


def _commands(out: Path) -> list[list[str]]:
    chain = [[word.format(out=out) for word in words] for words in CHAIN]
    emps = data_folder() / "emps" / "DATA_EMPS.mat"
    if emps.is_file():
        chain.append([word.format(out=out, emps=emps) for word in REAL])
    else:
        say("the real EMPS log is not at hand; set PINOTWIN_DATA to its folder to see it identified")
    return chain


def data_folder() -> Path:
    """Return the folder of the real recordings: $PINOTWIN_DATA, or ../shared/data."""
    return Path(os.environ.get("PINOTWIN_DATA", "../shared/data"))
