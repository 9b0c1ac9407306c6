"""The states of one car in the log of another: on its map, on its clock, as a remote vehicle."""

from __future__ import annotations

import numpy as np

from cwcli.channels.vehicle_state import VehicleStates
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray, Int64Array, concat_strings, median_of_values, repeat_string
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.normal_distribution import SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION
from cwcli.signals.units import NS_PER_MS, NS_PER_S
from cwcli.signals.vehicle_state import HEADING

STEP_TO_CONVERT_HEADING_M = 1.0
"""Distance along the heading that is converted with a position to get its heading on the other map, m; chosen."""
GNSS_EPOCH_INTERVAL_NS = 10 * NS_PER_MS
"""Interval of GNSS epochs, ns: common receivers measure at multiples of 10 ms from the whole second."""
MAX_STAMP_OFFSET_FROM_GNSS_EPOCH_NS = 2 * NS_PER_MS
"""Greatest difference, ns, of the stamps of 95 % of the positions from whole epochs. Chosen by hand."""


@dataclass(frozen=True)
class RecorderClock:
    """Offset between a recorder's clock and the clock of the positions in its log.

    Attributes:
        ahead_ns: Median of log time minus stamp: offset of the clock plus delay of the positions.
        sigma_ns: Standard deviation of one difference, from the median absolute deviation.
        is_on_epochs: The stamps are whole epochs of GNSS time; otherwise they may be times of the computer.
    """

    ahead_ns: int
    sigma_ns: int
    n: int
    is_on_epochs: bool


def estimate_recorder_clock_offset(stamp_ns: Int64Array, log_time_ns: Int64Array) -> RecorderClock:
    """Estimate the offset of a recorder's clock from stamps and log times (n,) of at least one position."""
    late_ns = log_time_ns - stamp_ns
    ahead_ns = int(median_of_values(late_ns))
    sigma_ns = int(SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION * median_of_values(np.abs(late_ns - ahead_ns)))
    phase_ns = (stamp_ns + GNSS_EPOCH_INTERVAL_NS // 2) % GNSS_EPOCH_INTERVAL_NS - GNSS_EPOCH_INTERVAL_NS // 2
    is_on_epochs = bool(np.percentile(np.abs(phase_ns), 95) <= MAX_STAMP_OFFSET_FROM_GNSS_EPOCH_NS)
    return RecorderClock(ahead_ns, sigma_ns, len(stamp_ns), is_on_epochs)


def move_states_to_our_map_and_clock(
    states: VehicleStates, theirs: LocalMap, ours: LocalMap, *, name: str, stamp_shift_ns: int, log_shift_ns: int
) -> VehicleStates:
    """Convert a car's states and covariances to another map and clock.

    Two local maps with different origins are rotated against each other (convergence of the meridians), so headings and
    covariances are rotated with the positions.

    Args:
        states: Of one car, on its own map.
        theirs, ours: The car's map, and the one that the states are to be on.
        name: The car's id there.
        stamp_shift_ns, log_shift_ns: Added to the stamps, and to the log times.
    """
    x_m, y_m, heading_rad = states.state[:, 0], states.state[:, 1], states.state[:, HEADING]
    xy_in_our_map_m = np.column_stack(_convert_positions_between_maps_m(theirs, ours, x_m, y_m))
    ahead = _convert_positions_between_maps_m(
        theirs,
        ours,
        x_m + STEP_TO_CONVERT_HEADING_M * np.cos(heading_rad),
        y_m + STEP_TO_CONVERT_HEADING_M * np.sin(heading_rad),
    )
    turned_rad = np.arctan2(ahead[1] - xy_in_our_map_m[:, 1], ahead[0] - xy_in_our_map_m[:, 0])
    by_rad = np.remainder(turned_rad - heading_rad + np.pi, 2.0 * np.pi) - np.pi
    state = states.state.copy()
    state[:, :2] = xy_in_our_map_m
    state[:, HEADING] = heading_rad + by_rad
    n = len(states)
    return VehicleStates(
        ids=repeat_string(name, n),
        stamp_ns=states.stamp_ns + stamp_shift_ns,
        log_time_ns=states.log_time_ns + log_shift_ns,
        state=state,
        covariance=_rotate_covariance(np.asarray(states.covariance), by_rad),
        length_m=states.length_m,
        width_m=states.width_m,
        flags=states.flags,
    )


def merge_states_by_log_time(first: VehicleStates, second: VehicleStates) -> VehicleStates:
    """Concatenate the states of several vehicles in the order of their log times."""
    columns = {
        name: np.concatenate([np.asarray(getattr(first, name)), np.asarray(getattr(second, name))])
        for name in VehicleStates.__dataclass_fields__
        if name != "ids"
    }
    merged = VehicleStates(ids=concat_strings([first.ids, second.ids]), **columns)
    return merged.select_rows(np.argsort(merged.log_time_ns, kind="stable"))


def recorder_clock_difference_text(offset_ns: int, ours: RecorderClock, theirs: RecorderClock) -> str:
    """A sentence on how far the clocks of two recorders differ."""
    sigma_ns = float(np.hypot(ours.sigma_ns, theirs.sigma_ns))
    return (
        f"the other car's recorder is {abs(offset_ns) / NS_PER_S:.3f} s {'ahead of' if offset_ns >= 0 else 'behind'} "
        f"this one's (scatter {sigma_ns / NS_PER_S:.3f} s), by the stamps of {ours.n} and {theirs.n} positions"
    )


def _convert_positions_between_maps_m(
    theirs: LocalMap, ours: LocalMap, x_m: FloatArray, y_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Convert positions (n,) from one map to another; different heights of the maps are bridged vertically."""
    latitude_deg, longitude_deg, _ = theirs.wgs84_from_map(x_m, y_m, np.zeros(len(x_m)))
    x, y, _ = ours.map_from_wgs84(latitude_deg, longitude_deg, np.full(len(x_m), np.nan))
    return x, y


def _rotate_covariance(covariance: FloatArray, by_rad: FloatArray) -> FloatArray:
    """Rotate the first two states of covariances (n, k, k) by one angle each, (n,)."""
    turn = np.broadcast_to(np.eye(covariance.shape[1]), covariance.shape).copy()
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(by_rad)
    turn[:, 1, 0] = np.sin(by_rad)
    turn[:, 0, 1] = -turn[:, 1, 0]
    rotated = turn @ covariance @ turn.transpose(0, 2, 1)
    return 0.5 * (rotated + rotated.transpose(0, 2, 1))
