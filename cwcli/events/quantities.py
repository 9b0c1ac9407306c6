"""The quantities of expressions: states of the ego and the others, measures, and fields of topics, over time."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from functools import cache

import numpy as np

from cwcli.errors import MissingSignalError, UsageError, hint_at_closest_or_all_known_names
from cwcli.events.evidence import EventEvidence
from cwcli.events.syntax import Series
from cwcli.logs.read.reader import Log
from cwcli.measures import MEASURES
from cwcli.metrics.condition_parser import Comparison, Number
from cwcli.metrics.table import unit_of_column
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.inputs import normalise_schema_name
from cwcli.signals.leaf_fields import read_numbers
from cwcli.signals.mapping import MAPPED_QUANTITIES_BY_ROLE, UNIT_IN_ROS_MESSAGES_BY_KIND_OF_QUANTITY
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import STATE_NAMES

EGO_PREFIX, OTHER_PREFIX = "ego.", "other."
"""Beginnings of the names of the states of the ego and of the other vehicle."""
MAX_FIELD_VALUE_AGE_S = 1.0
"""The last value of a topic's field holds for so long, s. Chosen by hand."""


@cache
def measure_by_expression_name() -> Mapping[str, str]:
    """Return name in expressions -> measure: its column (`ttc_s`) and its own name (`ttc`)."""
    names: dict[str, str] = {}
    for name, measure in MEASURES.items():
        if measure.is_series and not measure.is_expensive:
            names[measure.column] = name
            names.setdefault(name, name)
    return names


def check_names_and_units(comparison: Comparison, log: Log | None = None) -> None:
    """Check the names and the units of a comparison; with a log also the units that its messages define.

    Raises:
        UsageError: A quantity is unknown, or a unit does not fit the others.
    """
    units = [(operand, _unit_of_operand(operand)) for operand in comparison.operands]
    if log is not None:
        units = [(operand, unit or _unit_defined_by_message_or_none(operand, log)) for operand, unit in units]
    known = [(operand, unit) for operand, unit in units if unit is not None]
    for (one, unit), (other, other_unit) in itertools.pairwise(known):
        if unit != other_unit:
            raise UsageError(
                f"{_operand_and_unit_for_error_text(one, unit)} can't be compared with "
                f"{_operand_and_unit_for_error_text(other, other_unit)}",
                hint="" if log is None else "a number without a unit is in that of the field",
            )


def _unit_of_operand(operand: Number | Series) -> str | None:
    """Return the unit of an operand; None where it fits any."""
    if isinstance(operand, Number):
        return operand.unit
    name = operand.name
    if name.startswith("/"):
        return unit_of_column(name.rpartition(":")[2]) or None
    if name.startswith((EGO_PREFIX, OTHER_PREFIX)):
        if name.partition(".")[2] in STATE_NAMES:
            return unit_of_column(name)
    elif name in measure_by_expression_name():
        return MEASURES[measure_by_expression_name()[name]].unit
    known = [*(f"{prefix}{state}" for prefix in (EGO_PREFIX, OTHER_PREFIX) for state in STATE_NAMES)]
    hint = hint_at_closest_or_all_known_names(name, [*known, *measure_by_expression_name()], "quantities")
    raise UsageError(f"there is no quantity {name}", hint=hint)


def _unit_defined_by_message_or_none(operand: Number | Series, log: Log) -> str | None:
    """Return the unit of a field whose message defines it."""
    if isinstance(operand, Number):
        return None
    topic, field = split_topic_and_field(operand.name)
    schemas = {normalise_schema_name(each.schema_name) for each in log.channels if each.topic == topic}
    if "foxglove.LocationFix" in schemas:
        schemas.add("sensor_msgs/NavSatFix")  # which has the same fields
    mapped = (each.fields.get(field) for each in MAPPED_QUANTITIES_BY_ROLE.values() if each.schema in schemas)
    kind = next(filter(None, mapped), None)
    return None if kind is None else UNIT_IN_ROS_MESSAGES_BY_KIND_OF_QUANTITY[kind]


def _operand_and_unit_for_error_text(operand: Number | Series, unit: str | None) -> str:
    """Return an operand with its unit, for messages."""
    if isinstance(operand, Number):
        return f"a number in {unit}" if unit else "a plain number"
    return f"{operand.name} in {unit}" if unit else f"{operand.name}, which has no unit,"


def needs_other_vehicle(operand: Number | Series) -> bool:
    """Tell whether an operand needs another vehicle."""
    return isinstance(operand, Series) and not operand.name.startswith((EGO_PREFIX, "/"))


def split_topic_and_field(name: str) -> tuple[str, str]:
    """Return topic and field of `/topic:field`."""
    topic, _, field = name.rpartition(":")
    return topic, field


def read_field_times_ns_and_values(evidence: EventEvidence, name: str) -> tuple[Int64Array, FloatArray]:
    """Return log times [ns] and values of `/topic:field`, (n,) each.

    Raises:
        MissingSignalError: The log has no such topic, or its messages no such field with numbers.
    """
    topic, field = split_topic_and_field(name)
    log = evidence.log
    topics = sorted({channel.topic for channel in log.channels})
    if topic not in topics:
        raise MissingSignalError(
            f"there is no topic {topic}",
            where=log.name,
            hint=hint_at_closest_or_all_known_names(topic, topics, "topics"),
        )
    columns = log.columns(topic, (field,))
    if field not in columns.fields:
        known = list(log.columns(topic).fields)
        what = f"{topic} has no field {field}"
        raise MissingSignalError(what, where=log.name, hint=hint_at_closest_or_all_known_names(field, known, "fields"))
    values = read_numbers(columns, field)
    if len(values) and not isinstance(columns.fields[field], np.ndarray) and np.isnan(values).all():
        raise MissingSignalError(f"{field} of {topic} holds no numbers", where=log.name)
    return columns.log_time_ns, values


def last_value_before_grid_times(times_ns: Int64Array, values: FloatArray, grid_ns: Int64Array) -> FloatArray:
    """Return the last value before each time of a grid; NaN where it is older than `MAX_FIELD_VALUE_AGE_S`."""
    if not len(times_ns):
        return np.full(len(grid_ns), np.nan)
    rows = np.searchsorted(times_ns, grid_ns, side="right") - 1
    is_fresh = (rows >= 0) & (grid_ns - times_ns[np.maximum(rows, 0)] <= MAX_FIELD_VALUE_AGE_S * NS_PER_S)
    return np.where(is_fresh, values[np.maximum(rows, 0)], np.nan)


def trailing_window_values(values: FloatArray, grid_ns: Int64Array, function: str, window_s: float) -> FloatArray:
    """Return the min, max or mean of the known values in the window that ends at each time; NaN without one."""
    first = np.searchsorted(grid_ns, grid_ns - round(window_s * NS_PER_S), side="left")
    known = np.isfinite(values)
    if function == "mean":
        sums = np.concatenate([[0.0], np.cumsum(np.where(known, values, 0.0))])
        counts = np.concatenate([[0], np.cumsum(known)])
        stop = np.arange(1, len(values) + 1)
        n = counts[stop] - counts[first]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(n > 0, (sums[stop] - sums[first]) / n, np.nan)
    extreme = np.fmin if function == "min" else np.fmax  # these ignore NaN
    out, extremes = np.full(len(values), np.nan), np.where(known, values, np.nan)
    n_in_window = np.arange(1, len(values) + 1) - first
    n = 1  # `extremes` are those of n values from each row on; two of them span every window of n to 2 n values
    while n <= n_in_window.max(initial=0):
        rows = np.flatnonzero((n_in_window >= n) & (n_in_window < 2 * n))
        out[rows] = extreme(extremes[first[rows]], extremes[rows + 1 - n])
        extremes = extreme(extremes[:-n], extremes[n:])
        n *= 2
    return out
