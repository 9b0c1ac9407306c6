"""The motion models: one file each, and one line here. Other packages add theirs in the group `cwcli.motion_models`."""

from __future__ import annotations

from cwcli.prediction.models import onset
from cwcli.prediction.models.base import Model, check_responses, check_trust_in_derivatives
from cwcli.registry import Registry, accept_dataclass_of

HYPOTHETICAL_MODELS: dict[str, Model] = {
    "onset": onset.MODEL,
}
"""Models of what may happen rather than of what is likeliest; they are not compared with the actual positions."""

MODELS: Registry[Model] = Registry(
    "motion model",
    "cwcli.motion_models",
    {
        "auto": "cwcli.prediction.models.auto:MODEL",
        "cv": "cwcli.prediction.models.cv:MODEL",
        "ca": "cwcli.prediction.models.ca:MODEL",
        "ctrv": "cwcli.prediction.models.ctrv:MODEL",
        "ctra": "cwcli.prediction.models.ctra:MODEL",
        "cj-cya": "cwcli.prediction.models.cj_cya:MODEL",
    },
    accept_dataclass_of(Model, {"responses": check_responses, "trust": check_trust_in_derivatives}),
    reserved_names=(*HYPOTHETICAL_MODELS, "lateral", "lateral-zhang2011"),
)
DEFAULT_MODEL = "auto"
"""Name of the model that is used where the user names none."""
