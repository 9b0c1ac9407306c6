"""The motion models: one file each, and one line here."""

from __future__ import annotations

from cwcli.prediction.models import auto, ca, cj_cya, ctra, ctrv, cv, onset
from cwcli.prediction.models.base import Model

MODELS: dict[str, Model] = {
    "auto": auto.MODEL,
    "cv": cv.MODEL,
    "ca": ca.MODEL,
    "ctrv": ctrv.MODEL,
    "ctra": ctra.MODEL,
    "cj-cya": cj_cya.MODEL,
}
DEFAULT_MODEL = "auto"

HYPOTHESES: dict[str, Model] = {
    "onset": onset.MODEL,
}
"""What may be, rather than what is likeliest: rolled out like a model, but not compared with what then happened."""
