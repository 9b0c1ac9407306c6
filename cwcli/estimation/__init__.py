"""State estimation: filter, smoother, latency, biases, consistency. Plain arrays in, plain arrays out."""

from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.track import STATE_NAMES, SourceReport, Track, estimate_track, estimate_tracks

__all__ = [
    "STATE_NAMES",
    "EstimatorConfig",
    "Kind",
    "Measurements",
    "SourceReport",
    "Track",
    "estimate_track",
    "estimate_tracks",
]
