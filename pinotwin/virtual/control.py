"""The sampled position controllers: cascade P-PI and PID, with feed-forward and anti-windup.

State of an axis, one row: integral part [N or N·m], filtered rate, previous reading.
The rate is a backward difference through a first-order filter, as in a drive. The integral part stands
still while the effort is saturated in the same direction, and never leaves its own limit.
"""

from __future__ import annotations

from numba import njit

from pinotwin.virtual import columns as c

INTEGRAL, RATE, PREVIOUS = range(3)
N_STATE = 3


@njit(cache=True)
def control_step(P, s, qr, vr, ar, q, period):  # type: ignore[no-untyped-def]
    """Return the effort command of one axis and advance its controller.

    Args:
        P: row of the parameter table.
        s: state of the controller, shape (3,); changed.
        qr: commanded position; ``vr`` and ``ar`` its derivatives.
        vr: commanded velocity.
        ar: commanded acceleration.
        q: measured position.
        period: control period [s].
    """
    e = qr - q
    pid = P[c.PID] > 0.5
    reading = e if pid else q
    s[RATE] += P[c.V_ALPHA] * ((reading - s[PREVIOUS]) / period - s[RATE])
    s[PREVIOUS] = reading
    if pid:
        u = P[c.KP] * e + P[c.KV] * s[RATE] + P[c.VFF] * vr
        growth = P[c.KI] * e * period
    else:
        slip = P[c.KP] * e + P[c.VFF] * vr - s[RATE]
        u = P[c.KV] * slip
        growth = P[c.KI] * slip * period
    u += P[c.AFF] * ar
    limit = P[c.U_LIMIT]
    total = u + s[INTEGRAL] + growth
    if not ((total > limit and growth > 0.0) or (total < -limit and growth < 0.0)):
        wanted = s[INTEGRAL] + growth
        s[INTEGRAL] = min(max(wanted, -P[c.I_LIMIT]), P[c.I_LIMIT])
    return min(max(u + s[INTEGRAL], -limit), limit)
