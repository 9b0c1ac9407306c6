"""State estimation: filter, smoother, latency, biases, consistency. Plain arrays in, plain arrays out."""

from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.latency import Latency, LatencyStatus
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.parameter import Parameter, ParameterStatus, SlowError
from cwcli.estimation.result import SourceReport, Track
from cwcli.estimation.track import estimate_track, estimate_tracks

__all__ = [
    "EstimatorConfig",
    "Kind",
    "Latency",
    "LatencyStatus",
    "Measurements",
    "Parameter",
    "ParameterStatus",
    "SlowError",
    "SourceReport",
    "Track",
    "estimate_track",
    "estimate_tracks",
]
