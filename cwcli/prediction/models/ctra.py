"""Constant turn rate and acceleration (song2016 eq. 2)."""

from cwcli.prediction.models.base import constant_derivatives_model

MODEL = constant_derivatives_model("constant turn rate and acceleration", (True, False, True, False))
