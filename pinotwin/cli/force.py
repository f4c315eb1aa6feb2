"""``pinotwin force twin today.csv --out force.csv``: the external effort on every axis over time."""

from __future__ import annotations

from pinotwin.cli.arguments import Answer, CsvFile
from pinotwin.cli.inputs import check_there, check_twin, read_logs
from pinotwin.cli.output import columns


def run(twin: str, log: str, *, link: str | None = None, out: CsvFile) -> Answer:
    """Estimate, write, and say how often the external effort of each axis lies beyond its interval.

    Args:
        log (LOG): servo log of the same machine
        link (NAME): also the pure force on this link, in its axes
        out (PATH): external effort over time to write (.csv)
    """
    check_twin(twin)
    check_there(log)
    from pinotwin.analysis.force import force

    found = force(twin, *read_logs([log]), link=link)
    found.save(out)
    content = found.to_dict()
    rows = []
    for name, row in content["axes"].items():
        largest = f"{row['largest']:.4g} {row['unit']}"
        half = f"± {row['half_width90']:.3g} {row['unit']}"
        rows.append([name, largest, half, f"{row['share_beyond']:.0%}"])
    lines = columns(("axis", "largest", "90 % interval", "beyond it"), rows)
    for direction, share in content.get("link", {}).get(link, {}).items():
        how = "not felt by the axes" if share == 0.0 else f"determined for {share:.0%} of the time"
        lines.append(f"{link}.f{direction}: {how}")
    told = f"external effort written to {out}; beyond it: share of the time, 10 % without any force"
    return Answer([*lines, told], content)
