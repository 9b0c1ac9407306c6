"""NovAtel's BESTPOS, BESTVEL, INSPVA and INSPVAX, as `novatel_oem7_msgs` and `novatel_gps_msgs` have them.

The time is that of the header; where there is none, GPS week and time of week. Heights are above the geoid, and the
undulation is that of the geoid above the ellipsoid. An azimuth is the vehicle's, not that of its way over ground.
"""

from __future__ import annotations

import numpy as np

from cwcli.lazy_dataclass import replace
from cwcli.signals.builders.gnss import (
    GnssFix,
    covariance_of_east_north_sigmas,
    heading_from_compass_or_nan,
    velocity_from_speed_and_course,
)
from cwcli.signals.columns import BoolArray, Columns, StampsNsAndIsGiven, Strings
from cwcli.signals.gnss_time import utc_ns_and_is_time_from_gps_weeks
from cwcli.signals.leaf_fields import accepted_text_mask, find_field, read_numbers, read_stamps
from cwcli.signals.quality import RowLedger
from cwcli.signals.units import NS_PER_S

SOLUTION_COMPUTED_CODE, NO_SOLUTION_TYPE_CODE = 0, 0
"""The codes of a computed solution and of no solution type (NovAtel OEM7 manual)."""
USABLE_INS_STATUSES = {
    2: "ins_high_variance",
    3: "ins_solution_good",
    6: "ins_solution_free",
    7: "ins_alignment_complete",
}
"""The usable statuses of an inertial solution, as number (OEM7) and as word (OEM6)."""
MAX_VELOCITY_LATENCY_S = 2.0
"""The largest latency of a velocity that is believed, in seconds. Chosen by hand; not fitted."""


def read_bestpos(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read positions of BESTPOS."""
    return GnssFix(
        *_read_stamps_or_gps_time_and_is_usable(columns, ledger),
        is_fix=_computed_solution_mask(columns, "pos_type.type", "position_type"),
        latitude_deg=read_numbers(columns, "lat"),
        longitude_deg=read_numbers(columns, "lon"),
        altitude_m=read_numbers(columns, "hgt", "height") + read_numbers(columns, "undulation"),
        position_covariance_m2=covariance_of_east_north_sigmas(
            read_numbers(columns, "lon_stdev", "lon_sigma"), read_numbers(columns, "lat_stdev", "lat_sigma")
        ),
    )


def read_bestvel(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read velocities of BESTVEL; each was measured `latency` seconds before its time."""
    stamp_ns, has_stamp = _read_stamps_or_gps_time_and_is_usable(columns, ledger)
    latency_s = read_numbers(columns, "latency")
    is_late = (latency_s >= 0.0) & (latency_s <= MAX_VELOCITY_LATENCY_S)
    late_ns = np.round(np.where(is_late, latency_s, 0.0) * NS_PER_S).astype(np.int64)
    return GnssFix(
        stamp_ns - late_ns,
        has_stamp,
        is_fix=_computed_solution_mask(columns, "vel_type.type", "velocity_type"),
        velocity_mps=velocity_from_speed_and_course(
            read_numbers(columns, "hor_speed", "horizontal_speed"), read_numbers(columns, "trk_gnd", "track_ground")
        ),
    )


def read_inspvax(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read position, velocity and heading of INSPVAX."""
    north, east = read_numbers(columns, "north_velocity"), read_numbers(columns, "east_velocity")
    sigma = {
        name: read_numbers(columns, f"{name}_stdev", f"{name}_std")
        for name in ("latitude", "longitude", "north_velocity", "east_velocity", "azimuth")
    }
    with np.errstate(over="ignore"):
        return GnssFix(
            *_read_stamps_or_gps_time_and_is_usable(columns, ledger),
            is_fix=_accepted_status_mask(columns, "ins_status", USABLE_INS_STATUSES),
            latitude_deg=read_numbers(columns, "latitude"),
            longitude_deg=read_numbers(columns, "longitude"),
            altitude_m=read_numbers(columns, "height", "altitude") + read_numbers(columns, "undulation"),
            position_covariance_m2=covariance_of_east_north_sigmas(sigma["longitude"], sigma["latitude"]),
            velocity_mps=np.stack([east, north], axis=1),
            velocity_covariance_m2ps2=covariance_of_east_north_sigmas(sigma["east_velocity"], sigma["north_velocity"]),
            heading_rad=heading_from_compass_or_nan(read_numbers(columns, "azimuth")),
            heading_variance_rad2=np.deg2rad(sigma["azimuth"]) ** 2,
        )


def read_inspva(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read INSPVA, which is INSPVAX without sigmas and with the height above the ellipsoid."""
    return replace(
        read_inspvax(columns, ledger),
        is_fix=_accepted_status_mask(columns, "status", USABLE_INS_STATUSES),
        altitude_m=read_numbers(columns, "height"),
    )


def _read_stamps_or_gps_time_and_is_usable(columns: Columns, ledger: RowLedger) -> StampsNsAndIsGiven:
    stamp_ns, has_stamp = read_stamps(columns)
    week = read_numbers(columns, "nov_header.gps_week_number", "novatel_msg_header.gps_week_num")
    milliseconds = read_numbers(columns, "nov_header.gps_week_milliseconds")
    milliseconds = np.where(
        np.isnan(milliseconds), 1e3 * read_numbers(columns, "novatel_msg_header.gps_seconds"), milliseconds
    )
    gps_ns, is_time = utc_ns_and_is_time_from_gps_weeks(ledger, week, milliseconds, ~has_stamp & (week > 0))
    return np.where(has_stamp, stamp_ns, gps_ns), has_stamp | is_time


def _computed_solution_mask(columns: Columns, *type_names: str) -> BoolArray:
    """Return where the receiver has computed a solution (n,)."""
    is_computed = _accepted_status_mask(
        columns, "sol_status", {SOLUTION_COMPUTED_CODE: "sol_computed"}, "solution_status"
    )
    kind = find_field(columns, *type_names)
    if isinstance(kind, Strings):
        return is_computed & ~accepted_text_mask(kind, len(columns), "none", "")
    return is_computed & (read_numbers(columns, *type_names) > NO_SOLUTION_TYPE_CODE)


def _accepted_status_mask(columns: Columns, name: str, accepted: dict[int, str], *word_paths: str) -> BoolArray:
    field = find_field(columns, name, *word_paths)
    if isinstance(field, Strings):
        return accepted_text_mask(field, len(columns), *accepted.values())
    return np.isin(read_numbers(columns, f"{name}.status"), list(accepted))
