"""``pinotwin force TWIN LOG --out FORCE.csv``."""

from __future__ import annotations

import argparse
from pathlib import Path

from pinotwin.cli.inputs import add_effects
from pinotwin.cli.output import add_common, columns, say, write_json


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("twin", help="folder that `pinotwin identify` wrote")
    parser.add_argument("log", metavar="LOG", help="servo log of the same machine")
    parser.add_argument("--link", metavar="NAME", help="also the pure force on this link, in its axes")
    add_effects(parser)
    add_common(parser, out="external effort over time to write (.csv)", required=True, file=True)


def run(args: argparse.Namespace) -> int:
    """Estimate, write, and say how often each axis is pushed beyond what its twin leaves anyway."""
    from pinotwin.analysis.force import external_effort, link_force
    from pinotwin.cli.inputs import read_logs
    from pinotwin.errors import InputError
    from pinotwin.logs.write import write_log
    from pinotwin.twin import Twin

    out = Path(args.out)
    if out.suffix != ".csv":
        raise InputError(f"--out: {out.name}: the external effort is written as .csv")
    twin = Twin.load(args.twin)
    (log,) = read_logs([args.log])
    found = external_effort(twin, log)
    at_link = None if args.link is None else link_force(twin.machine, found, args.link)
    write_log(out, {**found.channels(), **({} if at_link is None else at_link.channels())})
    rows = {}
    told = []
    for k, (name, share) in enumerate(zip(found.names, found.beyond(), strict=True)):
        unit = "N·m" if twin.machine.axis(name).rotary else "N"
        largest = float(abs(found.force[:, k]).max())
        half = float(found.half[:, k].mean())
        rows[name] = {"largest": largest, "half_width90": half, "share_beyond": float(share), "unit": unit}
        told.append([name, f"{largest:.4g} {unit}", f"± {half:.3g} {unit}", f"{share:.0%}"])
    for line in columns(("axis", "largest", "90 % interval", "beyond it"), told):
        say(line)
    felt = {} if at_link is None else dict(zip("xyz", at_link.felt().tolist(), strict=True))
    for direction, share in felt.items():
        how = "not felt by the axes" if share == 0.0 else f"determined for {share:.0%} of the time"
        say(f"{args.link}.f{direction}: {how}")
    if args.json:
        content = {"machine": twin.machine.name, "log": log.source, "axes": rows}
        write_json(args.json, {**content, **({"link": {args.link: felt}} if felt else {})})
    say(f"external effort written to {out}; beyond it: share of the time, 10 % without any force")
    return 0
