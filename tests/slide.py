"""One linear axis with friction, ripple and a bend behind its encoder, as a folder: quick to identify."""

from __future__ import annotations

from pathlib import Path

import yaml

URDF = """<robot name="slide"><link name="base"/>
<joint name="X" type="prismatic"><parent link="base"/><child link="table"/><axis xyz="1 0 0"/>
<limit lower="-0.4" upper="0.4" effort="1500" velocity="1"/></joint>
<link name="table"><inertial><mass value="70"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>
"""


def slide(folder: Path, *, ripple: bool = False, bend: bool = False, law: str = "gms") -> Path:
    """Write the machine and its truth; return the folder."""
    effects = ["viscous", "presliding", *(["ripple"] if ripple else [])]
    loop = {"X": {"real_poles": 3, "pole_pairs": 2 if bend else 1}}
    axis = {"joint": "X", "effects": effects, "effort_limit": 1500}
    machine = {"name": "slide", "urdf": "slide.urdf", "axes": {"X": axis}, "loop": loop}
    truth = {
        "limits": {"speed": 0.5, "acceleration": 6.0, "jerk": 300.0, "travel": [-0.25, 0.25]},
        "controller": {"kind": "p_pi", "bandwidth": 14.0},
        "friction": {
            "kind": law,
            "coulomb": 20.0,
            "static": 1.3,
            "stribeck_speed": 0.006,
            "viscous": 60.0,
            "presliding": 6.0e-6,
        },
    }
    if ripple:
        truth["ripple"] = [{"amplitude": 12.0, "period": 0.0172, "phase": 0.4}]
    if bend:
        truth["bend"] = {"frequency": 24.0, "damping": 0.02, "share": 0.2}
    sealed = {"seed": 3, "control_rate": 4000, "log_rate": 500, "axes": {"X": truth}}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "slide.urdf").write_text(URDF)
    (folder / "machine.yaml").write_text(yaml.safe_dump(machine))
    (folder / "virtual.yaml").write_text(yaml.safe_dump(sealed))
    return folder
