"""Columns of the parameter table, one row per axis: compile-time constants that :mod:`.parameters` fills.

The kernel allocates nothing; counting references (numba's ``_nrt``) took half of the time.
"""

from __future__ import annotations

from pinotwin.system.kernels import compiled

kernel = compiled(error_model="numpy", _nrt=False)
"""Decorator of every function of the kernel; such a function must not make an array."""

# Controller.
PID, KP, KV, KI, VFF, AFF, V_ALPHA, I_LIMIT, U_LIMIT, DELAY = range(10)
# Drive: current loop per substep and mean of its remaining step, flexible transmission.
U_ALPHA, U_MEAN, FLEXIBLE, SPRING, DAMPER, INV_ROTOR, BACKLASH, LOAD_ENCODER = range(10, 18)
# Friction.
LAW, BRISTLE, BRISTLE_DAMPER, LEVEL_P, LEVEL_N, STATIC, STRIBECK, VISCOUS = range(18, 26)
QUADRATIC, BY_LOAD, WARMING, WARMING_TIME, WANDER, WANDER_RATE, CHATTER = range(26, 33)
# Encoder.
RESOLUTION, ERROR, ERROR_RATE, ERROR_PHASE, PITCH = range(33, 38)
# Cable drag.
DRAG, DRAG_RATE, DRAG_SHARP = range(38, 41)
N_COLUMNS = 41

# Columns of the ripple table.
AMPLITUDE, WAVE, PHASE, MODULATION, MODULATION_PHASE, SPEED, RATE = range(7)
N_RIPPLE = 7

# Columns of the table of passive springs.
STIFFNESS, DAMPING, HARDENING, SLIP_LEVEL, SLIP_STIFFNESS = range(5)
N_SPRING = 5

# Friction laws.
NONE, LUGRE, GMS, ELASTOPLASTIC = range(4)

MAX_DELAY = 64  # longest delay of a loop [control periods]

ELEMENTS = 4  # elements of the generalised Maxwell-slip law

# States of friction: forces of the elements (the first is the deflection of a bristle), the drag of
# cables, and for each element the direction in which it slips, or 0.
CABLE = ELEMENTS
SLIPS = ELEMENTS + 1
N_STATES = 2 * ELEMENTS + 1
