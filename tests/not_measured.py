"""Numbers on the pages that look measured and are not: settings, definitions, levels, figures of others.

Page -> what stands there, word for word. tests/test_figures.py fails where a number is neither marked nor listed, and
where a listed one no longer stands on its page.
"""

from __future__ import annotations

NOT_MEASURED: dict[str, tuple[str, ...]] = {
    "bench.md": (
        "(Clopper-Pearson, 95 %)",
        "*Stated 90 % set:*",
        "(of a machine 1.1 % of the axis' effort, of a twin 0.5 % and its misfit)",
        "a rotor of 35 % of its axis' inertia",
        "Healthy friction scatters by 0.3 to 1 % from run to run",  # of the virtual machines, by construction
        "at 2 % for every rule",
    ),
    "commands.md": ("with its 90 % interval",),
    "compare.md": ("`parameters` with values and 90 % intervals", "(false discovery rate 5 %)"),
    "diagnose.md": (
        "with unit, 90 % interval and confidence",
        "held-out stretches; with a 90 % interval",
        "up to 5 % of it",  # a level of the rules
        "with a 90 % interval |\n| `none`",
        "a confidence below 50 %",
        "Of a machine: 1 % of the effort",
        "0.5 % of the effort (of a change) or 1.1 % of the effort (of a machine)",
        "A change of friction by less than 5 % of it is none",
        "more than such friction and more than 1.25 % of the effort",
        "Below 50 % a cause is only possible",
        "by less than 1.1 % (or less than the twin's misfit) is only named",
    ),
    "export.md": ("within 0.05 % of the largest value",),
    "glossary.md": (
        "with unit and 90 % interval",
        "below 5, 12 and 30 %, or above",
        "below 10 or 50 % of its value",
        "its 90 % interval reaches no further",
    ),
    "identify.md": ("more than 5 % of held-out rows",),
    "limits.md": (
        "torque of the last 40 % of its log",
        "last 40 % of the log along its measured motion",
        "e 7.12 %, u 5.12 %",  # the thesis, Table 4-5
        "e 6.15 %, u 2.63 %",
        "e 5.52 %, u 6.63 %",  # the thesis, Table C-2
        "e 6.00 %, u 4.02 %",
        "turns round within 20 mrad/s",
        "a near twin about 90° away",
        "95 % intervals of the stiffness hold it",
    ),
    "logs.md": (
        "by more than 2 % where the axis rests",
        "agree within 5 %",
        "explains 5 % of the residual",
        "99.99 % of its power",
    ),
    "machine.md": ("1 % of its top speed",),
    "many_logs.md": ("takes about 1 GB",),
    "README.md": (
        "cause and axis named first | 18 of 35 |",  # of the withheld bench, held by tests/test_docs.py
        "most effects below 1 % of the effort",
        "both named | 2 of 8 |",
        "as unknown | 5 of 9 |",
        "accused | 0 of 26 |",
        "right | 3 of 29 |",  # imitations of public reports
    ),
    "record.md": ("from 1 % to 100 %", "10, 50, 200 µm"),
    "simulate.md": (
        "by 5 % or 0.2 % of the signal",
        "their 90 % intervals",
        "still misses 20 % of the tracking error",
    ),
    "vibration.md": (
        "CAD inertias are 10 to 20 % off",
        "| hammer, 32 deg |",
        "| hammer, 73 deg |",
        "the stiffness to 4 % and the damping to 12 %",  # what the test holds
        "inertias 10 to 20 % off, 1 % of the IMU's samples",
        "95 % intervals hold the truth",
        "± 0.04",  # the thesis
        "5 % hysteresis and 10 % hardening",
        "95 % intervals that hold the truth",
        "| 2e-4 |",
        "| 0.05 |",
        "0.2 % of the filter's delay",
        "beyond 3 ppm",
        "the true deflection has 0.229 deg/s and 24.3 deg/s²",  # of the virtual rig, by construction
    ),
}
