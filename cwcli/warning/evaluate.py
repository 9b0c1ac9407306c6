"""Warnings of one host against the other vehicles, at every state of the host."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cwcli.warning.types import ActualTrack, VehicleTrack, WarningConfig, WarningResult


def evaluate(
    host: VehicleTrack,
    others: Sequence[VehicleTrack],
    config: WarningConfig | None = None,
    *,
    actual: Mapping[str, ActualTrack] | None = None,
) -> WarningResult:
    """Evaluate a rule at every stamp of the host.

    Args:
        host: The vehicle that is warned.
        others: The vehicles it hears of.
        config: Options; None: the defaults.
        actual: Vehicle id -> what it really did, for the scores; who is missing is taken from `VehicleTrack.state`.

    Raises:
        UsageError: Unknown rule, a threshold out of range, or host paths shorter than the horizon.
    """
    raise NotImplementedError
