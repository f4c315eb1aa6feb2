"""pinotwin: from a URDF and a log to a model that says where reality differs, and why.

    import pinotwin as pt
    machine = pt.Machine.load("trunnion")            # a bundled machine; or your folder, YAML or URDF
    twin = pt.identify(machine, pt.read("log.csv"))
    predicted = twin.simulate(pt.read("other.csv"))  # from the command alone
    found = pt.diagnose(twin, pt.read("today.csv"))  # where, why, how far it shrinks

Wherever a log, a machine or a twin is asked for, the name of its file or folder will do; a pin.Model will do
as a machine, a pandas table as a log, and arrays of shape (n, nv) become one by Log.from_arrays.

Nouns:     Log  Machine  Motion  Effect  Twin  Diagnosis  Axis  Servo  Vibration
Commands:  new  check  identify  improve  update  simulate  diagnose  force  compare  vibration  export  record  study
           view
Verbs:     read  prepare  resample  decompose  machines  reconstruct_vibration; of their own:
           Machine.load .save  Log.from_arrays  Twin.load .simulate .predict .residual .plot .report .save
           Diagnosis.save .plot .report .repaired .apply
Table:     EFFECTS (every effect by name)
Errors:    PinotwinError > InputError > LogError, MachineError, DataError, TwinError

Each has its own help, e.g. ``help(pt.identify)``. Names are loaded on first use, so that
``import pinotwin`` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

_NAMES = {  # module -> what it gives
    "pinotwin.analysis.decomposition": "decompose",
    "pinotwin.analysis.diagnoses": "compare",
    "pinotwin.analysis.force": "force",
    "pinotwin.diagnosis": "Diagnosis diagnose",
    "pinotwin.effects": "EFFECTS Effect",
    "pinotwin.errors": "DataError InputError LogError MachineError PinotwinError TwinError",
    "pinotwin.export": "export",
    "pinotwin.identification": "identify",
    "pinotwin.identification.update": "update",
    "pinotwin.log": "Log",
    "pinotwin.logs.check": "check",
    "pinotwin.logs.files": "read",
    "pinotwin.logs.prepare": "prepare",
    "pinotwin.logs.quality": "resample",
    "pinotwin.loop": "Servo",
    "pinotwin.machine": "Axis Machine machines",
    "pinotwin.motion": "Motion",
    "pinotwin.reconstruction": "Vibration reconstruct_vibration vibration",
    "pinotwin.report.study": "study",
    "pinotwin.scaffold": "new",
    "pinotwin.simulation": "simulate",
    "pinotwin.studies.improvement": "improve",
    "pinotwin.twin": "Twin",
    "pinotwin.version": "__version__",
    "pinotwin.viewer": "view",
    "pinotwin.virtual.record": "record",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

if TYPE_CHECKING:
    from pinotwin.analysis.decomposition import decompose as decompose
    from pinotwin.analysis.diagnoses import compare as compare
    from pinotwin.analysis.force import force as force
    from pinotwin.diagnosis import Diagnosis as Diagnosis
    from pinotwin.diagnosis import diagnose as diagnose
    from pinotwin.effects import EFFECTS as EFFECTS
    from pinotwin.effects import Effect as Effect
    from pinotwin.errors import DataError as DataError
    from pinotwin.errors import InputError as InputError
    from pinotwin.errors import LogError as LogError
    from pinotwin.errors import MachineError as MachineError
    from pinotwin.errors import PinotwinError as PinotwinError
    from pinotwin.errors import TwinError as TwinError
    from pinotwin.export import export as export
    from pinotwin.identification import identify as identify
    from pinotwin.identification.update import update as update
    from pinotwin.log import Log as Log
    from pinotwin.logs.check import check as check
    from pinotwin.logs.files import read as read
    from pinotwin.logs.prepare import prepare as prepare
    from pinotwin.logs.quality import resample as resample
    from pinotwin.loop import Servo as Servo
    from pinotwin.machine import Axis as Axis
    from pinotwin.machine import Machine as Machine
    from pinotwin.machine import machines as machines
    from pinotwin.motion import Motion as Motion
    from pinotwin.reconstruction import Vibration as Vibration
    from pinotwin.reconstruction import reconstruct_vibration as reconstruct_vibration
    from pinotwin.reconstruction import vibration as vibration
    from pinotwin.report.study import study as study
    from pinotwin.scaffold import new as new
    from pinotwin.simulation import simulate as simulate
    from pinotwin.studies.improvement import improve as improve
    from pinotwin.twin import Twin as Twin
    from pinotwin.version import __version__ as __version__
    from pinotwin.viewer import view as view
    from pinotwin.virtual.record import record as record


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'pinotwin' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted(_HOME)
