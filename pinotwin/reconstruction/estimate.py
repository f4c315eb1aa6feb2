"""From servo and IMU logs to the motion of the passive joint: clocks, a batch estimate per IMU, all combined.

The honest test: an IMU that was not used must read what the deflection found by another implies. Clock, mounting and
place are from its own estimate; scale, cross-axis terms and bias (12 numbers) from its readings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.columns import bind
from pinotwin.errors import DataError
from pinotwin.imu import batch
from pinotwin.imu.clock import ClockFit, SyncSettings, sync
from pinotwin.imu.filters import group_delay
from pinotwin.imu.predict import RunModel
from pinotwin.imu.runs import ImuRun, Priors, ServoRun
from pinotwin.imu.whiten import rest
from pinotwin.log import Log
from pinotwin.logs.channels import usable
from pinotwin.logs.files import LogLike, as_logs
from pinotwin.machine import Machine, MachineLike, as_machine
from pinotwin.reconstruction.combine import combined, delay, of_run
from pinotwin.reconstruction.result import Motion3, Sensor, SensorRun, Unused, Vibration
from pinotwin.reconstruction.sensor_log import imu_run
from pinotwin.reconstruction.servo import (
    Piece,
    Settings,
    imu_link,
    needed,
    passive_joint,
    pieces,
    priors,
    shares,
    with_columns,
    with_posture,
)
from pinotwin.system.threads import one_blas_thread

Report = Callable[[str, float], None]
Logs = LogLike | Sequence[LogLike]


@one_blas_thread
def reconstruct_vibration(
    machine: MachineLike,
    servo_logs: Logs,
    imu_logs: Logs,
    imu2_logs: Logs | None = None,
    *,
    settings: Settings | None = None,
    report: Report | None = None,
) -> Vibration:
    """Return the deflection of the machine's passive joint, its velocity and its acceleration.

    Args:
        machine: with one passive joint and an IMU on a link beyond it.
        servo_logs: servo log(s); several are repeats of one command.
        imu_logs: log of the IMU for each of them, in the same order, on the IMU's own clock.
        imu2_logs: the same of a second IMU.
        settings: joint, links and low-passes.
        report: called with the stage and the share done.

    Raises:
        MachineError: no passive joint, or no link for the IMU.
        LogError: a channel is missing.
        DataError: the logs do not come in pairs, nothing rotates, or they are not repeats.
    """
    machine = as_machine(machine)
    s = settings or Settings()
    tell = report or (lambda stage, done: None)
    joint = passive_joint(machine, s.joint)
    servo = [usable(machine, bind(log, machine.columns)) for log in as_logs(servo_logs)]
    if not servo:
        raise DataError("no log given; give at least one servo and one IMU log")
    groups = [as_logs(logs) for logs in (imu_logs, imu2_logs) if logs is not None]
    for group in groups:
        if len(group) != len(servo):
            raise DataError(f"{len(servo)} servo and {len(group)} IMU logs; give them in pairs")
    delays = [0.0] + [delay(machine, servo[0], other) for other in servo[1:]]
    prior = priors(machine, joint, s)
    sensors = []
    for k, group in enumerate(groups):
        tell(f"estimating from IMU {k + 1}", 0.05 + 0.75 * k / len(groups))
        link = imu_link(machine, joint, k, s.links[k])
        job = _Job(machine, joint, link, s, prior)
        sensors.append(job.sensor(f"imu{k + 1}", servo, group))
    runs = [of_run(r, log.t, sensors) for r, log in enumerate(servo)]
    motion, spread = combined(runs, delays)
    return Vibration(
        machine=machine.name,
        joint=joint,
        motion=motion,
        runs=tuple(runs),
        sources=tuple(log.source for log in servo),
        delays=tuple(delays),
        spread=spread,
        sensors=tuple(sensors),
        unused=unused(sensors, prior),
        notes=_notes(sensors, runs),
    )


@dataclass(frozen=True)
class _Job:
    """One IMU's estimate: what stays the same over its runs."""

    machine: Machine
    joint: str
    link: str
    settings: Settings
    prior: Priors

    def sensor(self, name: str, servo: Sequence[Log], logs: Sequence[Log]) -> Sensor:
        """Return the estimate over all runs of one IMU."""
        found: list[tuple[int, Piece, ImuRun, ClockFit]] = []
        for r, (log, imu_log) in enumerate(zip(servo, logs, strict=True)):
            found += [(r, *x) for x in self._matched(log, imu_log)]
        numbers, pieces, imus, clocks = zip(*found, strict=True)

        def estimate(servo: Sequence[ServoRun]) -> batch.BatchResult:
            return batch.estimate(servo, imus, self.prior, clocks)

        first = estimate([piece.run for piece in pieces])
        servo_runs = with_posture(self.machine, self.joint, pieces, first.runs)
        result, share = estimate(servo_runs), None
        if needed(result.runs):
            second, result = result, estimate(with_columns(servo_runs, result.runs))
            share = shares(result, servo_runs, second.runs)
        runs = tuple(map(SensorRun, numbers, pieces, imus, result.runs))
        return Sensor(name, self.link, result, runs, tuple(log.source for log in logs), share)

    def _matched(self, log: Log, imu_log: Log) -> list[tuple[Piece, ImuRun, ClockFit]]:
        """Return the stretches of a run whose clock could be matched with the IMU's."""
        imu = imu_run(imu_log)
        out, first = [], None
        settings = SyncSettings(delay=group_delay(self.prior.gyro_cutoff), skew=self.prior.skew)
        for piece in pieces(self.machine, log, self.joint, self.link, self.settings.servo_cutoff):
            try:
                clock = sync(piece.run.t, piece.run.w, imu.t, imu.gyr, settings)
            except DataError as error:
                first = first or error
                continue
            out.append((piece, imu, clock))
        if not out:
            raise DataError(f"{log.source} with {imu_log.source}: {first}") from None
        return out


def _notes(sensors: Sequence[Sensor], runs: Sequence[Motion3]) -> tuple[str, ...]:
    """Say where the mode is doubtful (below 6 standard deviations) or the mounting (above 0.1 deg)."""
    out = []
    for sensor in sensors:
        speed, sd = sensor.batch.seen
        if speed < 6.0 * sd:
            out.append(
                f"{sensor.name}: the joint deflects little, {np.degrees(speed):.2g} deg/s RMS known "
                f"to +-{np.degrees(sd):.2g} deg/s; its frequency and damping are not to be trusted"
            )
        turn = float(np.degrees(np.sqrt(np.diag(sensor.batch.R_ST_cov).max())))
        if turn > 0.1:
            out.append(
                f"{sensor.name}: its mounting is known to +-{2.0 * turn:.2g} deg only, because "
                "one axis turns (almost) alone; move a second, non-parallel axis too"
            )
        if any(r.found.quasi_static_sd > 0.5 * r.found.quasi_static for r in sensor.runs):
            out.append(
                f"{sensor.name}: the slow part of the angle (below 0.5 Hz) is not observable; the "
                "angle is to be trusted above 0.5 Hz only"
            )
        if sensor.nonlinear is not None:
            hardening, hysteresis = sensor.nonlinear
            out.append(
                f"{sensor.name}: the joint is no linear spring: at the largest deflection about "
                f"{hardening:+.0%} hardening and {hysteresis:+.0%} hysteresis of the spring's "
                "torque; both are in the estimate"
            )
    for k, run in enumerate(runs):
        missing = 1.0 - float(np.mean(run.known))
        if missing > 0.0:
            out.append(f"run {k + 1}: no deflection in {missing:.1%} of its rows (holes)")
    return tuple(out)


def unused(sensors: Sequence[Sensor], prior: Priors) -> tuple[Unused, ...]:
    """Return the test for every ordered pair of IMUs on one link; none for a single IMU."""
    return tuple(_pair(a, b, prior) for a in sensors for b in sensors if a is not b and a.link == b.link)


def _pair(fitted: Sensor, other: Sensor, prior: Priors) -> Unused:
    pairs = [(x, y) for x in fitted.runs for y in other.runs if x.run == y.run]
    same = [(x, y) for x, y in pairs if np.array_equal(x.piece.rows, y.piece.rows)]
    x = np.square([_one(mine, theirs, other, prior) for mine, theirs in same])
    count = np.isfinite(x).sum(axis=0)  # the noise is unknown where no log has a rest
    mean = np.where(count > 0, np.nansum(x, axis=0) / np.maximum(count, 1), np.nan)
    return Unused(fitted.name, other.name, *np.sqrt(mean))


def _one(mine: SensorRun, theirs: SensorRun, other: Sensor, prior: Priors) -> list[float]:
    """Return gyro (left, rigid, noise) and accelerometer (left, rigid, noise)."""
    shared = other.batch.shared
    own, place = replace(prior, gravity=shared("gravity")[0]), shared("position")[0]
    # IMUs fitted to one encoder agree by construction; one predicts another's signals only if the deflection is right.
    model = RunModel(mine.piece.run, theirs.imu, own, theirs.found.clock.to_ref(theirs.imu.t))
    f = mine.found
    found = np.stack([f.angle, f.velocity, f.acceleration], axis=1)
    predicted = [model.readings(f.t, x, other.batch.R_ST, place) for x in (found, 0.0 * found)]
    rate = 1.0 / float(np.median(np.diff(theirs.imu.t)))
    quiet = rest(theirs.imu.gyr, theirs.imu.acc, rate)
    out = []
    for k, y in enumerate((theirs.imu.gyr, theirs.imu.acc)):
        out += [_left(model.read[:, 3 * k : 3 * k + 3], p[k]) for p in predicted]
        out.append(_noise(y, quiet))
    return out


def _noise(y: Floats, quiet: Mask, window: int = 40) -> float:
    """Return the standard deviation per axis in the quieter windows at rest, NaN without a rest."""
    count = len(y) // window
    windows = y[: count * window].reshape(count, window, -1)
    still = quiet[: count * window].reshape(count, window).all(axis=1)
    if not still.any():
        return float("nan")
    return float(np.sqrt(np.quantile(np.var(windows[still], axis=1).mean(axis=1), 0.25)))


def _left(y: Floats, predicted: Floats) -> float:
    """Return the RMS per axis of readings less what is affine in the prediction."""
    X = np.hstack([predicted, np.ones((len(predicted), 1))])
    e = y - X @ np.linalg.lstsq(X, y, rcond=None)[0]
    return float(np.sqrt(np.mean(e**2)))
