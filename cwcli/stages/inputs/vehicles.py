"""What the warning rules take: vehicles' states, each with the path that starts from it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cwcli.channels.predicted_path import AnyPaths, LazyPaths
from cwcli.channels.vehicle_state import VehicleStates
from cwcli.errors import DataError
from cwcli.pipeline.paths import PATH_TIME_BEYOND_HORIZON_S
from cwcli.prediction.models import MODELS
from cwcli.prediction.plan import PathPlan, SelectedPaths
from cwcli.prediction.rollout import RolloutSettings
from cwcli.prediction.turn_end import TurnEndingPaths, left_turn_on_last_stretch_rad
from cwcli.signals.columns import FloatArray
from cwcli.signals.road_events import RoadEvents, hard_braking_known_mask_or_none
from cwcli.signals.row_order import iter_track_rows
from cwcli.warning.types import VehicleTrack, median_length_and_width_m

MANOEUVRE_ONSET_MODEL_NAME = "onset"
"""Name of the motion model that predicts a manoeuvre that has just begun."""


def require_single_ego(tracks: Sequence[VehicleTrack], *, where: str) -> VehicleTrack:
    """Return the ego's track.

    Raises:
        DataError: There are several tracks, or none has a path.
    """
    if len(tracks) != 1:
        raise DataError(f"expected the states of one ego, found {len(tracks)}", where=where)
    return tracks[0]


def build_vehicle_tracks(
    states: VehicleStates, predicted: AnyPaths, *, with_onset: bool = False, events: RoadEvents | None = None
) -> list[VehicleTrack]:
    """Build one track per vehicle: its states, in stamp order, each with the path that starts from it.

    Args:
        with_onset: Add the paths of the onset hypothesis, which are not published.
        events: Road events that the vehicles reported.
    """
    path_rows = dict(iter_track_rows(predicted.ids, predicted.stamp_ns))
    tracks = []
    for vehicle, all_rows in iter_track_rows(states.ids, states.stamp_ns):
        candidates = path_rows.get(vehicle)
        if candidates is None:
            continue
        _, mine, theirs = np.intersect1d(
            states.stamp_ns[all_rows], predicted.stamp_ns[candidates], assume_unique=True, return_indices=True
        )
        if not len(mine):
            continue
        rows, candidates = all_rows[mine], candidates[theirs]
        length_m, width_m = median_length_and_width_m(states.length_m[rows], states.width_m[rows])
        tracks.append(
            VehicleTrack(
                id=vehicle,
                stamp_ns=states.stamp_ns[rows],
                log_time_ns=states.log_time_ns[rows],
                state=states.state[rows],
                paths=predicted.select_paths(candidates),
                length_m=length_m,
                width_m=width_m,
                onset_paths=_predict_onset_paths(states, rows, predicted.time_s) if with_onset else None,
                flags=states.flags[rows],
                says_hard_braking=None
                if events is None
                else hard_braking_known_mask_or_none(events, vehicle, states.stamp_ns[rows], states.log_time_ns[rows]),
            )
        )
    return tracks


def predict_paths_with_settings_of(states: VehicleStates, like: AnyPaths, *, where: str) -> LazyPaths:
    """Predict paths from the states with the model, step and horizon of the paths `like`.

    Raises:
        DataError: The others were predicted with a model that is not known here, or there are none.
    """
    if like.model not in MODELS:
        raise DataError(f"the paths' motion model {like.model!r} is not known", where=where, hint="predict again")
    time_s = like.time_s
    horizon_s = float(time_s[-1]) + PATH_TIME_BEYOND_HORIZON_S
    return LazyPaths.from_states(
        states,
        PathPlan(like.model, RolloutSettings(horizon_s, float(time_s[1] - time_s[0])), states.state, states.covariance),
    )


def _predict_onset_paths(states: VehicleStates, rows: npt.NDArray[np.intp], time_s: FloatArray) -> TurnEndingPaths:
    """Predict paths of the onset hypothesis from some states, over the same times as the predicted ones."""
    step_s = float(time_s[1] - time_s[0])
    plan = PathPlan(
        MANOEUVRE_ONSET_MODEL_NAME, RolloutSettings(float(time_s[-1]), step_s), states.state, states.covariance
    )
    turned_rad = left_turn_on_last_stretch_rad(states.stamp_ns[rows], states.log_time_ns[rows], states.state[rows])
    return TurnEndingPaths(SelectedPaths(plan, rows), turned_rad)
