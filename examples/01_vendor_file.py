"""01: from a drive's export to a machine, two calls and no edit of the file.

Run: .venv/bin/python examples/01_vendor_file.py. The export is written here in the look of a CNC's scope: latin-1,
semicolons, decimal commas, lines above the header, a row of units, currents instead of forces.

You see what was read above the numbers, each column with the reason why it was taken for what it is, the
open question (the torque constant), and `check: ok`.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import pinotwin as pt
from pinotwin.virtual import VirtualMachine, random_trajectory


def export(path: Path, log: pt.Log) -> None:
    """Write position and current of the slide X as a scope would."""
    head = [
        "Scope;Aufzeichnung",
        "Datum;22.11.2026;14:03:12",
        "Kommentar;Führung geölt",
        "",
        "Zeit;s soll X;s ist X;I X",
    ]
    table = np.column_stack([1e3 * log.t, 1e3 * log["X.qr"], 1e3 * log["X.q"], log["X.u"] / 35.15])
    rows = [";".join(f"{x:.6f}" for x in row).replace(".", ",") for row in table]
    path.write_bytes("\r\n".join([*head, *rows, ""]).encode("latin-1"))


def main(seconds: float = 10.0) -> dict[str, str]:
    """Return channel -> column as guessed."""
    virtual = VirtualMachine.load(pt.machines()["emps"])
    recorded = virtual.record(random_trajectory(virtual, seconds, 1), seed=1).to_log()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trace.csv"
        export(path, recorded)
        log = pt.read(path)
        start = pt.new("X", log, out=Path(folder) / "slide")
        checked = pt.check(start.machine, log)
    for note in log.notes:
        print("log:", note)
    for guess in start.guesses.found:
        print(f"guess: {guess.channel} = {guess.column}: {guess.reason}")
    for question in start.guesses.open:
        print("open:", question)
    print("check:", "ok" if checked.ok else "not ok")
    return {guess.channel: guess.column for guess in start.guesses.found}


if __name__ == "__main__":
    main()
