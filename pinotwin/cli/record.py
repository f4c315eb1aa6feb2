"""``pinotwin record trunnion --seconds 24 --inject viscous:Y=0.2 --out log.csv``: a virtual machine's log."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pinotwin.cli.arguments import LOG, Answer, LogFile, Repeated, Several, check_written
from pinotwin.cli.inputs import read_logs
from pinotwin.errors import InputError

if TYPE_CHECKING:
    from pinotwin.virtual.recording import Recording

Trajectory = Literal["random", "multisine", "slow_reversals", "constant_speeds"]


def run(
    machine: str,
    *,
    seconds: float = 20.0,
    seed: int = 1,
    trajectory: Trajectory = "random",
    trajectory_seed: int | None = None,
    withhold: Several = (),
    inject: Several = (),
    axis: str | None = None,
    command: str | None = None,
    imu: Repeated = (),
    imu_link: Repeated = (),
    out: LogFile,
) -> Answer:
    """Run the virtual machine and write what its controller would log.

    Args:
        machine: machine folder, machine.yaml, or a bundled name
        seconds: length of the log (20)
        seed: of the noise, and of the trajectory unless --trajectory-seed is given
        trajectory (KIND): random, multisine, slow_reversals, constant_speeds (random)
        trajectory_seed (N): same N, other --seed: a repeat of the same command
        withhold (EFFECT[:AXIS]): effects to leave out of the truth
        inject (EFFECT:AXIS=SIZE): effects to add to the truth; SIZE is relative, 0.1 being a tenth of the axis' rated
            effort where the effect is an effort. Of an axis: viscous, quadratic_drag, coulomb, hysteresis,
            coulomb_asymmetric, stribeck, ripple, ripple_modulated, position_table, load_friction, viscous_thermal,
            effort_scale, feedforward, saturation, presliding, drive_flexibility, joint_flexibility, backlash,
            encoder_error, delay, geometric_error; of the machine: payload, inertial_coupling, external_force
        axis: axis that slow_reversals and constant_speeds move
        command (LOG): run the command of this log again
        imu (FILE): also write the log of a virtual IMU; may be given several times
        imu_link (LINK): link that carries it, in the order of --imu (from machine.yaml)
        out (PATH): log to write (.csv or .parquet)
    """
    from pinotwin.virtual.record import folder_of, record

    for path in imu:
        check_written("imu", path, *LOG)
    links = _imu_links(folder_of(machine), imu, imu_link)
    made = record(
        machine,
        seconds=seconds,
        seed=seed,
        trajectory=trajectory,
        trajectory_seed=trajectory_seed,
        withhold=withhold,
        inject=inject,
        axis=axis,
        command=read_logs([command])[0] if command else None,
        truth_at_control_rate=bool(links),  # an IMU filters what it samples
    )
    made.save(out)
    lines = _imus(made.recording, folder_of(machine), seed, zip(imu, links, strict=True))
    last = f"{made.recording.machine}: {len(made)} rows, {made.t[-1]:.4g} s, seed {seed}: {Path(out)}"
    return Answer([*lines, last], made.to_dict())


def _imus(run: Recording, folder: Path, seed: int, asked: Iterable[tuple[str, str]]) -> list[str]:
    """Write the logs of virtual IMUs, each of a file and a link, and return a line about each."""
    from pinotwin.logs.write import write_log
    from pinotwin.virtual import VirtualMachine
    from pinotwin.virtual.imu import record_imu

    lines = []
    for number, (path, link) in enumerate(asked, 1):
        log = record_imu(run.truth, link, VirtualMachine.load(folder).truth.seed, seed, number)
        write_log(path, log.channels)
        lines.append(f"{run.machine}: {len(log)} rows of imu{number} on {link}, its own clock: {path}")
    return lines


def _imu_links(folder: Path, files: Sequence[str], given: Sequence[str]) -> list[str]:
    from pinotwin.machine import Machine

    stated = [imu.link for imu in Machine.load(folder).imus.values()] if files else []
    if not stated and len(given) < len(files):
        raise InputError(
            "--imu: machine.yaml has no `imus`; say which link carries the sensor with --imu-link"
        )
    return [*given[: len(files)], *(stated[min(k, len(stated) - 1)] for k in range(len(given), len(files)))]
