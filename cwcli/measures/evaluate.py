"""Evaluate the measures of a pair at each moment at which the two are near, and find the most critical values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass, replace
from cwcli.measures.base import Measure
from cwcli.measures.pair import ActualTrack, Pair
from cwcli.metrics.table import ColumnDoc, Table
from cwcli.signals.columns import FloatArray, Int64Array, Strings, encode_strings, repeat_string, sort_distinct_values
from cwcli.signals.units import NS_PER_S

MOMENTS_PER_BLOCK = 2048
"""Number of moments that are measured at once: their arrays fit into the processor's cache."""
MAX_CENTRE_DISTANCE_OF_ENCOUNTER_M = 50.0
"""Greatest distance of the centres, m, within an encounter. Chosen by hand; not fitted."""
MAX_PAUSE_IN_ENCOUNTER_S = 2.0
"""Longest pause within one encounter, s; a longer one divides two encounters. Chosen by hand; not fitted."""
WHOLE_TIME_ENCOUNTER = 0
"""Number that stands for the whole time during which two were near; encounters count from 1."""


@dataclass(frozen=True)
class MeasuredPair:
    """One pair at the moments at which its centres are within the range.

    Attributes:
        stamp_ns: Shape (m,).
        extremes: The most critical values of the whole time and of each encounter.
    """

    other_id: str
    stamp_ns: Int64Array
    values: Mapping[str, FloatArray]
    extremes: tuple[ExtremeValue, ...]


@dataclass(frozen=True)
class ExtremeValue:
    """The most critical value of a measure in an interval of time.

    Attributes:
        encounter: `WHOLE`, or a number from 1.
        begin_ns, end_ns: The interval.
        measure: Name of the measure.
        value: The value; NaN if there is none.
        stamp_ns: Time of the value; -1 for a value of the whole interval.
        sigma: Standard error by the states' covariances to first order; NaN where they are not known.
    """

    encounter: int
    begin_ns: int
    end_ns: int
    measure: str
    value: float
    stamp_ns: int
    sigma: float


def measure_pair(other_id: str, pair: Pair, measures: Mapping[str, Measure]) -> MeasuredPair:
    """Evaluate the measures of one pair; the extremes have no sigmas yet."""
    near = pair.near_rows
    values = {name: np.full(len(near), np.nan) for name, measure in measures.items() if measure.is_series}
    for first in range(0, len(near), MOMENTS_PER_BLOCK):
        block = pair.select_rows(near[first : first + MOMENTS_PER_BLOCK])
        for name, measure in measures.items():
            if measure.is_pointwise:
                values[name][first : first + MOMENTS_PER_BLOCK] = block.evaluate_measure(measure)
    for name, measure in measures.items():
        if measure.is_series and not measure.is_pointwise:
            values[name][:] = pair.evaluate_measure(measure)[near]
    extremes: list[ExtremeValue] = []
    for encounter, rows in enumerate([np.arange(len(near)), *_split_into_encounters(pair)]):
        if len(rows):
            extremes += _extremes_of_encounter(encounter, pair, rows, values, measures)
    return MeasuredPair(other_id, pair.stamp_ns[near], values, tuple(extremes))


def _split_into_encounters(pair: Pair) -> list[npt.NDArray[np.intp]]:
    """Rows of `near` of each encounter; one that is interrupted for less than a pause stays one."""
    near = pair.near_rows
    rows = np.flatnonzero(pair.distance_m[near] <= MAX_CENTRE_DISTANCE_OF_ENCOUNTER_M)
    if not len(rows):
        return []
    pauses = np.flatnonzero(np.diff(pair.stamp_ns[near[rows]]) > MAX_PAUSE_IN_ENCOUNTER_S * NS_PER_S)
    parts = np.split(rows, pauses + 1)
    return [np.arange(part[0], part[-1] + 1) for part in parts]


def _extremes_of_encounter(
    encounter: int,
    pair: Pair,
    rows: npt.NDArray[np.intp],
    values: Mapping[str, FloatArray],
    measures: Mapping[str, Measure],
) -> list[ExtremeValue]:
    """The most critical value of each measure in the rows of one encounter."""
    near = pair.near_rows
    stretch = pair.slice_rows(int(near[rows[0]]), int(near[rows[-1]]) + 1)
    begin_ns, end_ns = int(pair.stamp_ns[near[rows[0]]]), int(pair.stamp_ns[near[rows[-1]]])
    found: list[ExtremeValue] = []
    for name, measure in measures.items():
        if not measure.is_series:
            value, stamp_ns = float(stretch.evaluate_measure(measure)), -1
        else:
            series = values[name][rows]
            worst = _row_of_most_critical_or_minus_1(series, measure)
            value, stamp_ns = np.nan, -1
            if worst >= 0:
                value, stamp_ns = float(series[worst]), int(pair.stamp_ns[near[rows[worst]]])
        found.append(ExtremeValue(encounter, begin_ns, end_ns, name, value, stamp_ns, np.nan))
    return found


def stamps_of_extremes_with_sigma(measured: MeasuredPair, measures: Mapping[str, Measure]) -> Int64Array:
    """The increasing stamps of the extremes that can have a sigma."""
    return sort_distinct_values(
        np.array([each.stamp_ns for each in measured.extremes if _can_have_sigma(each, measures)], np.int64)
    )


def add_sigmas_to_extremes(
    measured: MeasuredPair,
    extreme_pair: Pair,
    measures: Mapping[str, Measure],
    covariances: tuple[FloatArray, FloatArray],
) -> MeasuredPair:
    """Add the sigmas of the extremes to a measured pair.

    Args:
        extreme_pair: The pair at the `moments`.
        covariances: Covariances of the host's and the other's states at the moments, (r, 8, 8) each.
    """
    measures_with_sigma = {
        each.measure: measures[each.measure] for each in measured.extremes if _can_have_sigma(each, measures)
    }
    sigmas = sigmas_of_measures(extreme_pair, covariances, measures_with_sigma)
    row = {stamp_ns: k for k, stamp_ns in enumerate(extreme_pair.stamp_ns.tolist())}
    extremes = tuple(
        replace(each, sigma=float(sigmas[each.measure][row[each.stamp_ns]]))
        if _can_have_sigma(each, measures)
        else each
        for each in measured.extremes
    )
    return replace(measured, extremes=extremes)


def _can_have_sigma(extreme: ExtremeValue, measures: Mapping[str, Measure]) -> bool:
    """Whether a sigma of the extreme can be computed: its measure is pointwise and smooth, and it has a value."""
    measure = measures[extreme.measure]
    is_smooth = measure.is_pointwise and not measure.is_stepped
    return extreme.stamp_ns >= 0 and is_smooth and bool(np.isfinite(extreme.value))


def _row_of_most_critical_or_minus_1(series: FloatArray, measure: Measure) -> int:
    """Row of the most critical value; -1 if all are NaN."""
    known = np.flatnonzero(~np.isnan(series))
    if not len(known):
        return -1
    at = series[known].argmin() if measure.critical == "low" else series[known].argmax()
    return int(known[at])


DIFFERENTIATION_STEPS_OF_STATES = np.array([1e-4, 1e-4, 1e-4, 1e-5, 1e-4, 1e-5, 1e-4])
"""Steps of the differences in x, y, speed, heading, acceleration, yaw rate and jerk, SI units. Chosen by hand."""


def sigmas_of_measures(
    pair: Pair, covariances: tuple[FloatArray, FloatArray], measures: Mapping[str, Measure]
) -> dict[str, FloatArray]:
    """Compute the sigmas of pointwise measures at each of the host's stamps.

    Args:
        pair: Both vehicles at r stamps.
        covariances: Covariances of the host's and the other's states then, (r, 8, 8) each.
        measures: The measures by name.

    Returns:
        Name -> (r,); NaN where the covariances are not known, or the measure is not smooth.
    """
    n, rows = len(DIFFERENTIATION_STEPS_OF_STATES), len(pair.stamp_ns)
    total = {name: np.zeros(rows) for name in measures}
    for is_host, covariance in zip((True, False), covariances, strict=True):
        slopes = {name: np.zeros((rows, n)) for name in measures}
        for column in range(n):
            ends = [
                _pair_with_shifted_state(pair, is_host, column, sign * DIFFERENTIATION_STEPS_OF_STATES[column])
                for sign in (-1.0, 1.0)
            ]
            for name, measure in measures.items():
                low, high = (end.evaluate_measure(measure) for end in ends)
                with np.errstate(invalid="ignore"):
                    slopes[name][:, column] = (high - low) / (2.0 * DIFFERENTIATION_STEPS_OF_STATES[column])
        for name, slope in slopes.items():
            total[name] += np.einsum("ri,rij,rj->r", slope, covariance[:, :n, :n], slope)
    return {name: np.where(value >= 0.0, np.sqrt(np.maximum(value, 0.0)), np.nan) for name, value in total.items()}


def _pair_with_shifted_state(pair: Pair, is_host: bool, column: int, step: float) -> Pair:
    """The pair with one quantity of one vehicle's states changed by a step."""
    host, others, own, theirs = (
        pair.host.state,
        pair.other_states,
        pair.host_accel_yaw_rate_jerk,
        pair.other_derivatives,
    )
    states, motions = ([host, others], [own, theirs])
    which = 0 if is_host else 1
    if column < 4:
        states[which] = _copy_with_shifted_column(states[which], column, step)
    else:
        motions[which] = _copy_with_shifted_column(motions[which], column - 4, step)
    track = ActualTrack(pair.stamp_ns, np.concatenate([states[0][:, :4], motions[0]], axis=1))
    return pair.with_states(track, states[1], motions[1])


def _copy_with_shifted_column(values: FloatArray, column: int, step: float) -> FloatArray:
    """A copy of the values with a step added to one column."""
    out = values.copy()
    out[:, column] += step
    return out


def measure_series_table(ego_id: str, pairs: Sequence[MeasuredPair], measures: Mapping[str, Measure]) -> Table:
    """The table with one row per moment of a pair, pair by pair."""
    lengths = np.array([len(pair.stamp_ns) for pair in pairs], int)
    other_id = Strings(
        np.repeat(np.arange(len(pairs), dtype=np.int32), lengths), tuple(pair.other_id for pair in pairs)
    )
    series = {name: entry for name, entry in measures.items() if entry.is_series}
    columns = {
        entry.column: np.concatenate([np.zeros(0), *(pair.values[name] for pair in pairs)])
        for name, entry in series.items()
    }
    stamp_ns = np.concatenate([np.zeros(0, np.int64), *(pair.stamp_ns for pair in pairs)])
    docs = {entry.column: ColumnDoc(unit=entry.unit, doc=entry.summary) for entry in series.values()}
    ids = {"ego_id": repeat_string(ego_id, len(stamp_ns)), "other_id": other_id}
    return Table("measures", {**ids, "stamp_ns": stamp_ns, **columns}, docs=docs)


def measure_extremes_table(ego_id: str, pairs: Sequence[MeasuredPair], measures: Mapping[str, Measure]) -> Table:
    """The table with one row per measure of a pair, for the whole time (encounter 0) and for each encounter."""
    rows = [(pair.other_id, extreme) for pair in pairs for extreme in pair.extremes]

    def integer_column(name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
        return np.array([getattr(extreme, name) for _, extreme in rows], np.int64)

    def float_column(name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        return np.array([getattr(extreme, name) for _, extreme in rows], np.float64)

    return Table(
        "extremes",
        {
            "ego_id": repeat_string(ego_id, len(rows)),
            "other_id": encode_strings([other for other, _ in rows]),
            "encounter": integer_column("encounter"),
            "begin_stamp_ns": integer_column("begin_ns"),
            "end_stamp_ns": integer_column("end_ns"),
            "measure": encode_strings([extreme.measure for _, extreme in rows]),
            "value": float_column("value"),
            "unit": [measures[extreme.measure].unit for _, extreme in rows],
            "stamp_ns": integer_column("stamp_ns"),
            "sigma": float_column("sigma"),
        },
        docs={
            "encounter": ColumnDoc(doc="0: the whole time within 200 m; from 1: encounters within 50 m"),
            "stamp_ns": ColumnDoc(doc="time of the value; -1: it belongs to the whole encounter, or there is none"),
            "sigma": ColumnDoc(doc="standard error of the value, to first order by the states' covariances"),
        },
    )
