"""Constant jerk and yaw acceleration (song2016 eq. 10): the paper's own model."""

from cwcli.prediction.models.base import polynomial

MODEL = polynomial("constant jerk and yaw acceleration", (True, True, True, True))
