"""Columns of a state (n, 8), in the order of `cwcli.v1.VehicleState`."""

X, Y, SPEED, HEADING, ACCEL, YAW_RATE, JERK, YAW_ACCEL = range(8)
DERIVATIVES = (ACCEL, JERK, YAW_RATE, YAW_ACCEL)  # in the order of a model's responses
