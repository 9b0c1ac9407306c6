"""`cwcli.v1.VehicleState`: the states of the ego, of the other vehicles, and of the ego under each policy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.channels.output import make_output_channel
from cwcli.channels.published import Channel
from cwcli.errors import MissingSignalError
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import (
    Columns,
    Field,
    FloatArray,
    Int64Array,
    OutputChannel,
    Ragged,
    Strings,
    repeat_string,
    select_table_rows,
)
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.leaf_fields import (
    find_field,
    read_integers,
    read_matrix,
    read_numbers,
    read_texts,
    require_possible_numbers,
    unusable_field_error,
)
from cwcli.signals.packed_covariances import Covariances, PackedCovariances, pack_covariances
from cwcli.signals.precision import round_to_binary_step
from cwcli.signals.row_order import Rows, rows_by_stamp_without_repeats
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import EGO_ID, N_STATES, STATE_NAMES, StateFlag

UInt8Array = npt.NDArray[np.uint8]
FLAG_BY_FIELD: dict[str, StateFlag] = {str(flag.name).lower(): flag for flag in StateFlag}
"""Field of the message -> the flag that it holds."""

STATE_FRACTION_BITS = (11, 11, 11, 16, 11, 16, 11, 16)
"""Each state is published as a multiple of 2 to the power of minus this, in its SI unit (docs/channels.md)."""
LATITUDE_LONGITUDE_FRACTION_BITS = 24
"""Latitudes and longitudes are published as multiples of 2^-24 degrees (7 mm); chosen by hand."""
N_CORRELATIONS = N_STATES * (N_STATES - 1) // 2
"""Number of correlations above the diagonal of a covariance of `N_STATES` states: 28."""
COVARIANCE_FIELDS = ("covariance", "sigma", "correlation")
"""Fields that hold the covariance, in logs of older versions and of this one."""
MAX_STATE_GAP_OF_DRIVEN_DISTANCE_S = 1.0
"""Longest gap between states whose distance counts as driven, s. Chosen by hand; not fitted."""
KINEMATIC_FIELDS = ("id", "stamp_ns", *STATE_NAMES, "length_m", "width_m")
"""Fields of the states without their covariances, which are most of a channel's bytes."""
KINEMATIC_AND_FLAG_FIELDS = (*KINEMATIC_FIELDS, *FLAG_BY_FIELD)
"""The same, with the flags."""


@dataclass(frozen=True)
class VehicleStates:
    """States of vehicles, n rows.

    Attributes:
        stamp_ns, log_time_ns: Shape (n,): time of the state; time at which it was known (reception for V2X).
        state: Shape (n, 8), order `STATE_NAMES`.
        covariance: Shape (n, 8, 8); packed where it was read from a channel.
        length_m, width_m: Shape (n,), NaN where unknown.
        flags: Shape (n,): `StateFlag`s.
    """

    ids: Strings
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    state: FloatArray
    covariance: Covariances
    length_m: FloatArray
    width_m: FloatArray
    flags: UInt8Array

    @classmethod
    def from_ego_states(
        cls,
        stamp_ns: Int64Array,
        state: FloatArray,
        covariance: Covariances | None = None,
        *,
        size_m: tuple[float | None, float | None] = (None, None),
        flags: UInt8Array | None = None,
    ) -> VehicleStates:
        """Make states of the ego, logged at their stamps; without `covariance` it is NaN."""
        n = len(stamp_ns)
        if covariance is None:
            covariance = np.broadcast_to(np.nan, (n, N_STATES, N_STATES))
        length_m, width_m = (np.full(n, np.nan if size is None else size) for size in size_m)
        if flags is None:
            flags = np.zeros(n, np.uint8)
        return cls(repeat_string(EGO_ID, n), stamp_ns, stamp_ns, state, covariance, length_m, width_m, flags)

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def select_rows(self, rows: Rows) -> VehicleStates:
        """Select rows, in the given order."""
        return select_table_rows(self, rows)

    def round_to_published_precision(self) -> VehicleStates:
        state = np.column_stack(
            [round_to_binary_step(self.state[:, k], bits) for k, bits in enumerate(STATE_FRACTION_BITS)]
        )
        return replace(self, state=state, covariance=pack_covariances(self.covariance))

    def sort_by_stamp_without_repeats(self) -> VehicleStates:
        """Sort the states of one vehicle by stamp, and keep the first of each stamp."""
        return self.select_rows(rows_by_stamp_without_repeats(self.stamp_ns))

    def select_logged_within(self, start_ns: int | None, end_ns: int | None) -> VehicleStates:
        """Select the states whose log time is in [start_ns, end_ns); None is no bound."""
        if start_ns is None and end_ns is None:
            return self
        keep = np.ones(len(self), dtype=bool)
        if start_ns is not None:
            keep &= self.log_time_ns >= start_ns
        if end_ns is not None:
            keep &= self.log_time_ns < end_ns
        return self.select_rows(np.flatnonzero(keep))


def make_vehicle_state_channel(
    channel: Channel, states: VehicleStates, local_map: LocalMap | None, *, has_covariance: bool = True
) -> OutputChannel:
    """Make the channel of one message a state.

    Args:
        channel: Which of the channels of states.
        states: In any order.
        local_map: For latitude and longitude; None leaves them unknown.
        has_covariance: The covariance is known; else it is NaN.

    Raises:
        ArithmeticError: A covariance is not positive definite: whoever made the states has a bug.
    """
    n = len(states)
    covariance = pack_covariances(states.covariance)
    if has_covariance:
        _require_positive_definite(channel.topic, states, covariance)
    state = [round_to_binary_step(states.state[:, k], bits) for k, bits in enumerate(STATE_FRACTION_BITS)]
    latitude_deg, longitude_deg = np.full((2, n), np.nan)
    if local_map is not None:
        latitude_deg, longitude_deg, _ = local_map.wgs84_from_map(state[0], state[1], np.zeros(n))
    fields: dict[str, Field] = {
        "stamp_ns": states.stamp_ns,
        "id": states.ids,
        **dict(zip(STATE_NAMES, state, strict=True)),
        "latitude_deg": round_to_binary_step(latitude_deg, LATITUDE_LONGITUDE_FRACTION_BITS),
        "longitude_deg": round_to_binary_step(longitude_deg, LATITUDE_LONGITUDE_FRACTION_BITS),
        "sigma": covariance.sigma,
        "correlation": covariance.correlation,
        "length_m": states.length_m,
        "width_m": states.width_m,
        **{name: (states.flags & flag) > 0 for name, flag in FLAG_BY_FIELD.items()},
    }
    return make_output_channel(channel, states.log_time_ns, fields)


def _require_positive_definite(topic: str, states: VehicleStates, covariance: PackedCovariances) -> None:
    is_definite = np.isfinite(covariance.sigma[:, 0])  # a covariance that is not definite was packed as NaN
    if is_definite.all():
        return
    first = int(np.argmin(is_definite))
    raise ArithmeticError(
        f"{topic}: {np.count_nonzero(~is_definite)} of {len(states)} covariances are not positive definite, the first "
        f"that of {states.ids.values[states.ids.codes[first]]} at {states.stamp_ns[first] / NS_PER_S:.3f} s"
    )


def read_vehicle_states(columns: Columns, *, with_covariance: bool = True) -> VehicleStates:
    """Read the states of a channel, in log-time order.

    Args:
        columns: The channel; its fields `KINEMATIC_FIELDS` are enough for states without covariance.
        with_covariance: If False, the covariance is NaN and takes no memory.

    Raises:
        DataError: A field is missing, or the covariance has not as many values as it should: another version wrote it.
    """
    return VehicleStates(
        ids=read_texts(columns, "id", required=True),
        stamp_ns=read_integers(columns, "stamp_ns", required=True)[0],
        log_time_ns=columns.log_time_ns,
        state=np.column_stack([read_numbers(columns, name, required=True) for name in STATE_NAMES]),
        covariance=(
            _read_covariances_full_or_packed_as_stored(columns)
            if with_covariance
            else np.broadcast_to(np.nan, (len(columns), N_STATES, N_STATES))
        ),
        length_m=read_numbers(columns, "length_m", required=True),
        width_m=read_numbers(columns, "width_m", required=True),
        flags=_read_flags(columns),
    )


def _read_covariances_full_or_packed_as_stored(columns: Columns) -> Covariances:
    """Read the covariances: packed, or full as older versions wrote them.

    Raises:
        DataError: They are missing.
    """
    old = find_field(columns, "covariance")
    if old is not None and (not isinstance(old, Ragged) or len(old.values)):
        n = len(columns)
        return read_matrix(columns, "covariance", N_STATES**2, required=True).reshape(n, N_STATES, N_STATES)
    if not len(columns):
        return PackedCovariances.allocate_uninitialised(0, N_STATES)
    packed = []
    for name, width in (("sigma", N_STATES), ("correlation", N_CORRELATIONS)):
        field = find_field(columns, name)
        if not isinstance(field, np.ndarray) or field.shape != (len(columns), width):
            raise unusable_field_error(columns, name)
        require_possible_numbers(columns, name, field)
        packed.append(np.asarray(field, np.float32))
    if (packed[0] <= 0.0).any():  # of a log of others: such a covariance is not known
        packed[0] = np.where((packed[0] <= 0.0).any(axis=1, keepdims=True), np.float32(np.nan), packed[0])
    return PackedCovariances(*packed)


def _read_flags(columns: Columns) -> UInt8Array:
    """Read the flags of each state; fields that an older version did not write count as unset."""
    flags = np.zeros(len(columns), np.uint8)
    for name, flag in FLAG_BY_FIELD.items():
        flags[read_numbers(columns, name) > 0.0] |= np.uint8(flag)
    return flags


def require_ego_states(states: VehicleStates, *, log_name: str, topic: str) -> None:
    """Check that there is a state of the ego in the part of the log that was asked for.

    Raises:
        MissingSignalError: There is none.
    """
    if not len(states):
        raise MissingSignalError(
            "no state of the ego is in the log, or none between --start and --end", where=f"{log_name}: {topic}"
        )


def driven_distance_m(states: VehicleStates) -> float:
    """Return the distance (m) between states that are less than `MAX_STATE_GAP_OF_DRIVEN_DISTANCE_S` apart."""
    steps = np.hypot(*np.diff(states.state[:, :2], axis=0).T)
    return float(steps[np.diff(states.stamp_ns) < MAX_STATE_GAP_OF_DRIVEN_DISTANCE_S * NS_PER_S].sum())
