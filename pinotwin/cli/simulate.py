"""``pinotwin simulate TWIN LOG --out PRED.csv``."""

from __future__ import annotations

import argparse
import io
from pathlib import Path

from pinotwin.cli.output import add_common, say, write_json
from pinotwin.writing import write_text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("twin", help="folder that `pinotwin identify` wrote")
    parser.add_argument("log", metavar="LOG", help="log; only t, *.qr and external loads are used")
    parser.add_argument(
        "--controller",
        choices=("coupled", "black", "grey", "vibration"),
        help="identified controllers around the identified plant (coupled), identified transfer functions "
        "(black), those with the vibration of a passive joint as output, or sampled laws (grey); "
        "without it, the form that predicted held-out data best",
    )
    parser.add_argument("--step", type=float, metavar="S", help="longest internal step")
    add_common(parser, out="prediction to write (.csv)", required=True, file=True)


def run(args: argparse.Namespace) -> int:
    """Simulate, write, and compare with the log where it was measured."""
    from pinotwin.cli.inputs import read_logs
    from pinotwin.errors import InputError
    from pinotwin.simulation import compare, preferred, simulate
    from pinotwin.twin import Twin

    out = Path(args.out)
    if out.suffix != ".csv":
        raise InputError(f"--out: {out.name}: a prediction is written as .csv")
    twin = Twin.load(args.twin)
    (log,) = read_logs([args.log])
    form = args.controller or preferred(twin)
    predicted = simulate(twin, log, step=args.step, controller=form)
    rows = compare(twin.machine, log, predicted)
    write_text(out, _csv(predicted))
    if args.json:
        write_json(
            args.json,
            {
                "machine": twin.machine.name,
                "log": log.source,
                "controller": form,
                "rows": len(predicted),
                "seconds": float(predicted.t[-1] - predicted.t[0]),
                "axes": rows,
                "notes": list(predicted.notes),
            },
        )
    for line in summary(rows):
        say(line)
    for note in predicted.notes:
        say(f"note: {note}")
    say(f"closed loop: {form}")
    say(f"{len(predicted)} rows written to {out}")
    return 0


def summary(rows) -> list[str]:  # type: ignore[no-untyped-def]
    """Return the table of errors, none where nothing was measured."""
    if not rows:
        return []
    head = f"{'axis':<8}{'e':>9}{'u':>9}{'u of std':>10}{'e moving':>10}{'u moving':>10}{'u at rest':>11}"
    lines = [f"{head}   (RMS error / RMS measured)"]
    for name, row in rows.items():
        cells = [
            row.get("e", {}).get("nrmse"),
            row.get("u", {}).get("nrmse"),
            row.get("u", {}).get("nrmse_std"),
            row.get("e", {}).get("moving"),
            row.get("u", {}).get("moving"),
            row.get("u", {}).get("resting"),
        ]
        texts = ["-" if x is None or x != x else f"{x:.2%}" for x in cells]
        widths = (9, 9, 10, 10, 10, 11)
        lines.append(f"{name:<8}" + "".join(f"{x:>{w}}" for x, w in zip(texts, widths, strict=True)))
    return lines


def _csv(log) -> str:  # type: ignore[no-untyped-def]
    import numpy as np

    text = io.StringIO()
    table = np.column_stack([log[name] for name in log.channels])
    np.savetxt(text, table, fmt="%.12g", delimiter=",", header=",".join(log.channels), comments="")
    return text.getvalue()
