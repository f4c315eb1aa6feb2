"""What the motor's own equation does not show: the servo, the second encoder, vibration, tracking error."""
