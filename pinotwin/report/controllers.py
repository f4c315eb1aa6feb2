"""The gains of the identified controllers in a report, and which of them the log determines."""

from __future__ import annotations

from collections.abc import Mapping

from pinotwin.loop.servo import SHAPES, Servo
from pinotwin.report.blocks import Html, chip, table


def servo_table(servos: Mapping[str, Servo]) -> Html:
    """Return the gains and lags of the controllers that are simulated, with their 90 % intervals.

    Where kp and 1/ti are not determined one by one, their sum and product stand below them.
    """
    rows: list[list[object]] = []
    for axis, servo in servos.items():
        told, determined = servo.intervals(), servo.determined()
        both = {k: x for k, x in servo.combined().items() if k in told and not _each(servo, determined)}
        for name, value in {**servo.named(), **both}.items():
            factor, unit = (1e3, "ms") if name in SHAPES else (1.0, "")
            low, high = (factor * x for x in told.get(name, (value, value)))
            between = f"{low:.4g} to {high:.4g}" if high > low else ""
            first = all(row[0] != axis for row in rows)
            shown = f"{factor * value:.4g} {unit}".strip()
            remark = _remark(servo, name, determined)
            rows.append([axis if first else "", _SERVO.get(name, name), shown, between, remark])
    return table(("axis", "gain", "value", "90 % interval", ""), rows, numeric=(2, 3))


def _each(servo: Servo, determined: Mapping[str, bool]) -> bool:
    """Whether each of the gains that a combination is made of is determined by itself."""
    return all(determined.get(name, True) for name in (("ffv",) if servo.form == "pid" else ("kp", "rate")))


def _remark(servo: Servo, name: str, determined: Mapping[str, bool]) -> Html:
    if determined.get(name, True):
        return chip("determined", "good", "within a tenth of itself") if name in determined else Html("")
    if name in ("kp", "rate") and servo.tied:
        return chip(
            "tied", "fair", f"or {servo.other[name]:.4g}: kp and 1/ti the other way round fit as well"
        )
    return chip("not determined", "fair", "its interval is wider than a tenth of it on either side")


_SERVO = {
    "kp": "position gain kp",
    "kv": "velocity gain kv",
    "rate": "1/ti",
    "ki": "integral gain ki",
    "kd": "derivative gain kd",
    "ffv": "velocity feed-forward",
    "ffa": "acceleration feed-forward",
    "weight": "set-point weight",
    "velocity_lag": "lag of the velocity",
    "output_lag": "lag of the current loop",
    "dead": "dead time",
    "kp + rate": "kp + 1/ti",
    "kp * rate": "kp / ti",
    "kd + ffv": "kd + ffv",
}
