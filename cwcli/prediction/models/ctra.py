"""Constant turn rate and acceleration (song2016 eq. 2)."""

from cwcli.prediction.models.base import polynomial

MODEL = polynomial("constant turn rate and acceleration", (True, False, True, False))
