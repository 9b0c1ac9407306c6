"""The headline metrics of a log: which there are, how they are measured, and how they are pooled over logs.

A metric's value is a function of two sums, so that logs can be pooled without their samples:

| pool | value of one log | of several logs |
|---|---|---|
| `rms` | sqrt(total / weight): total is a sum of squares, weight the number of samples | the same, of the sums |
| `mean` | total / weight: a mean, a share, or a rate (weight in hours) | the same, of the sums |
| `sum` | total | the sum of the totals |
| `max`, `min` | total | the extreme of the totals |
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import field
from functools import cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass, replace
from cwcli.metrics.bounds import Bounds
from cwcli.metrics.intervals import UNKNOWN_INTERVAL, poisson_interval, proportion_interval
from cwcli.metrics.table import ColumnDoc, Table
from cwcli.signals.columns import FloatArray

Pool = Literal["rms", "mean", "sum", "max", "min"]
Better = Literal["lower", "higher", "near", ""]
Interval = Literal["", "share", "rate"]

HEADLINE_METRICS_TABLE_NAME = "metrics"
"""Name of the table of headline metrics."""
METRICS_TABLE_COLUMNS = ("stage", "metric", "value", "unit", "n", "low", "high", "pool", "total", "weight", "states")
"""Columns of the table of headline metrics, in order; the fields of `MetricRow` in `pooling` agree."""
COLUMNS_MISSING_IN_EARLIER_VERSIONS = ("states",)
"""Columns that tables of earlier versions do not have."""


@dataclass(frozen=True)
class Metric:
    """One headline metric.

    Attributes:
        name: Dotted name with the unit at its end; `<model>`, `<horizon>` and others are placeholders.
        stage: The stage whose result it measures.
        unit: Unit of the value, "" for shares and counts.
        pool: How total and weight give the value; see the module.
        better: Which way is better; `near`: near `target`; "": neither.
        doc: One line.
        target: See `better`.
        interval: `share`: Wilson's of total out of weight; `rate`: the exact Poisson one of a count per weight. Only
            where the samples are independent of each other.
        is_compared: `cwcli compare` gives a verdict on it.
    """

    name: str
    stage: str
    unit: str
    pool: Pool
    better: Better
    doc: str
    target: float = math.nan
    interval: Interval = ""
    is_compared: bool = False

    @property
    def is_share(self) -> bool:
        """Whether the metric is a mean without a unit; changes of such a metric are absolute, not relative."""
        return self.unit == "" and self.pool == "mean"


PATTERN_BY_PLACEHOLDER = {
    "<quantity>": "position|velocity|speed|heading|accel|yaw_rate",
    "<model>": "[a-z0-9][a-z0-9-]*",
    "<horizon>": r"\d+\.\d",
    "<rule>": "[a-z0-9][a-z0-9-]*",
    "<measure>": "[a-z][a-z0-9_]*",
}
"""Placeholder in a metric's name -> the regular expression of what may be filled in."""


def _prediction_metrics(who: str, whom: str) -> tuple[Metric, ...]:
    """Return the prediction metrics of the ego or of the remote vehicles."""
    own = f"prediction.{who}"
    first = who == "ego"
    return (
        Metric(f"{own}.fde_2.5s_m", "predict", "m", "mean", "lower",
               f"mean distance between {whom} predicted point and its own later estimate, 2.5 s ahead",
               is_compared=True),
        Metric(f"{own}.fde_<horizon>s_m", "predict", "m", "mean", "lower", "the same at other horizons"),
        Metric(f"{own}.ade_<horizon>s_m", "predict", "m", "mean", "lower",
               "as fde, averaged over the steps up to the horizon"),
        Metric(f"{own}.inside_90_<horizon>s_share", "predict", "", "mean", "near",
               "share of the outcomes inside the predicted 90 % ellipse", 0.9),
        Metric(f"{own}.<model>.fde_<horizon>s_m", "predict", "m", "mean", "lower",
               "as fde, of each motion model from the same starts"),
        Metric(f"{own}.<model>.inside_90_<horizon>s_share", "predict", "", "mean", "near",
               "as inside_90, of each motion model", 0.9),
        *((Metric(f"{own}.truth_fde_2.5s_m", "predict", "m", "mean", "lower",
                  "mean distance between the predicted point and the truth, 2.5 s ahead", is_compared=True),
           Metric(f"{own}.truth_fde_<horizon>s_m", "predict", "m", "mean", "lower", "the same at other horizons"),
           Metric(f"{own}.truth_inside_90_<horizon>s_share", "predict", "", "mean", "near",
                  "share of the truth inside the predicted 90 % ellipse", 0.9)) if first else ()),
    )  # fmt: skip


def _system_metrics() -> Iterator[Metric]:
    """Yield another system's metrics: cwcli's own with `system.` in front of their names."""
    prediction = (metric for metric in _prediction_metrics("ego", "the ego's") if "<model>" not in metric.name)
    for metric in (*WARNING_METRICS, *EGO_STATE_METRICS_AGAINST_TRUTH, *prediction):
        if "inside_90" not in metric.name:
            yield replace(metric, name=f"system.{metric.name}", stage="system", doc=f"of another system: {metric.doc}")


EGO_STATE_METRICS_AGAINST_TRUTH: tuple[Metric, ...] = (
    Metric("ego.position_rmse_m", "estimate", "m", "rms", "lower",
           "horizontal distance from the truth (two axes together)", is_compared=True),
    Metric("ego.along_rmse_m", "estimate", "m", "rms", "lower", "its part along the true heading"),
    Metric("ego.cross_rmse_m", "estimate", "m", "rms", "lower", "its part across the true heading"),
    Metric("ego.position_max_m", "estimate", "m", "max", "lower", "greatest distance from the truth"),
    Metric("ego.speed_rmse_mps", "estimate", "m/s", "rms", "lower", "speed minus the truth's", is_compared=True),
    Metric("ego.heading_rmse_deg", "estimate", "deg", "rms", "lower", "heading minus the truth's", is_compared=True),
    Metric("ego.yaw_rate_rmse_degps", "estimate", "deg/s", "rms", "lower", "yaw rate minus the truth's",
           is_compared=True),
)  # fmt: skip
"""Metrics of the ego's state against the truth, for cwcli's state and for another system's."""

WARNING_METRICS: tuple[Metric, ...] = (
    Metric("warnings.count", "warn", "", "sum", "", "warnings raised"),
    Metric("warnings.conflicts_count", "warn", "", "sum", "", "real conflicts, by the definition of `cwcli warn`"),
    Metric("warnings.missed_count", "warn", "", "sum", "lower", "real conflicts without a warning"),
    Metric("warnings.false_count", "warn", "", "sum", "lower", "warnings that no conflict followed"),
    Metric("warnings.undecided_count", "warn", "", "sum", "",
           "warnings after which the tracks end too early to tell"),
    Metric("warnings.precision", "warn", "", "mean", "higher",
           "share of the decided warnings that a conflict followed", interval="share", is_compared=True),
    Metric("warnings.recall", "warn", "", "mean", "higher", "share of the real conflicts that were warned of",
           interval="share", is_compared=True),
    Metric("warnings.timeliness", "warn", "", "mean", "higher",
           "of the conflicts warned of, the share whose warning came before they began", interval="share",
           is_compared=True),
    Metric("warnings.lead_time_mean_s", "warn", "s", "mean", "higher",
           "from the first warning of a conflict to its beginning; negative: late", is_compared=True),
    Metric("warnings.lead_time_min_s", "warn", "s", "min", "higher", "the shortest lead time"),
    Metric("warnings.false_alarms_per_hour", "warn", "1/h", "mean", "lower",
           "false warnings per hour of the host's track, with the exact Poisson interval", interval="rate",
           is_compared=True),
    Metric("warnings.raised_per_hour", "warn", "1/h", "mean", "",
           "warnings per hour of the host's track, with the same interval",
           interval="rate"),
)  # fmt: skip
"""Metrics of collision warnings, for cwcli's first rule and for another system."""

METRICS: tuple[Metric, ...] = (
    *EGO_STATE_METRICS_AGAINST_TRUTH,
    *(replace(metric, name=metric.name.replace("ego.", "ego.online_"),
              doc=f"as ego.{metric.name.removeprefix('ego.')}, of the online states; by hindsight without a truth")
      for metric in EGO_STATE_METRICS_AGAINST_TRUTH),
    Metric("ego.online_delay_mean_s", "estimate", "s", "mean", "lower",
           "from the time of an online state to when it could be known"),
    Metric("ego.accel_rmse_mps2", "estimate", "m/s^2", "rms", "lower", "longitudinal acceleration minus the truth's",
           is_compared=True),
    Metric("ego.position_nees", "estimate", "", "mean", "near",
           "normalised error squared of the position: 2 if the covariance is right", 2.0, is_compared=True),
    Metric("ego.position_nees_inside", "estimate", "", "mean", "higher",
           "1 if its mean is within its 95 % bounds, else 0; pooled: the share of the logs"),
    Metric("ego.position_inside_95_share", "estimate", "", "mean", "near",
           "share of the truth inside the estimated 95 % ellipse", 0.95),
    Metric("ego.fix_residual_rmse_m", "estimate", "m", "rms", "",
           "position fixes minus the estimate; says nothing of who is right"),
    Metric("ego.distance_km", "estimate", "km", "sum", "", "the way that the ego drove, by its estimate"),
    Metric("ego.sigma_median_m", "estimate", "m", "mean", "", "median of the position's one sigma per axis"),
    Metric("ego.<quantity>_nis", "estimate", "", "mean", "near",
           "normalised innovation squared per degree of freedom: 1 if the noise is right", 1.0),
    Metric("ego.<quantity>_nis_inside", "estimate", "", "mean", "higher",
           "1 if it is within its 95 % bounds, else 0; several sources of a quantity: their share"),
    Metric("ego.nis_inside_share", "estimate", "", "mean", "higher",
           "share of the ego's sources whose innovations lie within their 95 % bounds", is_compared=True),
    Metric("ego.gated_share", "estimate", "", "mean", "lower", "share of the ego's measurements that the gate rejected",
           is_compared=True),
    Metric("remote.nis_inside_share", "estimate", "", "mean", "higher",
           "as ego.nis_inside_share, over all remote vehicles", is_compared=True),
    Metric("remote.gated_share", "estimate", "", "mean", "lower", "as ego.gated_share, over all remote vehicles",
           is_compared=True),
    Metric("remote.vehicles_count", "estimate", "", "sum", "", "remote vehicles"),
    Metric("link.stations_count", "estimate", "", "sum", "", "stations whose V2X messages were received"),
    Metric("link.loss_share", "estimate", "", "mean", "lower",
           "share of the V2X messages sent that did not arrive, by the senders' counts"),
    Metric("link.age_p95_s", "estimate", "s", "max", "lower",
           "age of the newest V2X message of a station that was exceeded 5 % of the time"),
    Metric("link.latency_p95_s", "estimate", "s", "max", "lower",
           "latency of V2X messages that 5 % of a station's exceeded, the worst station"),
    Metric("link.range_max_m", "estimate", "m", "max", "higher", "greatest distance of reception of a V2X message"),
    *_prediction_metrics("ego", "the ego's"),
    *_prediction_metrics("remote", "a remote vehicle's"),
    *WARNING_METRICS,
    Metric("warnings.raised_per_100km", "warn", "1/100 km", "mean", "",
           "warnings per 100 km of the host's way, with the exact Poisson interval", interval="rate"),
    Metric("warnings.preventable_share", "warn", "", "mean", "",
           "share of the real conflicts that a careful human would have avoided, in control from 8 s before",
           interval="share"),
    Metric("warnings.withheld_count", "warn", "", "sum", "",
           "warnings that were not raised because a state was starting, after a reset or in a gap"),
    Metric("warnings.<rule>.precision", "warn", "", "mean", "higher", "of one of several rules", interval="share"),
    Metric("warnings.<rule>.recall", "warn", "", "mean", "higher", "of one of several rules", interval="share"),
    Metric("warnings.<rule>.timeliness", "warn", "", "mean", "higher", "of one of several rules", interval="share"),
    Metric("warnings.<rule>.lead_time_mean_s", "warn", "s", "mean", "higher", "of one of several rules"),
    Metric("warnings.<rule>.false_alarms_per_hour", "warn", "1/h", "mean", "lower", "of one of several rules",
           interval="rate"),
    Metric("warnings.lane_departure_count", "warn", "", "sum", "", "warnings of leaving the lane"),
    Metric("measures.min_<measure>", "measure", "", "min", "higher",
           "the least value over all pairs of a measure for which low is critical (docs/measures.md), in its unit"),
    Metric("measures.max_<measure>", "measure", "", "max", "lower", "the greatest of one for which high is critical"),
    Metric("lanes.found_share", "lanes", "", "mean", "higher", "share of the frames with both boundaries",
           is_compared=True),
    Metric("lanes.left_found_share", "lanes", "", "mean", "higher", "share of the frames with a left boundary"),
    Metric("lanes.right_found_share", "lanes", "", "mean", "higher", "share of the frames with a right boundary"),
    Metric("lanes.width_std_m", "lanes", "m", "rms", "lower", "standard deviation of the lane's width 10 m ahead",
           is_compared=True),
    Metric("lanes.width_near_share", "lanes", "", "mean", "higher",
           "share of the frames whose width is within 5 % of the median"),
    Metric("lanes.width_max_jump_m", "lanes", "m", "max", "lower", "greatest change of the width between two frames"),
    Metric("lanes.truth_accuracy", "lanes", "", "mean", "higher",
           "TuSimple's accuracy against the two labelled lines next to the camera", is_compared=True),
    Metric("lanes.truth_false_share", "lanes", "", "mean", "lower", "TuSimple's false positives for the same lines",
           is_compared=True),
    Metric("lanes.truth_missed_share", "lanes", "", "mean", "lower", "TuSimple's false negatives for the same lines",
           is_compared=True),
    Metric("lanes.lateral_deviation_rmse_m", "lanes", "m", "rms", "lower",
           "lateral deviation at the preview point minus the truth's", is_compared=True),
    Metric("lanes.heading_deviation_rmse_deg", "lanes", "deg", "rms", "lower",
           "heading deviation there minus the truth's"),
    Metric("lanes.curvature_rmse_1pm", "lanes", "1/m", "rms", "lower", "curvature there minus the truth's"),
    Metric("lanes.lateral_5m_rmse_m", "lanes", "m", "rms", "lower",
           "lateral position of the found boundaries minus the truth's, 5 m ahead"),
    Metric("lanes.lateral_10m_rmse_m", "lanes", "m", "rms", "lower", "the same, 10 m ahead"),
    Metric("lanes.lateral_20m_rmse_m", "lanes", "m", "rms", "lower", "the same, 20 m ahead"),
    Metric("lanes.lateral_30m_rmse_m", "lanes", "m", "rms", "lower", "the same, 30 m ahead"),
    Metric("observer.lateral_speed_rmse_mps", "observe", "m/s", "rms", "lower",
           "observed lateral speed minus the truth's, once the observer has settled", is_compared=True),
    Metric("observer.yaw_rate_rmse_degps", "observe", "deg/s", "rms", "lower",
           "observed yaw rate minus the truth's", is_compared=True),
    Metric("observer.lateral_deviation_rmse_m", "observe", "m", "rms", "lower",
           "lateral deviation at the observer's own preview point minus the truth's", is_compared=True),
    Metric("observer.heading_deviation_rmse_deg", "observe", "deg", "rms", "lower",
           "heading deviation there minus the truth's", is_compared=True),
    Metric("tracking.gospa_m", "track", "m", "mean", "lower",
           "GOSPA (cutoff 5 m, order 2), averaged over the moments of the truth", is_compared=True),
    Metric("tracking.position_rmse_m", "track", "m", "rms", "lower", "of the targets that are tracked",
           is_compared=True),
    Metric("tracking.velocity_rmse_mps", "track", "m/s", "rms", "lower", "of the targets that are tracked",
           is_compared=True),
    Metric("tracking.tracked_share", "track", "", "mean", "higher",
           "share of the targets' moments at which they are tracked",
           is_compared=True),
    Metric("tracking.switch_count", "track", "", "sum", "lower", "changes of a target's track id"),
    Metric("tracking.nis_inside_share", "track", "", "mean", "higher",
           "share of the sensors whose innovations lie within their 95 % bounds", is_compared=True),
    Metric("tracking.targets_count", "track", "", "sum", "", "tracks"),
    *_system_metrics(),
    Metric("data.duration_s", "data", "s", "sum", "", "from the first to the last message"),
    Metric("data.read_count", "data", "", "sum", "", "messages read, once for each role"),
    Metric("data.used_count", "data", "", "sum", "", "messages used"),
    Metric("data.rejected_count", "data", "", "sum", "lower", "messages rejected"),
    Metric("data.repaired_count", "data", "", "sum", "lower", "messages repaired"),
    Metric("data.rejected_share", "data", "", "mean", "lower", "rejected out of read", is_compared=True),
    Metric("data.faults_count", "data", "", "sum", "lower",
           "kinds of fault in the file: bad CRCs, lost bytes, undecodable messages of a topic"),
    Metric("doubts.count", "doubts", "", "sum", "lower", "reasons to doubt the results ([digest](digest.md))"),
)  # fmt: skip
"""All headline metrics, in the order in which tables and comparisons list them."""


@cache
def _metric_name_patterns() -> tuple[tuple[re.Pattern[str], Metric], ...]:
    """Return the pattern of each metric's name, placeholders filled in, and the metric."""
    found = []
    for metric in METRICS:
        pattern = re.escape(metric.name)
        for placeholder, inner in PATTERN_BY_PLACEHOLDER.items():
            pattern = pattern.replace(re.escape(placeholder), f"(?:{inner})")
        found.append((re.compile(pattern), metric))
    return tuple(found)


@cache
def find_metric(name: str) -> Metric | None:
    """Return the metric of a name with filled-in placeholders; None if there is none."""
    return next((metric for pattern, metric in _metric_name_patterns() if pattern.fullmatch(name)), None)


def metric_sort_index(name: str) -> int:
    """Return the index of a metric in `METRICS`, for sorting; unknown metrics come last."""
    metric = find_metric(name)
    return len(METRICS) if metric is None else METRICS.index(metric)


def metric_value_from_sums(pool: str, total: float, weight: float) -> float:
    """Return a metric's value from its sums (see the module); NaN without a positive weight."""
    if not weight > 0.0 or math.isnan(total):
        return math.nan
    if pool == "rms":
        return math.sqrt(max(total, 0.0) / weight)
    return total / weight if pool == "mean" else total


def metric_interval_from_sums(kind: Interval, total: float, weight: float) -> Bounds:
    """Return the 95 % interval of a share or of a rate; NaN where the metric has none."""
    if kind == "share" and weight > 0.0:
        return proportion_interval(round(total), round(weight))
    if kind == "rate" and weight > 0.0:
        low, high = poisson_interval(round(total))
        return Bounds(low / weight, high / weight)
    return UNKNOWN_INTERVAL


@dataclass
class HeadlineCollector:
    """Collects the rows of one log.

    Attributes:
        rows: The rows, in the order of `METRICS_TABLE_COLUMNS`.
        states: The states that the next rows compare, such as `online vs truth`; "" for metrics of anything else.
    """

    rows: list[tuple[str, str, float, str, int, float, float, str, float, float, str]] = field(default_factory=list)
    states: str = ""

    @contextmanager
    def label_rows_with_states(self, states: str) -> Iterator[None]:
        """Label the rows that are added inside the block with these states."""
        before, self.states = self.states, states
        try:
            yield
        finally:
            self.states = before

    def add_from_sums(self, name: str, total: float, weight: float, *, n: int | None = None) -> None:
        """Add a row from its two sums.

        Args:
            name: A metric of `METRICS`, placeholders filled in.
            n: Number of samples; None: the weight.

        Raises:
            ValueError: There is no such metric.
        """
        metric = find_metric(name)
        if metric is None:
            raise ValueError(f"no metric is called {name}")
        value = metric_value_from_sums(metric.pool, total, weight)
        low, high = metric_interval_from_sums(metric.interval, total, weight)
        count = round(weight) if n is None else n
        sums = (metric.pool, total, weight, self.states)
        self.rows.append((metric.stage, name, value, metric.unit, count, low, high, *sums))

    def add_errors(self, name: str, errors: FloatArray) -> None:
        """Add the `rms`, `mean`, `max` or `min` of errors (n,), by the metric's pool; nothing if all are NaN."""
        known = errors[np.isfinite(errors)]
        metric = find_metric(name)
        if not len(known) or metric is None:
            return
        if metric.pool == "rms":
            self.add_from_sums(name, float(np.sum(known * known)), len(known))  # no BLAS: its order of summing varies
        elif metric.pool == "mean":
            self.add_from_sums(name, float(known.sum()), len(known))
        else:
            extreme = known.max() if metric.pool == "max" else known.min()
            self.add_from_sums(name, float(extreme), 1.0, n=len(known))

    def add_share(self, name: str, is_counted: npt.NDArray[np.bool_] | Sequence[bool]) -> None:
        """Add the share of the true values; nothing without values."""
        if len(is_counted):
            self.add_from_sums(name, float(np.count_nonzero(is_counted)), len(is_counted))

    def add_count(self, name: str, total: float) -> None:
        """Add a number that is summed over logs."""
        self.add_from_sums(name, float(total), 1.0)

    def to_table(self, **metadata: str) -> Table:
        """Return the rows as a table, in the order in which they were added."""
        columns = list(zip(*self.rows, strict=True)) if self.rows else [()] * len(METRICS_TABLE_COLUMNS)
        numeric = {"value": np.float64, "n": np.int64, "low": np.float64, "high": np.float64}
        numeric |= {"total": np.float64, "weight": np.float64}
        return Table(
            HEADLINE_METRICS_TABLE_NAME,
            {
                name: np.array(column, numeric[name]) if name in numeric else list(column)
                for name, column in zip(METRICS_TABLE_COLUMNS, columns, strict=True)
            },
            docs={
                "value": ColumnDoc(doc="NaN where there was nothing to judge"),
                "n": ColumnDoc(doc="samples behind the value"),
                "low": ColumnDoc(doc="95 % interval; NaN where there is none"),
                "states": ColumnDoc(doc="which states were compared: online, hindsight, truth; empty without a state"),
                "pool": ColumnDoc(doc="how total and weight make the value, of one log or of several"),
            },
            metadata=metadata,
        )
