"""IMU processing on NumPy arrays, without a Machine: orientation, clocks, alignment, noise, deflection."""
