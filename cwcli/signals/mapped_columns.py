"""Converting a channel by a user's mapping to the columns of a message that cwcli knows."""

from __future__ import annotations

import numpy as np

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import replace
from cwcli.signals.clocks import MAX_STAMP_NS
from cwcli.signals.columns import (
    BoolArray,
    Columns,
    Field,
    FloatArray,
    NumericArray,
    Ragged,
    StampsNsAndIsGiven,
    Strings,
    median_of_values,
)
from cwcli.signals.leaf_fields import find_field, read_numbers, read_stamps
from cwcli.signals.mapping import MAPPED_QUANTITIES_BY_ROLE, FieldMapping, Term
from cwcli.signals.resample import interpolate_signal_at_times
from cwcli.signals.role import Role
from cwcli.signals.units import NS_PER_S

SECONDS_AND_NANOSECONDS_NAMES = (("sec", "nanosec"), ("secs", "nsecs"), ("sec", "nsec"))
"""The names that seconds and nanoseconds of a time have in different encodings."""
MAX_INTERPOLATED_GAP_IN_USUAL_STEPS = 2.5
"""The largest gap that is interpolated, in usual steps of the channel: one message may be missing."""
HEADER_STAMP_PATHS = ("header.stamp.sec", "header.stamp.nanosec")
"""The paths of seconds and nanoseconds in a ROS header."""


def apply_mapping_and_tell_if_stamped(columns: Columns, mapping: FieldMapping) -> tuple[Columns, bool]:
    """Convert a channel to the message that `mapping` makes of it.

    Returns:
        The columns, and whether the messages have a time.

    Raises:
        UsageError: A field is not there, or holds no numbers.
    """
    quantities = MAPPED_QUANTITIES_BY_ROLE[mapping.role]
    values = read_mapped_values(columns, mapping)
    fields: dict[str, Field] = dict(values)
    if mapping.role == Role.EGO_HEADING:
        half = 0.5 * values["yaw"]
        with np.errstate(invalid="ignore"):
            fields = {"quaternion.z": np.sin(half), "quaternion.w": np.cos(half)}
        fields |= {f"quaternion.{axis}": 0.0 * half for axis in "xy"}
    stamp_ns, has_stamp = _read_mapped_stamps_ns_and_is_given(columns, mapping)
    is_stamped = bool(has_stamp.any()) or bool(mapping.stamp)
    if is_stamped:
        whole, rest = np.divmod(np.where(has_stamp, stamp_ns, 0), NS_PER_S)
        fields |= dict(zip(HEADER_STAMP_PATHS, (whole, rest), strict=True))
    return replace(columns, schema_name=quantities.schema, fields=fields), is_stamped


def read_mapped_values(columns: Columns, mapping: FieldMapping) -> dict[str, FloatArray]:
    """Read the quantities that a mapping names of its channel, by field, (n,) each.

    Raises:
        UsageError: A field is not there, or holds no numbers.
    """
    return {
        name: _read_term_values(columns, mapping, term)
        for name, term in zip(mapping.target_field_names, mapping.terms, strict=True)
    }


def add_other_channel_interpolated_and_note(
    mapped: Columns, is_stamped: bool, other_channel: Columns, other_mapping: FieldMapping
) -> tuple[Columns, str]:
    """Add the quantities of another channel at the columns' times; return the columns and a note.

    Interpolated between two messages of it that are next to each other, or have one missing between them; NaN
    elsewhere. Times are those of the messages, or log times where one of the channels has no others.

    Raises:
        UsageError: A field is not there, or holds no numbers.
    """
    values = read_mapped_values(other_channel, other_mapping)
    stamp_ns, has_stamp = _read_mapped_stamps_ns_and_is_given(other_channel, other_mapping)
    own_ns, own_has = read_stamps(mapped)
    is_by_stamp = is_stamped and bool(has_stamp.any())
    their_ns = np.where(has_stamp, stamp_ns, other_channel.log_time_ns) if is_by_stamp else other_channel.log_time_ns
    at_ns = np.where(own_has, own_ns, mapped.log_time_ns) if is_by_stamp else mapped.log_time_ns
    order = np.argsort(their_ns, kind="stable")
    steps_s = np.diff(their_ns[order]) / NS_PER_S
    gap_s = (
        MAX_INTERPOLATED_GAP_IN_USUAL_STEPS * median_of_values(steps_s[steps_s > 0.0]) if (steps_s > 0.0).any() else 0.0
    )
    fields: dict[str, Field] = dict(mapped.fields)
    kinds = MAPPED_QUANTITIES_BY_ROLE[other_mapping.role].fields
    for name, each in values.items():
        turn = np.pi / 180.0 if kinds[name] == "place" else 1.0  # a longitude goes on from 180 to -180 degrees
        at = interpolate_signal_at_times(
            their_ns[order], turn * each[order], at_ns, max_gap_s=gap_s, is_angle=kinds[name] == "place"
        )
        fields[name] = at / turn
    time = "the time of the messages" if is_by_stamp else "log time"
    note = f"{', '.join(values)} of {other_mapping.topic} ({len(other_channel)} messages), interpolated by {time}"
    return replace(mapped, fields=fields), note


def _read_term_values(columns: Columns, mapping: FieldMapping, term: Term) -> FloatArray:
    """Read one quantity, (n,); NaN where the message has none."""
    field = columns.fields.get(term.path)
    if len(columns) and (field is None or (isinstance(field, Strings) and term.index is not None)):
        raise _no_numbers_error(columns, mapping, term)
    if isinstance(field, Ragged) or (isinstance(field, np.ndarray) and field.ndim == 2):
        if term.index is None:
            raise _no_numbers_error(columns, mapping, term)
        values = _element_of_each_sequence_or_nan(field, term.index)
    elif term.index is not None and len(columns):
        raise _no_numbers_error(columns, mapping, term)
    else:
        values = read_numbers(columns, term.path)
    if len(values) and not np.isfinite(values).any():
        raise _no_numbers_error(columns, mapping, term)
    with np.errstate(over="ignore", invalid="ignore"):
        return term.factor * values + term.offset


def _element_of_each_sequence_or_nan(field: Ragged | NumericArray, index: int) -> FloatArray:
    """Return an element of each sequence, NaN where the sequence is shorter."""
    if not isinstance(field, Ragged):
        n, width = field.shape
        return field[:, index].astype(np.float64) if index < width else np.full(n, np.nan)
    is_there = np.diff(field.offsets) > index
    out = np.full(len(field), np.nan)
    out[is_there] = field.values[field.offsets[:-1][is_there] + index].astype(np.float64)
    return out


def _read_mapped_stamps_ns_and_is_given(columns: Columns, mapping: FieldMapping) -> StampsNsAndIsGiven:
    if not mapping.stamp:
        return read_stamps(columns)
    for whole, rest in SECONDS_AND_NANOSECONDS_NAMES:
        if find_field(columns, f"{mapping.stamp}.{whole}") is not None:
            names = (f"{mapping.stamp}.{whole}", f"{mapping.stamp}.{rest}")
            own = {name: columns.fields.get(path) for name, path in zip(HEADER_STAMP_PATHS, names, strict=True)}
            return read_stamps(replace(columns, fields={name: each for name, each in own.items() if each is not None}))
    field = columns.fields.get(mapping.stamp)
    if not isinstance(field, np.ndarray) or field.ndim != 1:
        if len(columns):
            raise UsageError(f"--map {mapping.role}={mapping.text}: no time in {mapping.stamp}", where=columns.topic)
        return np.zeros(0, np.int64), np.zeros(0, np.bool_)
    counted = field.astype(np.float64)
    in_range: BoolArray = np.isfinite(counted) & (counted > 0.0) & (counted * mapping.stamp_unit_ns <= MAX_STAMP_NS)
    if np.issubdtype(field.dtype, np.integer):  # nanoseconds since 1970 have more digits than a float
        return np.where(in_range, field, 0).astype(np.int64) * int(mapping.stamp_unit_ns), in_range
    return np.round(np.where(in_range, counted, 0.0) * mapping.stamp_unit_ns).astype(np.int64), in_range


def _no_numbers_error(columns: Columns, mapping: FieldMapping, term: Term) -> UsageError:
    place = term.path if term.index is None else f"{term.path}[{term.index}]"
    return UsageError(
        f"--map {mapping.role}={mapping.text}: {columns.schema_name or 'the message'} has no number in {place}",
        where=columns.topic,
        hint="`cwcli info LOG` shows fields to try for unused topics; [0] names the first element of a sequence",
    )
