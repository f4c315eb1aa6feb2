"""IMU processing on NumPy arrays: orientation, clocks, alignment, noise, and the deflection of a joint.

Usable alone: nothing here needs a Machine. Import from the modules, e.g.
``from pinotwin.imu.batch import estimate``.
"""
