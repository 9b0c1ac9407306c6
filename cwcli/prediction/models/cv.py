"""Constant speed and heading (song2016 eq. 9): the baseline that every other model has to beat."""

from cwcli.prediction.models.base import constant_derivatives_model

MODEL = constant_derivatives_model("constant speed and heading", (False, False, False, False))
