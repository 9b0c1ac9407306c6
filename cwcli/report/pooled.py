"""All logs of a run together: pooled metrics, how they spread over the logs, and the logs that stand out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.headline import find_metric
from cwcli.metrics.pooling import LogMetrics, MetricRow, metric_names, pool_all_metrics
from cwcli.pipeline.records import Record, parse_json_entry_or_empty, read_finite_number_or_nan, read_latency_s
from cwcli.report.tables import format_metric_value
from cwcli.signals.columns import FloatArray
from cwcli.signals.normal_distribution import SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION
from cwcli.signals.vehicle_state import EGO_ID
from cwcli.text import format_interval
from cwcli.text import format_number as shown

METRICS_SHOWN_BUT_NOT_COMPARED = (
    "data.duration_s",
    "ego.distance_km",
    "ego.position_nees",
    "ego.online_delay_mean_s",
    "link.latency_p95_s",
    "link.age_p95_s",
    "warnings.count",
    "warnings.missed_count",
    "warnings.raised_per_hour",
    "warnings.raised_per_100km",
)
"""Metrics that are shown besides those that runs are compared by. Chosen by hand; not fitted."""
METRICS_OF_DRIVE_LENGTH = ("data.duration_s", "ego.distance_km")
"""Metrics of a drive's length, in which no log counts as an outlier."""
MAX_OUTLIER_LOGS_NAMED_PER_METRIC = 3
"""The greatest number of outlier logs that are named for a metric. Chosen by hand; not fitted."""
MAX_LISTED_SOURCES = 20
"""The greatest number of sources in the table of all logs. Chosen by hand; not fitted."""
N_HISTOGRAM_BINS = 24
"""Number of bins of a histogram. Chosen by hand; not fitted."""
HISTOGRAM_WIDTH_PX = 192
"""Width of a histogram in pixels. Chosen by hand; not fitted."""
HISTOGRAM_HEIGHT_PX = 26
"""Height of a histogram in pixels. Chosen by hand; not fitted."""
OUTLIER_SIGMAS = 5.0
"""Least distance of an outlier log from the median, in sigmas by the median deviation: one in 1.7 million by chance."""
MIN_SIGMA_SHARE_OF_MEDIAN = 0.05
"""The least sigma as a share of the median, so that values that nearly agree have no outliers.
Chosen by hand; not fitted."""
MIN_SIGMA_OF_COUNTS = 1.0
"""The least sigma of counts, as one more or less is ordinary where most logs have none. Chosen by hand; not fitted."""
MIN_SIGMA_OF_TIMES_S = 0.005
"""The least sigma of times, in s. Chosen by hand; not fitted."""
MAX_DRAWN_MAGNITUDE = 1e300
"""Magnitude at which larger values are drawn, as their differences would overflow a double."""
AXIS_REACH_IN_INTERQUARTILE_RANGES = 3.0
"""The axis reaches this many interquartile ranges beyond the quartiles; values beyond are drawn at its ends.
Chosen by hand; not fitted."""


@dataclass(frozen=True)
class OutlierLog:
    """An outlier log: its name, its anchor ("" without figures), its value, and where it is drawn."""

    name: str
    anchor: str
    value: str
    at_px: float


@dataclass(frozen=True)
class HistogramBar:
    """A bar of a histogram, in pixels, and the number of its logs."""

    x_px: float
    height_px: float
    n: int


@dataclass(frozen=True)
class Histogram:
    """The histogram of the logs' values: its bars from `low` to `high`, and a description."""

    bars: tuple[HistogramBar, ...]
    low: str
    high: str
    words: str


@dataclass(frozen=True)
class PooledMetric:
    """A metric over all logs.

    Attributes:
        value, between: Pooled by samples, hours or ways, and its 95 % interval.
        odd: The logs that stand out, the farthest first.
    """

    name: str
    unit: str
    doc: str
    value: str
    between: str
    n_logs: int
    n_samples: int
    median: str
    spread: Histogram
    odd: tuple[OutlierLog, ...]


@dataclass(frozen=True)
class SourceInLog:
    """What the estimator found of a source in one log; NaN where the record has no value."""

    log: str
    source: str
    quantity: str
    latency_s: float
    nis: float
    is_nis_inside_bounds: bool | None
    gated: float
    used: float


@dataclass(frozen=True)
class PooledSource:
    """A source over all logs, as text for the page."""

    source: str
    quantity: str
    n_logs: int
    latency: str
    latency_between: str
    nis: str
    outside: str
    gated: str
    odd: tuple[OutlierLog, ...]


def pool_metrics(logs: Sequence[LogMetrics], anchors: Mapping[str, str]) -> tuple[PooledMetric, ...]:
    """Pool the metrics over all logs that have them; () of fewer than two logs.

    Args:
        anchors: Log -> where its part of the page is.
    """
    known = [log for log in logs if log.rows]
    if len(known) < 2:
        return ()
    names = [name for name in metric_names(known) if is_pooled_metric(name)]
    of_interest = [LogMetrics(log.id, {name: log.rows[name] for name in names if name in log.rows}) for log in known]
    found = []
    for name, row in pool_all_metrics(of_interest).items():
        values = {log.id: log.rows[name].value for log in of_interest if name in log.rows}
        finite = {log: value for log, value in values.items() if math.isfinite(value)}
        if len(finite) > 1 and math.isfinite(row.value):
            found.append(_build_pooled_metric(row, finite, anchors))
    return tuple(found)


def is_pooled_metric(name: str) -> bool:
    """Return whether the page shows a metric over all logs."""
    metric = find_metric(name)
    return metric is not None and (metric.is_compared or name in METRICS_SHOWN_BUT_NOT_COMPARED)


def _build_pooled_metric(row: MetricRow, values: Mapping[str, float], anchors: Mapping[str, str]) -> PooledMetric:
    """Build the row of a metric over all logs."""
    metric = find_metric(row.metric)
    drawable = _clip_to_drawable(values.values())
    spread, low, high = build_histogram_and_axis_ends(drawable, row.metric)
    return PooledMetric(
        name=row.metric,
        unit=row.unit,
        doc="" if metric is None else metric.doc,
        value=format_metric_value(row.metric, row.value),
        between=format_interval(row.low, row.high),
        n_logs=len(values),
        n_samples=row.n,
        median=shown(float(np.median(drawable))),
        spread=spread,
        odd=()
        if row.metric in METRICS_OF_DRIVE_LENGTH
        else find_outlier_logs(row.metric, values, anchors, low, high, min_outlier_sigma(row.metric, row.unit)),
    )


def _clip_to_drawable(values: Iterable[float]) -> FloatArray:
    """Clip values to what can be drawn."""
    return np.clip(np.array(list(values), np.float64), -MAX_DRAWN_MAGNITUDE, MAX_DRAWN_MAGNITUDE)


def build_histogram_and_axis_ends(values: FloatArray, metric_name: str) -> tuple[Histogram, float, float]:
    """Build the histogram of at least one finite value (n,), and return it with the ends of its axis."""
    ends = format_metric_value(metric_name, float(values.min())), format_metric_value(metric_name, float(values.max()))
    values = _clip_to_drawable(values)
    first, third = np.quantile(values, [0.25, 0.75])
    reach = AXIS_REACH_IN_INTERQUARTILE_RANGES * (third - first)
    low, high = max(float(values.min()), first - reach), min(float(values.max()), third + reach)
    if not high > low:  # all but a few agree
        low, high = float(values.min()), float(values.max())
    edges = (
        np.linspace(low, high, N_HISTOGRAM_BINS + 1)
        if high > low
        else np.linspace(low - 0.5, high + 0.5, N_HISTOGRAM_BINS + 1)
    )
    counts, _ = np.histogram(np.clip(values, edges[0], edges[-1]), edges)
    step = HISTOGRAM_WIDTH_PX / N_HISTOGRAM_BINS
    bars = tuple(
        HistogramBar(
            round(k * step, 1), round(max(2.0, HISTOGRAM_HEIGHT_PX * float(n) / float(counts.max())), 1), int(n)
        )
        for k, n in enumerate(counts.tolist())
        if n
    )
    words = f"{len(values)} logs from {ends[0]} to {ends[1]}"
    return Histogram(bars, *ends, words), float(edges[0]), float(edges[-1])


def min_outlier_sigma(name: str, unit: str) -> float:
    """Return the least sigma of a metric in the search for outlier logs, in its unit."""
    if name.endswith(("_count", ".count")):
        return MIN_SIGMA_OF_COUNTS
    return MIN_SIGMA_OF_TIMES_S if unit == "s" else 0.0


def find_outlier_logs(
    name: str, values: Mapping[str, float], anchors: Mapping[str, str], low: float, high: float, min_sigma: float
) -> tuple[OutlierLog, ...]:
    """Find the logs whose value is far from the others', the farthest first; () of fewer than four logs.

    Where more than half of the logs agree exactly, these tell nothing of how far apart ordinary logs lie: then one
    log alone stands out, and several don't.

    Args:
        anchors: Log -> where its part of the page is.
        min_sigma: See `min_outlier_sigma`.
    """
    if len(values) < 4:
        return ()
    drawable = dict(zip(values, _clip_to_drawable(values.values()).tolist(), strict=True))
    median = float(np.median(list(drawable.values())))
    spread = SIGMA_PER_MEDIAN_ABSOLUTE_DEVIATION * float(
        np.median([abs(value - median) for value in drawable.values()])
    )
    reach = OUTLIER_SIGMAS * max(spread, MIN_SIGMA_SHARE_OF_MEDIAN * abs(median), min_sigma, 1e-9)
    far = sorted(
        (log for log, value in drawable.items() if abs(value - median) > reach),
        key=lambda log: (-abs(drawable[log] - median), log),
    )
    if spread == 0.0 and len(far) > 1:
        return ()
    return tuple(
        OutlierLog(
            log,
            anchors.get(log, ""),
            format_metric_value(name, values[log]),
            round(float(np.clip((drawable[log] - low) / (high - low), 0.0, 1.0)) * HISTOGRAM_WIDTH_PX, 1),
        )
        for log in far[:MAX_OUTLIER_LOGS_NAMED_PER_METRIC]
    )


def read_ego_sources(log: str, record: Record) -> list[SourceInLog]:
    """Read the ego's sources from a record of `estimate`; entries of another form are left out."""
    found = []
    for entry in parse_json_entry_or_empty(record, "sources", list):
        if isinstance(entry, dict) and entry.get("vehicle") == EGO_ID:
            inside = entry.get("nis_inside")
            found.append(
                SourceInLog(
                    log,
                    str(entry.get("source")),
                    str(entry.get("quantity")).replace("_", " "),
                    read_latency_s(entry, "latency_found_s"),
                    read_finite_number_or_nan(entry, "nis_per_dof"),
                    inside if isinstance(inside, bool) else None,
                    read_finite_number_or_nan(entry, "gated"),
                    read_finite_number_or_nan(entry, "used"),
                )
            )
    return found


def pool_sources(sources: Sequence[SourceInLog], anchors: Mapping[str, str]) -> tuple[tuple[PooledSource, ...], int]:
    """Pool each source and quantity that at least two logs have, the most frequent first.

    Returns:
        At most MAX_SOURCES, and how many there are.
    """
    groups: dict[tuple[str, str], list[SourceInLog]] = {}
    for each in sources:
        groups.setdefault((each.source, each.quantity), []).append(each)
    shown_groups = sorted((group for group in groups.values() if len(group) > 1), key=lambda group: -len(group))
    return tuple(_pool_source(group, anchors) for group in shown_groups[:MAX_LISTED_SOURCES]), len(shown_groups)


def _pool_source(group: Sequence[SourceInLog], anchors: Mapping[str, str]) -> PooledSource:
    """Pool one source and quantity."""
    latencies = {each.log: 1e3 * each.latency_s for each in group if math.isfinite(each.latency_s)}
    nis = [each.nis for each in group if math.isfinite(each.nis)]
    are_inside_bounds = [each.is_nis_inside_bounds for each in group if each.is_nis_inside_bounds is not None]
    gated = sum(each.gated for each in group if each.gated >= 0.0)
    used = sum(each.used for each in group if each.used >= 0.0)
    drawable = np.array(list(latencies.values()))
    return PooledSource(
        source=group[0].source,
        quantity=group[0].quantity,
        n_logs=len(group),
        latency=f"{np.median(drawable):.0f}" if len(drawable) else "-",
        latency_between=f"{drawable.min():.0f} to {drawable.max():.0f}" if len(drawable) else "",
        nis=f"{np.median(nis):.2f}" if nis else "-",
        outside=f"{are_inside_bounds.count(False)} of {len(are_inside_bounds)}" if are_inside_bounds else "-",
        gated=f"{shown(100.0 * gated / (gated + used), 3)} %" if 0.0 < gated + used < math.inf else "-",
        odd=find_outlier_logs("", latencies, anchors, 0.0, 1.0, 1e3 * MIN_SIGMA_OF_TIMES_S),
    )
