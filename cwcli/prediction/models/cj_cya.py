"""Constant jerk and yaw acceleration (song2016 eq. 10): the paper's own model."""

from cwcli.prediction.models.base import constant_derivatives_model

MODEL = constant_derivatives_model("constant jerk and yaw acceleration", (True, True, True, True))
