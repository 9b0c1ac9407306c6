"""Constant acceleration and heading: straight driving with the pedal held."""

from cwcli.prediction.models.base import polynomial

MODEL = polynomial("constant acceleration and heading", (True, False, False, False))
