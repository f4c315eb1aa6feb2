"""pinotwin: from a URDF and a log to a model that says where reality differs, and why.

    import pinotwin as pt
    machine = pt.Machine.load("trunnion")
    log = pt.read("log.csv")
    twin = pt.identify(machine, log)

Names are loaded on first use, so that ``import pinotwin`` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "Axis": "pinotwin.machine",
    "EFFECTS": "pinotwin.effects",
    "Effect": "pinotwin.effects",
    "InputError": "pinotwin.errors",
    "Log": "pinotwin.log",
    "Machine": "pinotwin.machine",
    "Motion": "pinotwin.motion",
    "PinotwinError": "pinotwin.errors",
    "Twin": "pinotwin.twin",
    "check": "pinotwin.logs.check",
    "decompose": "pinotwin.analysis.decomposition",
    "diagnose": "pinotwin.diagnosis",
    "export_twin": "pinotwin.export",
    "identify": "pinotwin.identification",
    "machines": "pinotwin.machine",
    "new": "pinotwin.scaffold",
    "prepare": "pinotwin.logs.prepare",
    "read": "pinotwin.logs.files",
    "reconstruct_vibration": "pinotwin.reconstruction",
    "resample": "pinotwin.logs.quality",
    "simulate": "pinotwin.simulation",
}

__all__ = sorted([*_HOME, "__version__"])

if TYPE_CHECKING:
    from pinotwin.analysis.decomposition import decompose as decompose
    from pinotwin.diagnosis import diagnose as diagnose
    from pinotwin.effects import EFFECTS as EFFECTS
    from pinotwin.effects import Effect as Effect
    from pinotwin.errors import InputError as InputError
    from pinotwin.errors import PinotwinError as PinotwinError
    from pinotwin.export import export_twin as export_twin
    from pinotwin.identification import identify as identify
    from pinotwin.log import Log as Log
    from pinotwin.logs.check import check as check
    from pinotwin.logs.files import read as read
    from pinotwin.logs.prepare import prepare as prepare
    from pinotwin.logs.quality import resample as resample
    from pinotwin.machine import Axis as Axis
    from pinotwin.machine import Machine as Machine
    from pinotwin.machine import machines as machines
    from pinotwin.motion import Motion as Motion
    from pinotwin.reconstruction import reconstruct_vibration as reconstruct_vibration
    from pinotwin.scaffold import new as new
    from pinotwin.simulation import simulate as simulate
    from pinotwin.twin import Twin as Twin


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'pinotwin' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return list(__all__)
