"""What a diagnosis looks like on disk: the folder that ``pinotwin diagnose`` and ``Diagnosis.save`` write."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from pinotwin.diagnosis.result import Diagnosis
from pinotwin.effects import given
from pinotwin.errors import PinotwinError
from pinotwin.report.diagnosis import diagnosis_report
from pinotwin.report.diagnosis_verdict import machine_of
from pinotwin.system.stamps import now
from pinotwin.system.writing import whole_folder, write_json, write_text

REPLACES = ("machine", "advice_*.csv")  # What of an earlier result goes, if the new one has none of it

BESIDE = {  # What lies beside the page -> what it holds
    "machine.html": "the machine playing the log in 3-D, coloured by the residual; open it in a browser",
    "diagnosis.json": "all numbers of this page, for programs",
    "machine/machine.yaml": "the machine with the named causes, to identify again",
}


def write_diagnosis(found: Diagnosis, folder: Path, meshes: str | Path | None = None) -> list[str]:
    """Write a diagnosis and what lies beside it into an empty folder; return what went wrong with the picture alone."""
    if "date" not in found.provenance:
        found = replace(found, provenance={**found.provenance, "date": now()})
    write_json(folder / "diagnosis.json", found.to_dict())
    if found.effects and machine_of(found) is not None:
        found.apply(folder / "machine")
    for name, channels in found.commands.items():
        table = np.column_stack(list(channels.values()))
        np.savetxt(folder / name, table, fmt="%.9g", delimiter=",", header=",".join(channels), comments="")
    said = write_view(found, folder, meshes)
    beside = [(name, text) for name, text in BESIDE.items() if (folder / name).is_file()]
    moves = sorted(path.name for path in folder.glob("advice_*.csv"))
    beside += [(name, "command of a motion to record next") for name in moves]
    write_text(folder / "report.html", diagnosis_html(found, beside))
    return said


def save_diagnosis(found: Diagnosis, folder: Path, meshes: str | Path | None = None) -> list[str]:
    """Write a diagnosis in place of an earlier one, whole or not at all; see :func:`write_diagnosis`."""
    with whole_folder(folder, replaces=REPLACES) as part:
        return write_diagnosis(found, part, meshes)


def diagnosis_html(found: Diagnosis, files: Iterable[tuple[str, str]] = ()) -> str:
    """Return the page of a diagnosis, its own logs and effects at hand."""
    named = (*found.effects, *found.possible)
    with given(type(e.listed) for e in named if e.listed is not None):  # whoever wrote them
        return diagnosis_report(found, tuple(files))


def write_view(found: Diagnosis, folder: Path, meshes: str | Path | None) -> list[str]:
    """Write the machine playing the first log, every axis in the colour of its grade."""
    from pinotwin.viewer import missing_meshes
    from pinotwin.viewer.gap import gap_page

    machine = machine_of(found)
    if machine is None or not found.prepared:
        return []
    machine = machine.with_meshes(meshes)
    try:
        write_text(folder / "machine.html", gap_page(found, machine))
    except (PinotwinError, ValueError, RuntimeError, KeyError, IndexError, OSError) as error:
        return [f"machine.html was not written: {' '.join(str(error).split())[:200]}"]
    missing = missing_meshes(machine.urdf, machine.meshes)
    return [missing] if missing else []
