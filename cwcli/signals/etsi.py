"""ETSI cooperative awareness: `etsi_its_cam_msgs/CAM` (EN 302 637-2) and `etsi_its_cam_ts_msgs/CAM` (TS 103 900).

Codes after TS 102 894-2 (common data dictionary). docs/v2x.md shows the table; a test compares the two.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.angles import heading_from_compass_deg, wrap_angle
from cwcli.signals.columns import Columns
from cwcli.signals.covariances import (
    SIGMAS_PER_95_PERCENT_ELLIPSE_RADIUS,
    SIGMAS_PER_95_PERCENT_HALF_WIDTH,
    east_north_covariance_from_ellipse,
)
from cwcli.signals.leaf_fields import read_numbers
from cwcli.signals.quality import RowLedger
from cwcli.signals.v2x_codec import RemoteRows, Senders, V2xCodec, make_remote_rows
from cwcli.signals.v2x_elements import decode_codes_to_values, decode_enumeration, read_station_ids
from cwcli.signals.v2x_tables import (
    load_message_table,
    ros_leaf_fields_of_components,
    ros_leaf_path,
    ros_presence_paths,
)
from cwcli.signals.v2x_time import message_times_or_log_times_ns, stamps_ns_and_validity_from_generation_delta_time

_CAM_AND_VAM_QUANTITY_TABLE = load_message_table("cam", "etsi")
"""The quantities of a CAM and a VAM: their data elements, and their paths in each version."""
DATA_ELEMENTS_BY_CAM_OR_VAM_QUANTITY = _CAM_AND_VAM_QUANTITY_TABLE.elements
"""The data element of each coded quantity of a CAM or VAM (TS 102 894-2)."""
CAM_PATHS, VAM_PATHS = _CAM_AND_VAM_QUANTITY_TABLE.columns["cam"], _CAM_AND_VAM_QUANTITY_TABLE.columns["vam"]
"""The component of a CAM (EN 302 637-2) and of a VAM (TS 103 300-3), by quantity; a VAM has no size and no driving
direction."""
CAM_TS_PATHS = CAM_PATHS | _CAM_AND_VAM_QUANTITY_TABLE.columns["cam_ts"]
"""The component of a CAM of release 2 (TS 103 900), by quantity; two containers have other names inside."""
_PATHS_BY_QUANTITY_OF_EACH_MESSAGE_VERSION = (CAM_PATHS, CAM_TS_PATHS, VAM_PATHS)
"""The components in each version that has a ROS message."""
_ROS_LEAF_PATHS = {
    name: [ros_leaf_path(paths[name]) for paths in _PATHS_BY_QUANTITY_OF_EACH_MESSAGE_VERSION if name in paths]
    for name in CAM_PATHS
}
"""The leaf fields that can hold a quantity in the ROS messages."""
STATION_ID_PATHS = ("header.station_id.value", "header.station_id")
"""The paths of the station id in the ROS messages."""
YAW_RATE_95_PERCENT_BOUND_BY_CONFIDENCE_CODE_DEGPS: dict[int, float] = {
    0: 0.01,
    1: 0.05,
    2: 0.1,
    3: 1.0,
    4: 5.0,
    5: 10.0,
    6: 100.0,
}
"""The 95 % bound of a yaw rate in degrees/s, by code of YawRateConfidence; 7 is out of range, 8 unavailable."""
YAW_RATE_OUT_OF_RANGE_CODE = 7
"""The code of YawRateConfidence that says that the yaw rate can't be trusted."""
DRIVE_BACKWARD_CODE = 1
"""The code of DriveDirection for driving backward."""
ROADSIDE_UNIT_STATION_TYPE = 15
"""The station type of a roadside unit (TS 102 894-2)."""
CHOICE_INDEX_OF_VEHICLE_HIGH_FREQUENCY_CONTAINER = 0
"""The index of the vehicle's container among the high-frequency containers."""

UNTRUSTED_POSITION_REASON = "position confidence out of range"
"""The reason for rejecting a message whose position can't be trusted."""

CAM_LEAF_FIELDS, CAM_TS_LEAF_FIELDS, VAM_LEAF_FIELDS = map(
    ros_leaf_fields_of_components, _PATHS_BY_QUANTITY_OF_EACH_MESSAGE_VERSION
)
"""The leaf fields of each ROS message that are read."""


def identify_cam_senders(columns: Columns) -> Senders:
    """Return the senders of CAMs; roadside units are known by station type or high-frequency container."""
    station_type, container = (read_numbers(columns, *_ROS_LEAF_PATHS[name]) for name in ("station_type", "container"))
    return Senders(
        station=read_station_ids(columns, *STATION_ID_PATHS),
        is_own=np.zeros(len(columns), dtype=np.bool_),
        is_roadside=(station_type == ROADSIDE_UNIT_STATION_TYPE)
        | (container > CHOICE_INDEX_OF_VEHICLE_HIGH_FREQUENCY_CONTAINER),
    )


def decode_cam_or_vam(columns: Columns, ledger: RowLedger) -> RemoteRows:
    """Decode a CAM channel of either package, or a VAM channel.

    The heading of a CAM is that of the velocity (TS 102 894-2, HeadingValue). Driving backward, the vehicle's own
    heading is the opposite one and its speed negative: heading and speed together are still the velocity.

    A confidence of "out of range" says that its value is not valid and cannot be trusted: the value is left out, and
    for the position the whole message. Confidences are bounds for 95 %: sigma = bound / 1.96, and for the two axes of
    the position ellipse bound / 2.4477.

    Args:
        ledger: The channel's ledger; messages with an untrusted position are rejected here.

    Returns:
        Decoded rows.
    """
    raw = {name: read_numbers(columns, *leaves) for name, leaves in _ROS_LEAF_PATHS.items() if name != "station"}
    value = {
        name: decode_codes_to_values(element, raw[name], ledger)
        for name, element in DATA_ELEMENTS_BY_CAM_OR_VAM_QUANTITY.items()
    }
    read_station_ids(columns, *STATION_ID_PATHS, ledger=ledger)

    for name, confidence in (
        ("heading_compass_deg", "heading_95_deg"),
        ("speed_mps", "speed_95_mps"),
        ("accel_mps2", "accel_95_mps2"),
    ):
        value[name] = np.where(
            np.isin(raw[confidence], DATA_ELEMENTS_BY_CAM_OR_VAM_QUANTITY[confidence].out_of_range), np.nan, value[name]
        )
    yaw_untrusted = raw["yaw_rate_confidence"] == YAW_RATE_OUT_OF_RANGE_CODE
    value["yaw_rate_degps"] = np.where(yaw_untrusted, np.nan, value["yaw_rate_degps"])
    for name in ("yaw_rate_degps", "lateral_accel_mps2"):
        flags = [
            presence[name]
            for presence in map(ros_presence_paths, _PATHS_BY_QUANTITY_OF_EACH_MESSAGE_VERSION)
            if name in presence
        ]
        value[name] = np.where(read_numbers(columns, *flags) == 0, np.nan, value[name])
    untrusted = np.isin(raw["semi_major_m"], DATA_ELEMENTS_BY_CAM_OR_VAM_QUANTITY["semi_major_m"].out_of_range)
    untrusted |= np.isin(raw["semi_minor_m"], DATA_ELEMENTS_BY_CAM_OR_VAM_QUANTITY["semi_minor_m"].out_of_range)
    ledger.reject(untrusted, UNTRUSTED_POSITION_REASON)

    yaw_rate_95_degps = decode_enumeration(
        YAW_RATE_95_PERCENT_BOUND_BY_CONFIDENCE_CODE_DEGPS, raw["yaw_rate_confidence"]
    )
    is_backward = raw["drive_direction"] == DRIVE_BACKWARD_CODE
    motion_rad = heading_from_compass_deg(value["heading_compass_deg"])
    stamp_ns, has_time = stamps_ns_and_validity_from_generation_delta_time(
        raw["generation_delta_time"], columns.log_time_ns
    )
    return make_remote_rows(
        message_times_or_log_times_ns(ledger, stamp_ns, has_time),
        value,
        speed_mps=np.where(is_backward, -value["speed_mps"], value["speed_mps"]),
        heading_rad=np.where(is_backward, wrap_angle(motion_rad + np.pi), motion_rad),
        yaw_rate_radps=np.deg2rad(value["yaw_rate_degps"]),
        position_covariance_m2=east_north_covariance_from_ellipse(
            value["semi_major_m"] / SIGMAS_PER_95_PERCENT_ELLIPSE_RADIUS,
            value["semi_minor_m"] / SIGMAS_PER_95_PERCENT_ELLIPSE_RADIUS,
            value["semi_major_compass_deg"],
        ),
        speed_sigma_mps=value["speed_95_mps"] / SIGMAS_PER_95_PERCENT_HALF_WIDTH,
        heading_sigma_rad=np.deg2rad(value["heading_95_deg"]) / SIGMAS_PER_95_PERCENT_HALF_WIDTH,
        accel_sigma_mps2=value["accel_95_mps2"] / SIGMAS_PER_95_PERCENT_HALF_WIDTH,
        yaw_rate_sigma_radps=np.deg2rad(yaw_rate_95_degps) / SIGMAS_PER_95_PERCENT_HALF_WIDTH,
    )


CAM_AND_VAM_CODEC = V2xCodec(identify_cam_senders, decode_cam_or_vam)
"""The codec of ROS channels of CAMs and VAMs."""
