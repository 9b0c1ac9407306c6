"""Constant turn rate and speed: a steady bend."""

from cwcli.prediction.models.base import constant_derivatives_model

MODEL = constant_derivatives_model("constant turn rate and speed", (False, False, True, False))
