"""The estimator's settings: one set of defaults for every log; what differs is found from the log itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

ModelName = Literal["cwcli", "song2016"]
LatencyOption = Literal["auto", "none"] | Mapping[str, float]


@dataclass(frozen=True)
class EstimatorConfig:
    """Settings of `estimate_track`.

    Attributes:
        model: "cwcli" (eight states, asynchronous sensors, biases) or "song2016" (the paper's six states and
            synchronous measurement vector, eq. 1-8).
        causal: The filter alone, without the smoother: an estimate uses nothing that was measured later.
        latency: "auto" finds each source's latency from the log; "none" trusts the stamps; a mapping from
            source (or "source:kind", e.g. "/gps/vel:velocity") to seconds fixes those and finds the others.
            Positive means late: true time = stamp - latency.
        gate_probability: Probability with which the gate keeps a measurement that fits the model; 1 = off.
        reset_after: Consecutive rejections of one source after which its next measurement is believed.
        rate_hz: Grid of the output when `estimate_track` gets no output stamps.
        song2016_step_s: Sampling time of the six-state filter (dT of eq. 2).
    """

    model: ModelName = "cwcli"
    causal: bool = False
    latency: LatencyOption = field(default="auto")
    gate_probability: float = 0.999
    reset_after: int = 20
    rate_hz: float = 20.0
    song2016_step_s: float = 0.05
