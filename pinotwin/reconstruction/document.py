"""A reconstruction as plain data for ``--json``; SI, names with their units in the text."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from pinotwin.reconstruction.result import Sensor, SensorRun, Vibration


def document(vibration: Vibration) -> dict[str, Any]:
    """Return what was found, without the time series."""
    frequency, damping, m = vibration.frequency, vibration.damping, vibration.motion
    return {
        "machine": vibration.machine,
        "joint": vibration.joint,
        "frequency": {"value": frequency[0], "se": frequency[1], "unit": "Hz"},
        "damping_ratio": {"value": damping[0], "se": damping[1]},
        "rms": {"q": float(np.std(m.q[m.known])), "v": size(m.v), "a": size(m.a)},
        "sd": {k: size(getattr(m, f"sd_{k}")) for k in "qva"},
        "repeats": {
            "count": len(vibration.runs),
            "servo": vibration.sources,
            "delay": vibration.delays,
            "spread": dict(zip("qva", vibration.spread, strict=True)),
        },
        "sensors": [_sensor(sensor) for sensor in vibration.sensors],
        "unused_imu": [dataclasses.asdict(u) for u in vibration.unused],
        "quasi_static": vibration.verdict,
        "notes": vibration.notes,
    }


def size(x: np.ndarray) -> float:
    """Return the RMS of what is known [unit of its channel]."""
    return float(np.sqrt(np.nanmean(np.square(x))))


def _sensor(sensor: Sensor) -> dict[str, Any]:
    position, position_se = sensor.batch.shared("position")
    nonlinear = sensor.nonlinear
    return {
        "name": sensor.name,
        "link": sensor.link,
        "R_sensor_link": sensor.batch.R_ST,
        "R_sensor_link_se": np.sqrt(np.diag(sensor.batch.R_ST_cov)),
        "position": position,
        "position_se": position_se,
        "up_in_machine": sensor.batch.R_GM_up,
        "frequency": dict(zip(("value", "se"), sensor.batch.frequency, strict=True)),
        "damping_ratio": dict(zip(("value", "se"), sensor.batch.damping, strict=True)),
        "nonlinear": nonlinear and dict(zip(("hardening", "hysteresis"), nonlinear, strict=True)),
        "runs": [_run(sensor, part) for part in sensor.runs],
    }


def _run(sensor: Sensor, part: SensorRun) -> dict[str, Any]:
    found, clock = part.found, part.found.clock
    return {
        "run": part.run + 1,
        "imu": sensor.sources[part.run],
        "clock": {
            "offset": clock.offset,
            "offset_se": clock.se_offset,
            "skew": clock.skew,
            "skew_se": clock.se_skew,
            "at": {"imu": clock.main.pivot, "servo": clock.main.at_pivot, "se": clock.main.se},
            "restarts": len(clock.segments) - 1,
        },
        "gyro_scale": found.scale,
        "gyro_scale_se": found.scale_se,
        "gyro_bias": found.bias.mean(axis=0),
        "sd": {"q": size(found.sd_angle), "v": size(found.sd_velocity), "a": size(found.sd_acceleration)},
        "quasi_static": {
            "rms": found.quasi_static,
            "sd": found.quasi_static_sd,
            "observable": bool(2.0 * found.quasi_static_sd <= found.quasi_static),
            "verdict": found.verdict(),
        },
        "remainder": found.remainder,
        "parasitic_velocity_rms": np.sqrt(np.mean(found.parasitic**2, axis=0)),
    }
