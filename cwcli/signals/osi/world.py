"""The moving objects of an OSI GroundTruth: which one is the host, and how each one moves.

`base.position` is the centre of the bounding box, `base.velocity` and `base.acceleration` are in the axes of the world,
not of the object. A field that a simulator leaves out is 0, which is no value: an object that moves without a velocity,
or that drives sideways because its yaw is always 0, has none.
Source: ASAM OSI 3.8.0, osi_object.proto, osi_common.proto.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.angles import wrap_angle
from cwcli.signals.builders.base import Reading
from cwcli.signals.columns import (
    BoolArray,
    Columns,
    FloatArray,
    Int64Array,
    Ragged,
    StampsNsAndIsGiven,
    Strings,
    sort_distinct_values,
)
from cwcli.signals.elements import Elements, find_ragged_field
from cwcli.signals.leaf_fields import find_field, read_integers
from cwcli.signals.limits import (
    MAX_ACCEL_MPS2,
    MAX_ANGLE_RAD,
    MAX_COORDINATE_M,
    MAX_ROAD_USER_SIZE_M,
    MAX_SPEED_MPS,
    MAX_TURN_RATE_RADPS,
)
from cwcli.signals.osi.leaves import GROUND_TRUTH_PATH_PREFIX_IN_SENSOR_VIEW, PROJECTION_FIELD, STATIONARY_OBJECT_FIELD
from cwcli.signals.quality import RowLedger
from cwcli.signals.role import Role
from cwcli.signals.units import NS_PER_S

OSI_FRAME = "osi"
"""The name of the frame of all positions in OSI messages: the axes of the simulated world."""
VEHICLE_TYPE_CODE = 2
"""The code of `MovingObject.Type.MOVING_OBJECT_TYPE_VEHICLE`."""
MIN_DISTANCE_TRAVELLED_BY_MOVING_OBJECT_M = 1.0
"""The distance in metres from which an object counts as moving. Chosen by hand; not fitted."""
MIN_COURSE_SPEED_MPS = 0.3
"""The speed in m/s above which an object's velocity says where it is heading. Chosen by hand; not fitted."""
MAX_SINE_OF_ANGLE_FROM_VEHICLE_AXIS_TO_MOTION = 0.7
"""Greatest sine of the angle between the motion and the axis of a vehicle: that of 45 degrees. Chosen by hand."""
OBJECT_FIELDS_AND_MAX_MAGNITUDE_BY_QUANTITY = {
    "yaw": (("base.orientation.yaw",), MAX_ANGLE_RAD),
    "velocity": (("base.velocity.x", "base.velocity.y"), MAX_SPEED_MPS),
    "acceleration": (("base.acceleration.x", "base.acceleration.y"), MAX_ACCEL_MPS2),
    "yaw rate": (("base.orientation_rate.yaw",), MAX_TURN_RATE_RADPS),
    "size": (("base.dimension.length", "base.dimension.width"), MAX_ROAD_USER_SIZE_M),
    "rear axle": (("vehicle_attributes.bbcenter_to_rear.x",), MAX_ROAD_USER_SIZE_M),
}
"""Quantity -> its fields in an object, and the largest magnitude that is accepted, in the unit of the field."""
HOST_OBJECT_ROLES = (Role.EGO_POSITION, Role.EGO_SPEED, Role.TRUTH)
"""Roles that the host's own object fills; the others are filled by all other objects."""
OTHER_HOST_REASON, NO_HOST_REASON = "of another host vehicle", "without the host vehicle"
"""The reasons for setting aside a message of another host vehicle, and one without the host vehicle."""


@dataclass(frozen=True)
class MovingObjects:
    """The moving objects of all messages of a channel, one row per object and message, in the messages' order.

    Attributes:
        message: Shape (n,): the row of the object's message.
        id: Shape (n,), uint64.
        host: Id of the host vehicle, or None where there is no object at all.
        x_m, y_m: Shape (n,): centre of the box, in the axes of the world.
        heading_rad: Shape (n,), counter-clockwise from the world's x axis; NaN where not given.
        speed_mps, accel_mps2, lateral_accel_mps2: Shape (n,), along the heading (negative in reverse) and to its left.
        vx_mps, vy_mps: Shape (n,), in the axes of the world.
        yaw_rate_radps: Shape (n,).
        length_m, width_m: Shape (n,).
        rear_x_m: Shape (n,): the middle of the rear axle ahead of the centre, mostly negative; NaN where not given.
    """

    message: npt.NDArray[np.intp]
    id: npt.NDArray[np.uint64]
    host: int | None
    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    speed_mps: FloatArray
    accel_mps2: FloatArray
    lateral_accel_mps2: FloatArray
    vx_mps: FloatArray
    vy_mps: FloatArray
    yaw_rate_radps: FloatArray
    length_m: FloatArray
    width_m: FloatArray
    rear_x_m: FloatArray

    @property
    def is_host_mask(self) -> BoolArray:
        """Which rows are the host vehicle, (n,)."""
        if self.host is None:
            return np.zeros(len(self.id), np.bool_)
        found: BoolArray = self.id == np.uint64(self.host)
        return found


def read_moving_objects(columns: Columns, reading: Reading, ledger: RowLedger, prefix: str = "") -> MovingObjects:
    """Read the moving objects of a channel; messages that name another host than the rest are set aside.

    Args:
        reading: `ego_station` names the host vehicle.
        prefix: Path of the GroundTruth in the message, with its dot.
    """
    base = f"{prefix}moving_object.base"
    elements = Elements(columns, ledger, f"{base}.position.x", f"{base}.position.y")
    ids = _read_object_ids(columns, elements, f"{prefix}moving_object.id.value")
    message = elements.message_rows
    values = {
        leaf: elements.read_numbers(f"{prefix}moving_object.{leaf}")
        for leaf in (
            *("base.position.x", "base.position.y", "base.orientation.yaw", "base.velocity.x", "base.velocity.y"),
            *("base.acceleration.x", "base.acceleration.y", "base.orientation_rate.yaw"),
            *("base.dimension.length", "base.dimension.width", "type", "vehicle_attributes.bbcenter_to_rear.x"),
        )
    }
    place = np.stack([values["base.position.x"], values["base.position.y"]], axis=1)
    with np.errstate(invalid="ignore"):
        is_placed = (np.abs(place) < MAX_COORDINATE_M).all(axis=1)
    if not is_placed.all():
        ledger.add_note(f"{np.count_nonzero(~is_placed)} objects without a usable position left out")
    is_first = _first_of_id_in_message_mask(message, ids)
    if not is_first.all():
        ledger.add_note(f"{np.count_nonzero(~is_first)} objects are in their message twice: the first counts")
    _note_unused_parts(columns, ledger, prefix)
    keep = is_placed & is_first & ledger.keep[message]
    values = {leaf: column[keep] for leaf, column in values.items()}
    message, ids, place = message[keep], ids[keep], place[keep]
    host = _choose_host_id(columns, reading, ledger, prefix, ids, place, values["type"] == VEHICLE_TYPE_CODE)
    is_of_role = np.isin(ids, [] if host is None else [np.uint64(host)]) == (reading.role in HOST_OBJECT_ROLES)
    _blank_out_of_range_values(values, message, is_of_role, ledger)
    keep = ledger.keep[message]
    return _motion_along_and_across_heading(message, ids, host, place, values, keep)


def _blank_out_of_range_values(
    values: dict[str, FloatArray], message: npt.NDArray[np.intp], is_of_role: BoolArray, ledger: RowLedger
) -> None:
    """Replace values that no road user has by NaN, and count the messages in which the role's objects have one.

    Args:
        values: Field -> its values, (n,); changed in place.
        message: Shape (n,): the row of the object's message.
        is_of_role: Shape (n,): objects that fill the role.
    """
    for quantity, (leaves, limit) in OBJECT_FIELDS_AND_MAX_MAGNITUDE_BY_QUANTITY.items():
        is_beyond = np.zeros(len(message), np.bool_)
        for leaf in leaves:
            is_beyond |= np.abs(values[leaf]) > limit
        for leaf in leaves:
            values[leaf] = np.where(is_beyond, np.nan, values[leaf])
        has_beyond = np.zeros(len(ledger.keep), np.bool_)
        has_beyond[message[is_beyond & is_of_role]] = True
        ledger.count_repaired(has_beyond, f"{quantity} out of range, left out")


def _note_unused_parts(columns: Columns, ledger: RowLedger, prefix: str) -> None:
    """Add notes on the parts of the world that are not used."""
    still = find_ragged_field(columns, f"{prefix}{STATIONARY_OBJECT_FIELD}.id.value")
    if still is not None and len(still.values):
        n_messages = int(np.count_nonzero(np.diff(still.offsets)))
        n = len(sort_distinct_values(still.values))
        ledger.add_note(
            f"{n} stationary objects (in {n_messages} messages) are left out: road users are moving objects"
        )
    projection = find_field(columns, f"{prefix}{PROJECTION_FIELD}")
    if isinstance(projection, Strings) and (projection.codes >= 0).any():
        ledger.add_note("the map projection (proj_string) is not used: positions stay in the simulated plane")


def read_world_stamps_ns_and_is_given(columns: Columns, prefix: str = "") -> StampsNsAndIsGiven:
    """Read stamps in ns and whether they are there, both (n,): of the GroundTruth, else of the message around it.

    Simulated time begins at 0, and a 0 is left out of a message: a stamp is missing only where no message has one.
    """
    for path in dict.fromkeys((f"{prefix}timestamp", "timestamp")):
        stamp_ns, is_given = read_timestamps_ns_and_is_given(columns, path)
        if is_given.any():
            return stamp_ns, np.ones(len(columns), np.bool_)
    return np.zeros(len(columns), np.int64), np.zeros(len(columns), np.bool_)


def read_timestamps_ns_and_is_given(columns: Columns, path: str) -> StampsNsAndIsGiven:
    """Read an `osi3.Timestamp` in ns, 0 where it is left out, and whether a message has it, both (n,)."""
    parts = [_read_first_number_and_presence(columns, f"{path}.{name}") for name in ("seconds", "nanos")]
    (seconds, has_seconds), (nanos, has_nanos) = parts
    is_sane = (seconds >= 0) & (seconds < 2**33) & (nanos >= 0) & (nanos < NS_PER_S)
    stamp_ns = np.where(is_sane, seconds, 0) * NS_PER_S + np.where(is_sane, nanos, 0)
    return stamp_ns, (has_seconds | has_nanos) & is_sane


def encode_station_names(ids: npt.NDArray[np.uint64]) -> Strings:
    """Return the ids as texts, coded in the order of their first appearance."""
    distinct, first, inverse = np.unique(ids, return_index=True, return_inverse=True)
    rank = np.empty(len(distinct), np.int32)
    order = np.argsort(first)
    rank[order] = np.arange(len(order), dtype=np.int32)
    return Strings(rank[inverse].astype(np.int32), tuple(str(each) for each in distinct[order].tolist()))


def _read_first_number_and_presence(columns: Columns, path: str) -> tuple[Int64Array, BoolArray]:
    """Read a number of each message, the first where it holds several (views of several sensors)."""
    field = find_field(columns, path)
    if not isinstance(field, Ragged):
        return read_integers(columns, path)
    has_one = np.diff(field.offsets) > 0
    first = field.values[field.offsets[:-1][has_one]]
    values, is_whole = np.zeros(len(columns), np.int64), has_one.copy()
    if not np.issubdtype(first.dtype, np.integer):  # whole numbers stay as exact as they are: ids have 64 bits
        is_whole[has_one] = np.isfinite(first) & (np.abs(first) < 9e18)
        first = np.where(is_whole[has_one], first, 0.0)
    values[has_one] = first.astype(np.int64)
    return values, is_whole


def _read_object_ids(columns: Columns, elements: Elements, path: str) -> npt.NDArray[np.uint64]:
    """Read the objects' ids exactly; 0 where a message does not give one for each object."""
    leaf = find_ragged_field(columns, path)
    out = np.zeros(len(elements), np.uint64)
    if leaf is not None and np.issubdtype(leaf.values.dtype, np.integer):
        lengths = np.diff(leaf.offsets)
        fits = lengths == elements.counts
        out[np.repeat(fits, elements.counts)] = leaf.values[np.repeat(fits, lengths)].astype(np.uint64)
    return out


def _first_of_id_in_message_mask(message: npt.NDArray[np.intp], ids: npt.NDArray[np.uint64]) -> BoolArray:
    order = np.lexsort((ids, message))
    is_again = np.zeros(len(ids), np.bool_)
    same = (np.diff(message[order]) == 0) & (ids[order][1:] == ids[order][:-1])
    is_again[order[1:]] = same  # lexsort keeps the order of equal rows
    return ~is_again


def _choose_host_id(
    columns: Columns,
    reading: Reading,
    ledger: RowLedger,
    prefix: str,
    ids: npt.NDArray[np.uint64],
    position_m: FloatArray,
    is_vehicle: BoolArray,
) -> int | None:
    """Choose the host's id: the one that the user names, else the messages, else the first vehicle that drives.

    With two hosts in a channel (the traces of two cars in one) the one of most messages counts.
    """
    if not len(ids):
        return None
    if reading.ego_station is not None and reading.ego_station.isdecimal() and int(reading.ego_station) < 2**64:
        return int(reading.ego_station)
    paths = (
        f"{prefix.removesuffix(GROUND_TRUTH_PATH_PREFIX_IN_SENSOR_VIEW)}host_vehicle_id.value",
        f"{prefix}host_vehicle_id.value",
    )
    for path in dict.fromkeys(paths):
        said, is_said = _read_first_number_and_presence(columns, path)
        said = said.astype(np.uint64)
        is_there = is_said & np.isin(said, ids) & ledger.keep
        if not is_there.any():
            continue
        hosts, n = np.unique(said[is_there], return_counts=True)
        host = int(hosts[np.argmax(n)])
        if len(hosts) > 1:
            named_hosts = ", ".join(f"{one} ({k} messages)" for one, k in zip(hosts.tolist(), n.tolist(), strict=True))
            ledger.add_note(f"several host vehicles, {named_hosts}: {host} is the ego (--ego-station chooses another)")
            ledger.set_aside(is_there & (said != host), OTHER_HOST_REASON)
        return host
    host, why = _smallest_moving_id_and_reason(ids, position_m, is_vehicle)
    ledger.add_note(f"no message names the host vehicle: {host}, {why}, is the ego (--ego-station chooses another)")
    return host


def _smallest_moving_id_and_reason(
    ids: npt.NDArray[np.uint64], position_m: FloatArray, is_vehicle: BoolArray
) -> tuple[int, str]:
    """Return the smallest id of a vehicle that moves, else of an object that moves, of a vehicle, of any object; and
    why."""
    distinct, inverse = np.unique(ids, return_inverse=True)
    low, high = np.full((len(distinct), 2), np.inf), np.full((len(distinct), 2), -np.inf)
    np.minimum.at(low, inverse, position_m)
    np.maximum.at(high, inverse, position_m)
    moves = (high - low).max(axis=1) > MIN_DISTANCE_TRAVELLED_BY_MOVING_OBJECT_M
    drives = np.zeros(len(distinct), np.bool_)
    drives[inverse[is_vehicle]] = True
    for chosen, why in (
        (moves & drives, "the smallest id of a vehicle that moves"),
        (moves, "the smallest id of a moving object"),
        (drives, "the smallest id of a vehicle (none moves)"),
    ):
        if chosen.any():
            return int(distinct[chosen][0]), why
    return int(distinct[0]), "the smallest id (nothing moves)"


def _motion_along_and_across_heading(
    message: npt.NDArray[np.intp],
    ids: npt.NDArray[np.uint64],
    host: int | None,
    position_m: FloatArray,
    values: dict[str, FloatArray],
    keep: BoolArray,
) -> MovingObjects:
    """Derive each object's motion along and across its heading.

    A vehicle's heading is its yaw, so that it may reverse; that of others is the course of their way: a pedestrian may
    step to the side.
    """
    distinct, owner = np.unique(ids, return_inverse=True)
    velocity = values["base.velocity.x"] + 1j * values["base.velocity.y"]
    acceleration = values["base.acceleration.x"] + 1j * values["base.acceleration.y"]
    yaw_rad, n = wrap_angle(values["base.orientation.yaw"]), len(distinct)

    def is_always_zero(column: npt.NDArray[np.generic]) -> BoolArray:
        """Which objects have a 0 in every message, (objects,)."""
        is_zero: BoolArray = np.bincount(owner, weights=(column != 0).astype(np.float64), minlength=n) == 0
        return is_zero

    low, high = np.full((n, 2), np.inf), np.full((n, 2), -np.inf)
    np.minimum.at(low, owner, position_m)
    np.maximum.at(high, owner, position_m)
    moves = (high - low).max(axis=1, initial=0.0) > MIN_DISTANCE_TRAVELLED_BY_MOVING_OBJECT_M
    is_still = is_always_zero(velocity)
    no_velocity = (is_still & moves)[owner]
    with np.errstate(invalid="ignore", over="ignore"):
        velocity = np.where(no_velocity | ~(np.abs(velocity) < MAX_SPEED_MPS), np.nan, velocity)
        acceleration = np.where(np.abs(acceleration) < MAX_ACCEL_MPS2, acceleration, np.nan)
    acceleration = np.where((is_always_zero(acceleration) & (moves & is_still))[owner], np.nan, acceleration)
    with np.errstate(invalid="ignore"):
        is_fast = np.abs(velocity) > MIN_COURSE_SPEED_MPS
        course_rad = np.angle(velocity)
        is_sideways = is_fast & (np.abs(np.sin(course_rad - yaw_rad)) > MAX_SINE_OF_ANGLE_FROM_VEHICLE_AXIS_TO_MOTION)
    n_sideways = np.bincount(owner, weights=is_sideways.astype(np.float64), minlength=n)
    n_fast = np.bincount(owner, weights=is_fast.astype(np.float64), minlength=n)
    no_yaw = is_always_zero(yaw_rad) & (n_sideways > 0.5 * n_fast) & (n_fast > 0)
    follows_course = ((values["type"] != VEHICLE_TYPE_CODE) | no_yaw[owner]) & is_fast
    yaw_rad = np.where(no_yaw[owner] & ~is_fast, np.nan, yaw_rad)
    heading_rad = np.where(follows_course, course_rad, yaw_rad)
    with np.errstate(invalid="ignore"):
        forward = np.exp(-1j * heading_rad)
        along, across = velocity * forward, acceleration * forward
    speed = np.where(np.isfinite(heading_rad), along.real, np.abs(velocity))
    yaw_rate = np.where(follows_course | is_always_zero(values["base.orientation_rate.yaw"])[owner], np.nan, 1.0)
    yaw_rate = yaw_rate * values["base.orientation_rate.yaw"]
    sizes = [
        np.where(values[f"base.dimension.{name}"] > 0.0, values[f"base.dimension.{name}"], np.nan)
        for name in ("length", "width")
    ]
    rear = values["vehicle_attributes.bbcenter_to_rear.x"]
    return MovingObjects(
        message=message[keep],
        id=ids[keep],
        host=host,
        x_m=position_m[keep, 0],
        y_m=position_m[keep, 1],
        heading_rad=heading_rad[keep],
        speed_mps=speed[keep],
        accel_mps2=across.real[keep],
        lateral_accel_mps2=across.imag[keep],
        vx_mps=velocity.real[keep],
        vy_mps=velocity.imag[keep],
        yaw_rate_radps=yaw_rate[keep],
        length_m=sizes[0][keep],
        width_m=sizes[1][keep],
        rear_x_m=np.where(rear != 0.0, rear, np.nan)[keep],
    )
