"""``pinotwin vibration MACHINE --servo LOG [LOG...] --imu LOG [LOG...] --out VIB.csv``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pinotwin.cli.inputs import add_effects, read_logs
from pinotwin.cli.output import add_common, say, write_json
from pinotwin.cli.progress import progress
from pinotwin.system.writing import write_text

if TYPE_CHECKING:
    from pinotwin.reconstruction import Vibration


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("machine", help="machine or twin folder, machine.yaml, or a bundled name")
    parser.add_argument(
        "--servo",
        nargs="+",
        required=True,
        metavar="LOG",
        help="servo log(s); several are repeats of one command",
    )
    parser.add_argument(
        "--imu",
        nargs="+",
        required=True,
        metavar="LOG",
        help="IMU log of each of them, in the same order, on its own clock",
    )
    parser.add_argument("--imu2", nargs="+", metavar="LOG", help="the same of a second IMU")
    parser.add_argument("--joint", help="passive joint, where the machine has several")
    parser.add_argument("--link", help="link that carries the IMU (from machine.yaml)")
    parser.add_argument("--link2", help="link that carries the second IMU")
    parser.add_argument(
        "--imu-cutoff",
        type=float,
        default=140.0,
        metavar="HZ",
        help="corner of the low-pass inside the IMU (140); 0 for none",
    )
    parser.add_argument(
        "--servo-cutoff",
        type=float,
        default=100.0,
        metavar="HZ",
        help="corner of the zero-phase low-pass on the encoders (100)",
    )
    parser.add_argument("--report", metavar="FILE", help="write an HTML report here")
    parser.add_argument(
        "--no-methods", action="store_true", help=argparse.SUPPRESS
    )  # of scripts: no table any more
    add_effects(parser)
    add_common(parser, out="deflection on the servo clock (.csv or .parquet)", required=True, file=True)


def run(args: argparse.Namespace) -> int:
    """Reconstruct, write, and say how well it is known."""
    from pinotwin.errors import InputError
    from pinotwin.machine import Machine
    from pinotwin.reconstruction import Settings, reconstruct_vibration
    from pinotwin.reconstruction.document import document

    if Path(args.out).suffix not in (".csv", ".parquet"):
        raise InputError(f"--out: {args.out}: a log ends in .csv or .parquet")
    if args.imu_cutoff < 0 or args.servo_cutoff <= 0:
        raise InputError("--imu-cutoff must not be negative, --servo-cutoff must be positive")
    machine = Machine.load(args.machine)
    servo, imu = read_logs(args.servo), read_logs(args.imu)
    imu2 = read_logs(args.imu2) if args.imu2 else None
    settings = Settings(args.joint, (args.link, args.link2), args.imu_cutoff, args.servo_cutoff)
    with progress() as report:
        found = reconstruct_vibration(machine, servo, imu, imu2, settings=settings, report=report)
        found.save(args.out)
        if args.report:
            from pinotwin.report.vibration import vibration_report

            report("writing the report", 0.95)
            write_text(Path(args.report), vibration_report(found))
    if args.json:
        write_json(args.json, document(found))
    for line in summary(found):
        say(line)
    say(f"{found.joint} on the servo clock written to {args.out}")
    return 0


def summary(found: Vibration) -> list[str]:
    """Return the lines that a user wants to see first; angles in degrees."""
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
            f"{u.predicted} not used, predicted by {u.fitted}: gyro left "
            f"{np.degrees(u.gyro):.4f} deg/s (no deflection {np.degrees(u.gyro_rigid):.4f}, at rest "
            f"{_known(np.degrees(u.gyro_noise))}), accelerometer {u.accel:.4f} m/s² (no deflection "
            f"{u.accel_rigid:.4f}, at rest {_known(u.accel_noise)})"
        )
    return lines + [f"note: {note}" for note in found.notes]


def _known(x: float) -> str:
    return f"{x:.4f}" if np.isfinite(x) else "unknown: no rest in the log"
