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
    from pinotwin.analysis.force import force
    from pinotwin.cli.inputs import read_logs
    from pinotwin.errors import InputError

    out = Path(args.out)
    if out.suffix != ".csv":
        raise InputError(f"--out: {out.name}: the external effort is written as .csv")
    found = force(args.twin, *read_logs([args.log]), link=args.link)
    found.save(out)
    content = found.to_dict()
    told = [
        [
            name,
            f"{row['largest']:.4g} {row['unit']}",
            f"± {row['half_width90']:.3g} {row['unit']}",
            f"{row['share_beyond']:.0%}",
        ]
        for name, row in content["axes"].items()
    ]
    for line in columns(("axis", "largest", "90 % interval", "beyond it"), told):
        say(line)
    for direction, share in content.get("link", {}).get(args.link, {}).items():
        how = "not felt by the axes" if share == 0.0 else f"determined for {share:.0%} of the time"
        say(f"{args.link}.f{direction}: {how}")
    if args.json:
        write_json(args.json, content)
    say(f"external effort written to {out}; beyond it: share of the time, 10 % without any force")
    return 0
