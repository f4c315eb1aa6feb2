"""What a diagnosis rests on: version, model, options, and the logs with their fingerprints."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pinotwin.log import Log
from pinotwin.logs.prepared import Prepared
from pinotwin.machine import Machine
from pinotwin.twin import Twin
from pinotwin.version import __version__


def provenance(
    subject: Machine | Twin, logs: Sequence[Prepared], validation: Sequence[Prepared], **options: Any
) -> dict[str, Any]:
    """Return what is needed to do a diagnosis again; the same for the same input."""
    twin = subject if isinstance(subject, Twin) else None
    machine = subject.machine if isinstance(subject, Twin) else subject
    used = [*((x.log, "diagnosed") for x in logs), *((x.log, "validation") for x in validation)]
    twin_from = [dict(row) for row in twin.data] if twin is not None else None
    return made_of(machine, used, twin_from=twin_from, options=options)


def made_of(machine: Machine, logs: Iterable[tuple[Log, str]], **rest: Any) -> dict[str, Any]:
    """Return version, machine and logs of a result, with what each log was used for, and what else is known."""
    facts = [log_facts(log, role) for log, role in logs]
    return {"version": __version__, "machine": str(machine.path), **rest, "logs": facts}


def log_facts(log: Log, role: str) -> dict[str, Any]:
    """Return name, length and hash of a log: of its file (SHA-256) where it is one, else of its numbers."""
    t = log.channels.get("t")
    path = Path(log.source)
    return {
        "source": log.source,
        "role": role,
        "rows": len(log),
        "seconds": None if t is None or len(t) == 0 else float(t[-1] - t[0]),
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None,
        "fingerprint": log.fingerprint(),
    }
