"""NovAtel's BESTPOS, BESTVEL, INSPVA and INSPVAX, as `novatel_oem7_msgs` and `novatel_gps_msgs` have them.

The time is that of the header; where there is none, GPS week and time of week. Heights are above the geoid, and the
undulation is that of the geoid above the ellipsoid. An azimuth is the vehicle's, not that of its way over ground.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cwcli.signals.builders.gnss import (
    GnssFix,
    axes_covariance,
    heading_builder,
    heading_of_compass,
    position_builder,
    velocity_builder,
    velocity_of_course,
)
from cwcli.signals.columns import Columns, Int64Array, Strings
from cwcli.signals.gnss_time import utc_of_weeks
from cwcli.signals.leaf_fields import find, is_one_of, numbers, stamps
from cwcli.signals.quality import BoolArray, RowLedger
from cwcli.signals.units import NS_PER_S

COMPUTED, NO_TYPE = 0, 0
"""The codes of a computed solution and of no solution type (NovAtel OEM7 manual)."""
INS_GOOD = {2: "ins_high_variance", 3: "ins_solution_good", 6: "ins_solution_free", 7: "ins_alignment_complete"}
"""The usable statuses of an inertial solution, as number (OEM7) and as word (OEM6)."""
MAX_VELOCITY_LATENCY_S = 2.0
"""The largest latency of a velocity that is believed, in seconds. Chosen by hand; not fitted."""


def read_best_pos(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read positions of BESTPOS."""
    return GnssFix(
        *_stamps(columns, ledger),
        is_fix=_is_computed(columns, "pos_type.type", "position_type"),
        latitude_deg=numbers(columns, "lat"),
        longitude_deg=numbers(columns, "lon"),
        altitude_m=numbers(columns, "hgt", "height") + numbers(columns, "undulation"),
        position_covariance_m2=axes_covariance(
            numbers(columns, "lon_stdev", "lon_sigma"), numbers(columns, "lat_stdev", "lat_sigma")
        ),
    )


def read_best_vel(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read velocities of BESTVEL; each was measured `latency` seconds before its time."""
    stamp_ns, has_stamp = _stamps(columns, ledger)
    latency_s = numbers(columns, "latency")
    is_late = (latency_s >= 0.0) & (latency_s <= MAX_VELOCITY_LATENCY_S)
    late_ns = np.round(np.where(is_late, latency_s, 0.0) * NS_PER_S).astype(np.int64)
    return GnssFix(
        stamp_ns - late_ns,
        has_stamp,
        is_fix=_is_computed(columns, "vel_type.type", "velocity_type"),
        velocity_mps=velocity_of_course(
            numbers(columns, "hor_speed", "horizontal_speed"), numbers(columns, "trk_gnd", "track_ground")
        ),
    )


def read_ins(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read position, velocity and heading of INSPVAX."""
    north, east = numbers(columns, "north_velocity"), numbers(columns, "east_velocity")
    sigma = {
        name: numbers(columns, f"{name}_stdev", f"{name}_std")
        for name in ("latitude", "longitude", "north_velocity", "east_velocity", "azimuth")
    }
    with np.errstate(over="ignore"):
        return GnssFix(
            *_stamps(columns, ledger),
            is_fix=_has_status(columns, "ins_status", INS_GOOD),
            latitude_deg=numbers(columns, "latitude"),
            longitude_deg=numbers(columns, "longitude"),
            altitude_m=numbers(columns, "height", "altitude") + numbers(columns, "undulation"),
            position_covariance_m2=axes_covariance(sigma["longitude"], sigma["latitude"]),
            velocity_mps=np.stack([east, north], axis=1),
            velocity_covariance_m2ps2=axes_covariance(sigma["east_velocity"], sigma["north_velocity"]),
            heading_rad=heading_of_compass(numbers(columns, "azimuth")),
            heading_variance_rad2=np.deg2rad(sigma["azimuth"]) ** 2,
        )


def read_inspva(columns: Columns, ledger: RowLedger) -> GnssFix:
    """Read INSPVA, which is INSPVAX without sigmas and with the height above the ellipsoid."""
    return replace(
        read_ins(columns, ledger),
        is_fix=_has_status(columns, "status", INS_GOOD),
        altitude_m=numbers(columns, "height"),
    )


build_position = position_builder(read_best_pos)
build_velocity = velocity_builder(read_best_vel)
build_ins_position = position_builder(read_ins)
build_ins_velocity = velocity_builder(read_ins)
build_ins_heading = heading_builder(read_ins)
build_inspva_position = position_builder(read_inspva)
build_inspva_velocity = velocity_builder(read_inspva)
build_inspva_heading = heading_builder(read_inspva)


def _stamps(columns: Columns, ledger: RowLedger) -> tuple[Int64Array, BoolArray]:
    stamp_ns, has_stamp = stamps(columns)
    week = numbers(columns, "nov_header.gps_week_number", "novatel_msg_header.gps_week_num")
    milliseconds = numbers(columns, "nov_header.gps_week_milliseconds")
    milliseconds = np.where(
        np.isnan(milliseconds), 1e3 * numbers(columns, "novatel_msg_header.gps_seconds"), milliseconds
    )
    gps_ns, is_time = utc_of_weeks(ledger, week, milliseconds, ~has_stamp & (week > 0))
    return np.where(has_stamp, stamp_ns, gps_ns), has_stamp | is_time


def _is_computed(columns: Columns, *type_names: str) -> BoolArray:
    """Return where the receiver has computed a solution (n,)."""
    is_computed = _has_status(columns, "sol_status", {COMPUTED: "sol_computed"}, "solution_status")
    kind = find(columns, *type_names)
    if isinstance(kind, Strings):
        return is_computed & ~is_one_of(kind, len(columns), "none", "")
    return is_computed & (numbers(columns, *type_names) > NO_TYPE)


def _has_status(columns: Columns, name: str, accepted: dict[int, str], *words: str) -> BoolArray:
    field = find(columns, name, *words)
    if isinstance(field, Strings):
        return is_one_of(field, len(columns), *accepted.values())
    return np.isin(numbers(columns, f"{name}.status"), list(accepted))
