"""The measures of a pair: at each moment at which the two are near, and the most critical values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair
from cwcli.measures.uncertainty import sigma_of
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.units import NS_PER_S

BLOCK = 2048
"""Moments that are measured at once: what they take stays in the processor's cache."""
ENCOUNTER_RANGE_M = 50.0
ENCOUNTER_PAUSE_S = 2.0
WHOLE = 0
"""Number of the whole time that two were near; encounters count from 1."""


@dataclass(frozen=True)
class MeasuredPair:
    """One pair at the moments at which its centres are within the range.

    Attributes:
        other_id: The other vehicle.
        stamp_ns: Shape (m,).
        values: Measure -> its series, (m,).
        extremes: The most critical values, of the whole and of each encounter.
    """

    other_id: str
    stamp_ns: Int64Array
    values: Mapping[str, FloatArray]
    extremes: tuple[Extreme, ...]


@dataclass(frozen=True)
class Extreme:
    """The most critical value of a measure in a stretch of time.

    Attributes:
        encounter: `WHOLE`, or a number from 1.
        begin_ns, end_ns: The stretch.
        measure: Its name.
        value: NaN: it has none.
        stamp_ns: When; -1 of a number for the whole stretch.
        sigma: By the states' covariances to first order; NaN where they are not known.
    """

    encounter: int
    begin_ns: int
    end_ns: int
    measure: str
    value: float
    stamp_ns: int
    sigma: float


def measure_pair(other_id: str, pair: Pair, measures: Mapping[str, Measure]) -> MeasuredPair:
    """The measures of one pair; the extremes without sigmas."""
    near = pair.near
    values = {name: np.full(len(near), np.nan) for name, measure in measures.items() if measure.is_series}
    for first in range(0, len(near), BLOCK):
        block = pair.rows(near[first : first + BLOCK])
        for name, measure in measures.items():
            if measure.is_pointwise:
                values[name][first : first + BLOCK] = block.value(measure)
    for name, measure in measures.items():
        if measure.is_series and not measure.is_pointwise:
            values[name][:] = pair.value(measure)[near]
    extremes: list[Extreme] = []
    for encounter, rows in enumerate([np.arange(len(near)), *_encounters(pair)]):
        if len(rows):
            extremes += _extremes(encounter, pair, rows, values, measures)
    return MeasuredPair(other_id, pair.stamp_ns[near], values, tuple(extremes))


def _encounters(pair: Pair) -> list[npt.NDArray[np.intp]]:
    """Rows of `near` of each stretch within `ENCOUNTER_RANGE_M`; what is interrupted for less than a pause is one."""
    near = pair.near
    rows = np.flatnonzero(pair.distance_m[near] <= ENCOUNTER_RANGE_M)
    if not len(rows):
        return []
    pauses = np.flatnonzero(np.diff(pair.stamp_ns[near[rows]]) > ENCOUNTER_PAUSE_S * NS_PER_S)
    parts = np.split(rows, pauses + 1)
    return [np.arange(part[0], part[-1] + 1) for part in parts]


def _extremes(
    encounter: int,
    pair: Pair,
    rows: npt.NDArray[np.intp],
    values: Mapping[str, FloatArray],
    measures: Mapping[str, Measure],
) -> list[Extreme]:
    near = pair.near
    stretch = pair.between(int(near[rows[0]]), int(near[rows[-1]]) + 1)
    begin_ns, end_ns = int(pair.stamp_ns[near[rows[0]]]), int(pair.stamp_ns[near[rows[-1]]])
    found: list[Extreme] = []
    for name, measure in measures.items():
        if not measure.is_series:
            value, stamp_ns = float(stretch.value(measure)), -1
        else:
            series = values[name][rows]
            worst = _worst(series, measure)
            value, stamp_ns = np.nan, -1
            if worst >= 0:
                value, stamp_ns = float(series[worst]), int(pair.stamp_ns[near[rows[worst]]])
        found.append(Extreme(encounter, begin_ns, end_ns, name, value, stamp_ns, np.nan))
    return found


def moments(measured: MeasuredPair, measures: Mapping[str, Measure]) -> Int64Array:
    """The stamps of the extremes that can have a sigma, increasing."""
    return np.unique(np.array([each.stamp_ns for each in measured.extremes if _is_smooth(each, measures)], np.int64))


def with_sigmas(
    measured: MeasuredPair, at: Pair, measures: Mapping[str, Measure], covariances: tuple[FloatArray, FloatArray]
) -> MeasuredPair:
    """The pair with the sigmas of its extremes.

    Args:
        measured: Without them.
        at: The pair at the `moments`.
        measures: Which.
        covariances: Of the host and of the other then, (r, 8, 8) each.
    """
    asked = {each.measure: measures[each.measure] for each in measured.extremes if _is_smooth(each, measures)}
    sigmas = sigma_of(at, covariances, asked)
    row = {stamp_ns: k for k, stamp_ns in enumerate(at.stamp_ns.tolist())}
    extremes = tuple(
        replace(each, sigma=float(sigmas[each.measure][row[each.stamp_ns]])) if _is_smooth(each, measures) else each
        for each in measured.extremes
    )
    return replace(measured, extremes=extremes)


def _is_smooth(extreme: Extreme, measures: Mapping[str, Measure]) -> bool:
    measure = measures[extreme.measure]
    is_smooth = measure.is_pointwise and not measure.is_stepped
    return extreme.stamp_ns >= 0 and is_smooth and bool(np.isfinite(extreme.value))


def _worst(series: FloatArray, measure: Measure) -> int:
    """Row of the most critical value, -1 where there is none."""
    known = np.flatnonzero(~np.isnan(series))
    if not len(known):
        return -1
    at = series[known].argmin() if measure.critical == "low" else series[known].argmax()
    return int(known[at])
