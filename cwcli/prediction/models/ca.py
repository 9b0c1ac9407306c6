"""Constant acceleration and heading: straight driving with the pedal held."""

from cwcli.prediction.models.base import constant_derivatives_model

MODEL = constant_derivatives_model("constant acceleration and heading", (True, False, False, False))
