"""Entry point ``pinotwin``: parse, run the command, turn a known error into one line and exit code 2.

A command is a module of this package, imported when called: its docstring begins with an example, its ``run`` has the
arguments (:mod:`.arguments`).
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import os
import re
import signal
import sys
import threading
from collections.abc import Sequence
from contextlib import nullcontext
from textwrap import fill
from typing import Any

from pinotwin import __version__
from pinotwin.cli.arguments import Command, add_arguments, check_outputs
from pinotwin.cli.output import say
from pinotwin.errors import PinotwinError, nearest
from pinotwin.system.writing import write_json

COMMANDS: dict[str, str] = {  # command -> what it does
    "new": "start a machine folder from axes, a URDF or a name; guess the columns of a log",
    "check": "what is wrong with a machine or a log, and what the log can identify",
    "identify": "find the machine's model in its logs and save it as a twin",
    "improve": "identify, add the effects that the model lacks, identify again, while a sealed log confirms it",
    "update": "add healthy logs to a twin, without the logs that it was made of",
    "simulate": "predict position, tracking error and effort from the command alone",
    "diagnose": "find where a log and its model differ, which effect is missing, and how far the residual falls",
    "force": "estimate the external effort on every axis over time, with its interval",
    "study": "how much data, which coupling, which effect matters: the source's studies",
    "compare": "put twins or diagnoses side by side: what moved, how well each predicts",
    "blind": "score the diagnosis on machines whose effect is withheld",
    "vibration": "reconstruct the vibration of a passive joint from servo and IMU logs",
    "orientation": "find the orientation of an IMU over time from its log alone",
    "record": "record field data from a virtual machine",
    "view": "show a machine in the browser, or as one self-contained page",
    "export": "write a twin for other tools: URDF, MuJoCo, NumPy or C",
    "demo": "the whole chain on a bundled machine, and on the real EMPS drive if it is at hand",
}


def _help(prog: str) -> argparse.HelpFormatter:
    return argparse.RawDescriptionHelpFormatter(prog, max_help_position=26, width=80)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> None:  # type: ignore[override]
        self.exit(2, f"{self.prog}: {message}; see `{self.prog} --help`\n")


class _Completion(argparse.Action):
    """Print the script by which a shell completes commands, options and file names."""

    def __call__(
        self, parser: argparse.ArgumentParser, _args: object, shell: object, _name: object = ""
    ) -> None:
        import shtab

        whole = _parser(tuple(COMMANDS))
        (commands,) = (a for a in whole._actions if isinstance(a, argparse._SubParsersAction))
        for command in commands.choices.values():
            for action in command._actions:
                if action.nargs != 0 and action.type is None and action.choices is None:
                    action.complete = shtab.FILE
        sys.stdout.write(shtab.complete(whole, str(shell)))
        parser.exit()


def _parser(commands: Sequence[str]) -> argparse.ArgumentParser:
    parser = _Parser(
        prog="pinotwin",
        description="From a URDF and a log to a model that says where reality differs, and why.",
        epilog="Each command has its own help with an example: pinotwin identify --help",
        formatter_class=_help,
    )
    parser.add_argument("--version", action="version", version=f"pinotwin {__version__}")
    shells = ("bash", "zsh", "tcsh", "fish")
    text = "print the script for a shell's completion and exit"
    parser.add_argument(
        "--print-completion",
        choices=shells,
        action=_Completion,
        metavar="SHELL",
        help=text,
        default=argparse.SUPPRESS,
    )
    sub = parser.add_subparsers(dest="verb", metavar="COMMAND", required=True, title="commands")
    for name, text in COMMANDS.items():
        command = sub.add_parser(
            name,
            help=text,
            description=fill(text[0].upper() + text[1:] + ".", 80),
            formatter_class=_help,
        )
        if name in commands:
            run = command_of(name)
            example = re.search("``(.*?)``", sys.modules[run.__module__].__doc__ or "")
            command.epilog = example and f"example:\n  {example[1]}"
            add_arguments(command, run)
    return parser


def command_of(name: str) -> Command:
    """Return the function of a command."""
    found: Command = importlib.import_module(f"pinotwin.cli.{name}").run
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command (``argv``, or the process' words) and return 0, 1 for a failed check, 2 for bad input."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its own threads slow small problems
    _end_in_order()
    words = list(sys.argv[1:] if argv is None else argv)
    if not words:
        _parser(()).print_help()
        return 0
    named = [w for w in words[:1] if w in COMMANDS]
    if not named and not words[0].startswith("-"):
        return _complain(f"no command {words[0]!r}; {nearest(words[0], COMMANDS)}; see --help")
    try:
        code = _run(vars(_parser(named).parse_args(words)))
        sys.stdout.flush()  # a reader that has gone is noticed here, not at exit
        return code
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return 0
    except KeyboardInterrupt:
        sys.stderr.write("pinotwin: stopped\n")
        return 130
    except PinotwinError as error:
        return _complain(str(error))
    except OSError as error:
        if error.strerror is None:
            raise
        return _complain(f"{error.filename or 'the system says'}: {error.strerror}")


def _end_in_order() -> None:
    """Let a polite kill (SIGTERM) end the work as Ctrl-C does: half-made files are removed."""
    inside = threading.current_thread() is not threading.main_thread()  # signals are the main thread's
    if not inside and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, signal.default_int_handler)


def _run(values: dict[str, Any]) -> int:
    """Call a command with its arguments, write what ``--json`` names, say the answer and return its exit code."""
    command = command_of(values.pop("verb"))
    check_outputs(values, values.pop("written"))
    file, effects = values.pop("json"), values.get("effects", ())
    if "effects" not in inspect.signature(command).parameters:
        values.pop("effects", None)
    own = importlib.import_module("pinotwin.effects.known") if effects else None
    with own.given_files(effects) if own else nullcontext():
        answer = command(**values)
        if file:
            write_json(file, answer.content)
        for line in answer.lines:
            say(line)
    return answer.code


def _complain(text: str) -> int:
    sys.stderr.write(f"pinotwin: {' '.join(text.split())}\n")
    return 2


if __name__ == "__main__":
    sys.exit(main())
