"""What a reconstruction returns: the deflection per run and of all runs, and how it was found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.imu.result import BatchResult, RunResult
from pinotwin.imu.runs import ImuRun
from pinotwin.log import Log
from pinotwin.logs.write import write_log
from pinotwin.reconstruction.servo import Piece


@dataclass(frozen=True)
class Motion3:
    """Angle, velocity and acceleration of the passive joint; arrays (n,), NaN where unknown, SI."""

    t: Floats  # servo clock [s]
    q: Floats  # angle [rad], with the slow part that the load explains
    v: Floats  # velocity [rad/s]
    a: Floats  # acceleration [rad/s²]
    sd_q: Floats  # standard deviation of the angle above 0.5 Hz [rad]
    sd_v: Floats  # of the velocity [rad/s]
    sd_a: Floats  # of the acceleration [rad/s²]

    @property
    def known(self) -> Mask:
        """Rows in which all three are known, a mask (n,)."""
        return np.isfinite(self.q) & np.isfinite(self.v) & np.isfinite(self.a)


@dataclass(frozen=True)
class SensorRun:
    """One stretch of one run as one IMU saw it."""

    run: int  # number of the run
    piece: Piece  # the stretch of the servo log
    imu: ImuRun = field(repr=False)  # the IMU's record
    found: RunResult = field(repr=False)  # what the batch estimate says about it


@dataclass(frozen=True)
class Sensor:
    """One IMU over all runs."""

    name: str  # "imu1", "imu2"
    link: str  # the link that carries it
    batch: BatchResult = field(repr=False)  # the whole estimate
    runs: tuple[SensorRun, ...]  # its stretches
    sources: tuple[str, ...]  # its log of every run
    # hardening and hysteresis as shares of the spring's torque at the largest deflection, where the joint
    # showed them
    nonlinear: tuple[float, float] | None = None


@dataclass(frozen=True)
class Unused:
    """What is left of an IMU's raw signals; RMS per axis and run [rad/s] and [m/s²]."""

    fitted: str  # the IMU that found the deflection
    predicted: str  # the one that was not used
    gyro: float  # left with that deflection
    gyro_rigid: float  # without any deflection
    gyro_noise: float  # standard deviation at rest; NaN where the log has no rest
    accel: float  # the same of the accelerometer. accel_rigid, accel_noise: likewise
    accel_rigid: float
    accel_noise: float


@dataclass(frozen=True)
class Vibration:
    """The motion of a passive joint, reconstructed.

    Attributes:
        machine: name of the machine.
        joint: the passive joint.
        motion: mean of all runs, weighted by information, on the clock of the first one.
        runs: every run on its own servo clock, all IMUs combined.
        sources: servo log of every run.
        delays: how far every run lies behind the first [s].
        spread: standard deviation between the runs of q, v, a: the noise ceiling; NaN for one run.
        sensors: the IMUs.
        unused: how well each IMU's raw signals follow from the deflection found by another one.
        notes: what a user should know.
    """

    machine: str
    joint: str
    motion: Motion3
    runs: tuple[Motion3, ...]
    sources: tuple[str, ...]
    delays: tuple[float, ...]
    spread: Floats
    sensors: tuple[Sensor, ...]
    unused: tuple[Unused, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def frequency(self) -> tuple[float, float]:
        """Natural frequency with the motors held, and its standard error [Hz]."""
        return _weighted([s.batch.frequency for s in self.sensors])

    @property
    def damping(self) -> tuple[float, float]:
        """Damping ratio and its standard error."""
        return _weighted([s.batch.damping for s in self.sensors])

    @property
    def verdict(self) -> str:
        """In words, what is known of the slow part of the angle."""
        return self.sensors[0].runs[0].found.verdict()

    def channels(self) -> Mapping[str, Floats]:
        """Return ``t``, ``<joint>.v``, ``<joint>.a``, ``<joint>.q`` on the first servo clock."""
        m, name = self.motion, self.joint
        return {"t": m.t, f"{name}.v": m.v, f"{name}.a": m.a, f"{name}.q": m.q}

    def to_log(self) -> Log:
        """Return the same as a log."""
        return Log(dict(self.channels()), source=f"vibration of {self.machine}")

    def save(self, path: str | Path) -> None:
        """Write the channels as CSV, or Parquet by the ending."""
        write_log(path, self.channels())


def _weighted(values: list[tuple[float, float]]) -> tuple[float, float]:
    x, se = (np.array(c) for c in zip(*values, strict=True))
    w = 1.0 / np.maximum(se, 1e-12) ** 2
    return float(np.sum(w * x) / np.sum(w)), float(1.0 / np.sqrt(np.sum(w)))
