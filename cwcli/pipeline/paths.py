"""The paths that `predict` makes of states, one from each, also where a log holds only some of them."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from cwcli.channels.predicted_path import (
    LENGTH_FRACTION_BITS,
    VARIANCE_BINARY_DIGITS,
    AnyPaths,
    LazyPathChannel,
    LazyPaths,
    PredictedPaths,
    read_predicted_paths,
)
from cwcli.channels.published import EGO_STATE, REMOTE_STATE
from cwcli.channels.vehicle_state import VehicleStates
from cwcli.errors import MissingSignalError, UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.pipeline.records import Record, read_configuration, read_run_records, to_int_or_none
from cwcli.pipeline.states import StatesSelection, bind_state_channels, read_selected_states
from cwcli.prediction.calibrate import plan_vehicle_paths
from cwcli.prediction.outcome_history import PathStarts
from cwcli.prediction.rollout import Discretisation, RolloutSettings, check_rollout_options
from cwcli.signals.columns import FloatArray
from cwcli.signals.row_order import iter_rows_by_id
from cwcli.signals.units import NS_PER_S

PATH_TIME_BEYOND_HORIZON_S = 1.0
"""Time [s] by which remote paths reach beyond the horizon, because their state is older than the moment at which they
are used; chosen by hand."""
SPAN_COMPARED_WITH_LOGGED_PATHS_NS = 2 * NS_PER_S
"""Log time [ns] over which logged paths are compared with paths that were planned again; chosen by hand."""
SAME_POSITION_TOLERANCE_M = 2.0**-LENGTH_FRACTION_BITS
"""Greatest distance [m] of two equal path points: the step to which published lengths are rounded."""
SAME_VARIANCE_TOLERANCE = 2.0 ** (1 - VARIANCE_BINARY_DIGITS)
"""Greatest difference of equal covariances as a share of their size: twice the published rounding step."""


@dataclass(frozen=True)
class PathRequest:
    """The settings of `predict` on which paths depend."""

    model: str
    horizon_s: float
    step_s: float
    discretisation: Discretisation

    @classmethod
    def from_stage_config(cls, config: Any) -> PathRequest:
        """Return the request of a configuration of the stage."""
        return cls(**{each.name: getattr(config, each.name) for each in fields(cls)})


def plan_paths_from_states(states: VehicleStates, role: str, request: PathRequest) -> LazyPaths:
    """Plan a path from each state of the ego or of the remote vehicles; the points are computed when they are read."""
    horizon_s = request.horizon_s + (PATH_TIME_BEYOND_HORIZON_S if role == REMOTE_STATE.role else 0.0)
    settings = RolloutSettings(horizon_s, request.step_s, request.discretisation)
    return LazyPaths.from_states(states, plan_vehicle_paths(request.model, path_starts_from_states(states), settings))


def path_starts_from_states(states: VehicleStates) -> PathStarts:
    return PathStarts(states.ids.codes, states.stamp_ns, states.state, states.covariance, states.log_time_ns)


def replanned_or_logged_paths_and_notes(log: Log, topic: str, role: str) -> tuple[AnyPaths, tuple[str, ...]]:
    """Return a path from each state, and notes.

    A log holds only a few paths a second. The others are predicted again from the log's states, with the settings in
    the record of `predict`. Without such a record the log holds all paths.

    Args:
        topic: The channel of paths.
        role: The role of the states that they start from.

    Raises:
        DataError: The channel, or that of its states, was written by another version.
    """
    for channel in log.added_channels:
        if channel.topic == topic and isinstance(channel, LazyPathChannel):
            return channel.lazy_paths, ()
    record = read_run_records(log).get("predict", {})
    if max_path_rate_hz_or_none_if_every_state(record) is None:
        return read_predicted_paths(log.columns(topic)), ()
    planned = _replan_paths_from_record(log, role, record)
    if planned is not None and _replanned_paths_match_log(log, topic, planned):
        return planned, ()
    published = read_predicted_paths(log.columns(topic))
    note = f"{topic}: {len(published)} paths of the log are used, as its states do not give the same again"
    return published, (note,)


def max_path_rate_hz_or_none_if_every_state(record: Record) -> float | None:
    """Return the greatest rate of each vehicle's paths in the log [Hz]; None: one from each state."""
    rate_hz = read_configuration(record).get("path_rate_hz")
    return float(rate_hz) if isinstance(rate_hz, int | float) and not isinstance(rate_hz, bool) else None


def _replan_paths_from_record(log: Log, role: str, record: Record) -> LazyPaths | None:
    """Plan the paths with the settings in the record; return None where they don't fit the log.

    Raises:
        DataError: The states can't be read.
    """
    used = read_configuration(record)
    topics = used.get("topics")
    try:
        request = PathRequest(**{each.name: used[each.name] for each in fields(PathRequest)})
        check_rollout_options(request.model, request.discretisation, request.horizon_s, request.step_s)
        selection = StatesSelection(
            topics={str(k): str(v) for k, v in topics.items()} if isinstance(topics, dict) else {},
            start_ns=to_int_or_none(used.get("start_ns")),
            end_ns=to_int_or_none(used.get("end_ns")),
            states="online" if used.get("states") == "online" else "hindsight",
        )
    except (UsageError, KeyError, TypeError, ValueError):  # another version's record
        return None
    try:
        bound = bind_state_channels(
            log.channels, selection, required=(EGO_STATE.role,), optional=(REMOTE_STATE.role,), command="predict"
        )
        topic = bound.first_topic_of_role(role)
        if topic is None:
            return None
        states, _ = read_selected_states(log, log.columns(topic), role, selection)
    except (MissingSignalError, UsageError):  # the record's topics, or all states of its span, are not in the log
        return None
    return plan_paths_from_states(states, role, request)


def _replanned_paths_match_log(log: Log, topic: str, planned: LazyPaths) -> bool:
    """Return whether the first paths of the log, and some from its middle, are among the planned ones."""
    if not len(planned):
        return False
    for at in (0, len(planned) // 2):
        first_ns = int(planned.log_time_ns[at])
        found = read_predicted_paths(
            log.load_topics({topic: None}, logged=(first_ns, first_ns + SPAN_COMPARED_WITH_LOGGED_PATHS_NS))[topic]
        )
        if not _are_logged_paths_among_planned(planned, found):
            return False
    return True


def _are_logged_paths_among_planned(planned: LazyPaths, logged: PredictedPaths) -> bool:
    """Return whether every found path is planned too, with equal end points and covariances."""
    own = {name: rows[np.argsort(planned.stamp_ns[rows], kind="stable")] for name, rows in iter_rows_by_id(planned.ids)}
    for name, rows in iter_rows_by_id(logged.ids):
        if name not in own:
            return False
        place = np.searchsorted(planned.stamp_ns[own[name]], logged.stamp_ns[rows])
        if (place == len(own[name])).any() or (planned.stamp_ns[own[name][place]] != logged.stamp_ns[rows]).any():
            return False
        again, said = planned.plan.paths_of_rows(own[name][place]), logged.paths.paths_of_rows(rows)
        if abs(again.time_s[-1] - said.time_s[-1]) > 1e-6:
            return False
        off_m = np.hypot(again.x_m[:, -1] - said.x_m[:, -1], again.y_m[:, -1] - said.y_m[:, -1])
        if (off_m > SAME_POSITION_TOLERANCE_M).any():
            return False
        if not _covariances_match(again.position_covariance_m2[:, -1], said.position_covariance_m2[:, -1]):
            return False
    return True


def _covariances_match(replanned_m2: FloatArray, logged_m2: FloatArray) -> bool:
    """Return whether plane covariances (n, 3) equal the published ones within the rounding of those."""
    sigma_m = np.sqrt(np.abs(logged_m2[:, [0, 2]]))
    size_m2 = sigma_m[:, [0, 0, 1]] * sigma_m[:, [0, 1, 1]]
    both_unknown = np.isnan(replanned_m2) & np.isnan(logged_m2)
    return bool((both_unknown | (np.abs(replanned_m2 - logged_m2) <= SAME_VARIANCE_TOLERANCE * size_m2)).all())
