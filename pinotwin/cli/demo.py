"""``pinotwin demo --out out/demo``: from log to twin, a fault, its diagnosis; the real EMPS drive if at hand."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pinotwin.cli.arguments import Answer, Folder
from pinotwin.cli.output import say

FAULT = "record trunnion --command {out}/log.csv --seed 9 --inject viscous:Y=0.5 --out {out}/worn.csv"
REAL = "identify emps {emps} --out {out}/emps_twin"
CHAIN = (
    "record trunnion --seconds 20 --seed 1 --out {out}/log.csv",
    "record trunnion --seconds 10 --seed 2 --out {out}/unseen.csv",
    "check trunnion {out}/log.csv",
    "identify trunnion {out}/log.csv --validate {out}/unseen.csv --out {out}/twin",
    "simulate {out}/twin {out}/unseen.csv --out {out}/predicted.csv",
    FAULT,
    "diagnose {out}/twin {out}/worn.csv --out {out}/found",
)
TOLD = {FAULT: "a fault: more viscous friction on Y; the same command is run again", REAL: "a real drive"}
PAGES = (
    ("twin/report.html", "how well the twin predicts, and every parameter"),
    ("found/machine.html", "the machine playing the worn log"),
    ("found/report.html", "the diagnosis"),
)


def run(*, out: Folder = "out/demo") -> Answer:
    """Run the commands of the chain one after the other, showing each as a user would type it.

    Args:
        out (PATH): folder for what the demo writes (out/demo)
    """
    from pinotwin.cli.main import main

    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    done: list[dict[str, Any]] = []
    with _compiling():
        for told, words in _commands(folder):
            say("")
            if told:
                say(f"# {told}")
            say(f"$ pinotwin {' '.join(words)}")
            code = main(words)
            done.append({"command": ["pinotwin", *words], "exit_code": code})
            if code != 0:
                return Answer([], {"commands": done}, code)
    pages = [f"  {folder / name}  {told}" for name, told in PAGES]
    return Answer(["", "open in a browser:", *pages], {"commands": done})


def _commands(out: Path) -> list[tuple[str, list[str]]]:
    """Return what each step shows, if it needs a word, and the command; the diagnosis last."""
    emps = Path(os.environ.get("PINOTWIN_DATA", "../shared/data")) / "emps" / "DATA_EMPS.mat"
    chain = list(CHAIN)
    if emps.is_file():
        chain.insert(5, REAL)
    else:
        say("the real EMPS log is not at hand; set PINOTWIN_DATA to its folder to see it identified")
    return [(TOLD.get(step, ""), [x.format(out=out, emps=emps) for x in step.split()]) for step in chain]


@contextmanager
def _compiling() -> Iterator[None]:
    """Compile on another core meanwhile what `identify` needs only once the plant is fitted."""
    helper = multiprocessing.get_context("spawn").Process(target=compile_steppers, daemon=True)
    helper.start()
    try:
        yield
    finally:
        helper.kill()
        helper.join()


def compile_steppers() -> None:
    """Compile what closed loops are stepped with, on a machine at rest: half a minute, once; numba keeps it."""
    from dataclasses import replace

    import numpy as np

    from pinotwin.dynamics.parameters import parameters
    from pinotwin.errors import PinotwinError
    from pinotwin.log import Log
    from pinotwin.loop import Servo, close
    from pinotwin.machine import Machine
    from pinotwin.twin import Parameters, Twin

    machine = Machine.load("trunnion")
    for name in machine.axes:
        machine = machine.with_effects(name, ())
    pi, ones = parameters(machine.model), np.ones(machine.nv)
    theta = machine.base.from_standard(pi)
    diagonal = {"inertia": ones, "viscous": ones, "stiffness": 0.0 * ones}
    twin = Twin(machine, machine.effects, theta, np.diag(0.0 * theta), Parameters(), pi, diagonal=diagonal)
    log = Log({"t": np.linspace(0.0, 0.02, 21), **{f"{name}.qr": np.zeros(21) for name in machine.axes}})
    law = Servo((1e4, 1e4, 1e3, 0.0, 0.0, 0.0))
    loops = dict.fromkeys(machine.axes, close(law, 1.0, 1.0))
    closed = replace(twin, loops=loops, servos=dict.fromkeys(machine.axes, law))
    for form in ("black", "coupled"):
        with contextlib.suppress(PinotwinError):  # compiled all the same
            closed.simulate(log, controller=form)
