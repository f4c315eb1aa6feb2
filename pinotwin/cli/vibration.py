"""``pinotwin vibration flexure_rig --servo s.csv --imu i.csv --out vib.csv``: the vibration of a joint."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pinotwin.cli.arguments import Answer, LogFile, PageFile, Several
from pinotwin.cli.inputs import check_there, read_logs
from pinotwin.cli.progress import progress
from pinotwin.errors import InputError
from pinotwin.system.writing import write_text

if TYPE_CHECKING:
    from pinotwin.reconstruction import Vibration


def run(
    machine: str,
    *,
    servo: Several,
    imu: Several,
    imu2: Several | None = None,
    joint: str | None = None,
    link: str | None = None,
    link2: str | None = None,
    imu_cutoff: float = 140.0,
    servo_cutoff: float = 100.0,
    report: PageFile | None = None,
    no_methods: bool = False,
    out: LogFile,
) -> Answer:
    """Reconstruct, write, and say how well it is known.

    Args:
        machine: machine or twin folder, machine.yaml, or a bundled name
        servo (LOG): servo log(s); several are repeats of one command
        imu (LOG): IMU log of each of them, in the same order, on its own clock
        imu2 (LOG): the same of a second IMU
        joint: passive joint, where the machine has several
        link: link that carries the IMU (from machine.yaml)
        link2: link that carries the second IMU
        imu_cutoff (HZ): corner of the low-pass inside the IMU (140); 0 for none
        servo_cutoff (HZ): corner of the zero-phase low-pass on the encoders (100)
        report (FILE): write an HTML report here
        out (PATH): deflection on the servo clock (.csv or .parquet)
    """
    check_there(*servo, *imu, *(imu2 or ()))
    from pinotwin.machine import Machine
    from pinotwin.reconstruction import Settings, reconstruct_vibration
    from pinotwin.reconstruction.document import document

    del no_methods  # scripts give it: the page had a table that it left out
    if imu_cutoff < 0 or servo_cutoff <= 0:
        raise InputError("--imu-cutoff must not be negative, --servo-cutoff must be positive")
    believed = Machine.load(machine)
    logs, first, second = (read_logs(names or ()) for names in (servo, imu, imu2))
    settings = Settings(joint, (link, link2), imu_cutoff, servo_cutoff)
    with progress() as shown:
        found = reconstruct_vibration(believed, logs, first, second or None, settings=settings, report=shown)
        found.save(out)
        if report:
            from pinotwin.report.vibration import vibration_report

            shown("writing the report", 0.95)
            write_text(report, vibration_report(found))
    lines = [*summary(found), f"{found.joint} on the servo clock written to {out}"]
    return Answer(lines, document(found))


def summary(found: Vibration) -> list[str]:
    """Return the lines that a user wants to see first; angles in degrees."""
    import numpy as np

    m = found.motion
    rows = m.known
    size = [np.degrees(np.std(x[rows])) for x in (m.q, m.v, m.a)]
    sd = [np.degrees(np.sqrt(np.nanmean(x**2))) for x in (m.sd_q, m.sd_v, m.sd_a)]
    count = f"{len(found.runs)} run{'s' if len(found.runs) > 1 else ''}"
    (f, f_se), (zeta, zeta_se) = found.frequency, found.damping
    lines = [
        f"{found.machine}, {found.joint}: {count}, {len(found.sensors)} IMU(s)",
        f"{'':<14}{'RMS':>10}{'± (1 sd)':>12}",
        f"{'angle':<14}{size[0]:>10.3g}{sd[0]:>12.2g}  deg (above 0.5 Hz: its interval)",
        f"{'velocity':<14}{size[1]:>10.3g}{sd[1]:>12.2g}  deg/s",
        f"{'acceleration':<14}{size[2]:>10.3g}{sd[2]:>12.2g}  deg/s²",
        f"{found.verdict}",
        f"mode with the motors held: {f:.2f} ± {f_se:.2f} Hz, damping {zeta:.4f} ± {zeta_se:.4f}",
    ]
    for sensor in found.sensors:
        for part in sensor.runs:
            c = part.found.clock
            lines.append(
                f"{sensor.name}, run {part.run + 1}: offset {c.offset:.6f} ± {c.se_offset:.6f} s, "
                f"skew {1e6 * c.skew:+.1f} ± {1e6 * c.se_skew:.1f} ppm, gyro scale "
                + " ".join(f"{1e2 * s:+.3f}" for s in part.found.scale)
                + f" % (± {1e2 * part.found.scale_se.max():.3f})"
            )
    for u in found.unused:
        lines.append(
            f"{u.predicted} not used, predicted by {u.fitted}: gyro left {np.degrees(u.gyro):.4f} deg/s (no deflection "
            f"{np.degrees(u.gyro_rigid):.4f}, at rest {_known(np.degrees(u.gyro_noise))}), accelerometer {u.accel:.4f} "
            f"m/s² (no deflection {u.accel_rigid:.4f}, at rest {_known(u.accel_noise)})"
        )
    return lines + [f"note: {note}" for note in found.notes]


def _known(x: float) -> str:
    return f"{x:.4f}" if math.isfinite(x) else "unknown: no rest in the log"
