"""State estimation: filter, smoother, latency, biases, consistency. Plain arrays in, plain arrays out."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cwcli.estimation.config import EstimatorConfig
    from cwcli.estimation.latency import Latency, LatencyStatus
    from cwcli.estimation.measurements import Kind, Measurements
    from cwcli.estimation.parameter import Parameter, ParameterStatus, SlowError
    from cwcli.estimation.result import SourceReport, Track
    from cwcli.estimation.track import estimate_track, estimate_tracks

MODULE_OF_NAME = {
    "EstimatorConfig": "config",
    "Kind": "measurements",
    "Latency": "latency",
    "LatencyStatus": "latency",
    "Measurements": "measurements",
    "Parameter": "parameter",
    "ParameterStatus": "parameter",
    "SlowError": "parameter",
    "SourceReport": "result",
    "Track": "result",
    "estimate_track": "track",
    "estimate_tracks": "track",
}
"""Public name -> module that defines it; a module is imported when its name is first used."""

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


def __getattr__(name: str) -> object:
    if name not in MODULE_OF_NAME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{MODULE_OF_NAME[name]}"), name)
