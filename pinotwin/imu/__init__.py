"""IMU processing on NumPy arrays: orientation, clocks, alignment, noise, deflection.

Usable alone: nothing here needs a Machine. Import from the modules, e.g.
``from pinotwin.imu.batch import estimate``.
"""
