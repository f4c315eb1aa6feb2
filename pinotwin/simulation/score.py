"""A prediction beside what was measured."""

from __future__ import annotations

import numpy as np

from pinotwin.arrays import Floats, Mask
from pinotwin.columns import bind
from pinotwin.log import Log
from pinotwin.machine import Machine
from pinotwin.signals import rms

STILL = 1e-9  # Command between two rows, as a share of its travel, that counts as standing


def compare(machine: Machine, log: Log, predicted: Log) -> dict[str, dict[str, dict[str, float]]]:
    """Return the errors of a prediction, axis -> ``e`` and ``u`` -> rms, nrmse, nrmse_std, moving, resting.

    ``nrmse`` is over the RMS of what was measured, ``nrmse_std`` over its standard deviation, ``moving`` and
    ``resting`` of the rows whose command moves and stands over that RMS. Rows that are not numbers are left out.
    """
    log = bound(machine, log)
    out: dict[str, dict[str, dict[str, float]]] = {}
    for name in machine.axes:
        moves = np.abs(np.gradient(log[f"{name}.qr"])) > STILL * float(np.ptp(log[f"{name}.qr"]))
        known = measured(machine, log, name).items()
        rows = {signal: _row(x, predicted[f"{name}.{signal}"], moves) for signal, x in known}
        if rows:
            out[name] = rows
    return out


def measured(machine: Machine, log: Log, axis: str) -> dict[str, Floats]:
    """Return tracking error ``e`` and effort ``u`` of an axis [SI], shape (n,), as far as a bound log holds them."""
    out = {}
    if {machine.regulated(axis), f"{axis}.qr"} <= set(log.channels):
        out["e"] = log[f"{axis}.qr"] - log[machine.regulated(axis)]
    if f"{axis}.u" in log:
        out["u"] = log[f"{axis}.u"]
    return out


def bound(machine: Machine, log: Log) -> Log:
    """Return the log with the contract's names for those of its columns that it holds; a bound log as it is."""
    return bind(log, machine.columns, optional=machine.columns)


def _row(measured: Floats, predicted: Floats, moves: Mask) -> dict[str, float]:
    good, error = np.isfinite(measured), predicted - measured
    size, spread = (float(f(measured[good])) if good.any() else np.nan for f in (rms, np.std))
    return {
        "rms": _share(error, good, 1.0),
        "nrmse": _share(error, good, size),
        "nrmse_std": _share(error, good, spread),
        "moving": _share(error, good & moves, size),
        "resting": _share(error, good & ~moves, size),
    }


def _share(error: Floats, rows: Mask, size: float) -> float:
    return rms(error[rows]) / size if rows.any() and size > 0.0 else np.nan
