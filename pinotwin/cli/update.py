"""``pinotwin update twin other.csv --out twin2``: a twin that takes in more logs."""

from __future__ import annotations

import time
from pathlib import Path

from pinotwin.cli.arguments import Answer, Folder, Several
from pinotwin.cli.identify import save_twin, summary
from pinotwin.cli.inputs import check_there, read_logs
from pinotwin.cli.progress import progress
from pinotwin.system.stamps import made


def run(twin: str, logs: Several, *, out: Folder | None = None) -> Answer:
    """Add healthy logs to a twin and save it; a log that it holds already is passed over.

    Args:
        logs (LOG): healthy servo log(s) of the twin's machine
        out (PATH): folder for the new twin and its report (without one: TWIN itself)
    """
    check_there(*logs)
    from pinotwin.twin import Twin

    known, given = Twin.load(twin), read_logs(logs)
    from pinotwin.identification.update import update

    began, target = time.monotonic(), out or str(Path(twin).parent if Path(twin).is_file() else twin)
    with progress() as report:
        found = update(known, given, report=report)
        if found is known and out is None:
            return Answer([f"{known.machine.name}: the twin holds these logs already"], known.to_dict())
        new = [log for log in given if log.fingerprint() not in {row["fingerprint"] for row in known.data}]
        content = save_twin(found, new or given, [], made(began), target)
    lines = [f"{len(found.data) - len(known.data)} log(s) added, {len(found.data)} in all", *summary(found)]
    return Answer([*lines, f"twin and report written to {target}"], content)
