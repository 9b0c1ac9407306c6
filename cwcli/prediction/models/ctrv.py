"""Constant turn rate and speed: a steady bend."""

from cwcli.prediction.models.base import polynomial

MODEL = polynomial("constant turn rate and speed", (False, False, True, False))
