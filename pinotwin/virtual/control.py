"""The sampled position controllers: cascade P-PI and PID, with feed-forward and anti-windup.

State of an axis: integral part [N or N·m], filtered rate (backward difference, first order), previous reading.
"""

from __future__ import annotations

from pinotwin.virtual import columns as c
from pinotwin.virtual.columns import kernel

INTEGRAL, RATE, PREVIOUS = range(3)
N_STATE = 3


@kernel
def control_step(P, i, s, command, q, period):  # type: ignore[no-untyped-def]
    """Return the effort of axis ``i`` by position, velocity, acceleration asked and ``q``; advance ``s``, (na, 3)."""
    qr, vr, ar = command
    e = qr - q
    pid = P[i, c.PID] > 0.5
    reading = e if pid else q
    s[i, RATE] += P[i, c.V_ALPHA] * ((reading - s[i, PREVIOUS]) / period - s[i, RATE])
    s[i, PREVIOUS] = reading
    if pid:
        u = P[i, c.KP] * e + P[i, c.KV] * s[i, RATE] + P[i, c.VFF] * vr
        growth = P[i, c.KI] * e * period
    else:
        slip = P[i, c.KP] * e + P[i, c.VFF] * vr - s[i, RATE]
        u = P[i, c.KV] * slip
        growth = P[i, c.KI] * slip * period
    u += P[i, c.AFF] * ar
    limit = P[i, c.U_LIMIT]
    total = u + s[i, INTEGRAL] + growth
    if not ((total > limit and growth > 0.0) or (total < -limit and growth < 0.0)):
        wanted = s[i, INTEGRAL] + growth
        s[i, INTEGRAL] = min(max(wanted, -P[i, c.I_LIMIT]), P[i, c.I_LIMIT])
    return min(max(u + s[i, INTEGRAL], -limit), limit)
