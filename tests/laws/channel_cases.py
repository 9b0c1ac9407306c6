"""Messages of every published channel, as its writer makes them, and what its reader must give back."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cwcli.channels.control_step import CONTROL_STEP_FIELDS_THAT_VARY_BY_STEP, ReplayedSteps, make_replay_channels
from cwcli.channels.ego_viewers import make_ego_channels
from cwcli.channels.image_lines import LINE_LOOP, ImageShape, make_image_annotation_channel
from cwcli.channels.lanes import LaneFrames, LaneRows, make_lane_annotation_channel, make_lanes_channel, read_lanes
from cwcli.channels.lateral_state import (
    ObservedDrive,
    make_observer_channel,
    read_lateral_truth_stamps_and_states,
    read_observed_drive,
)
from cwcli.channels.measures import make_measures_channel
from cwcli.channels.path_scene import make_path_scene_channel
from cwcli.channels.predicted_path import PredictedPaths, make_predicted_path_channel, read_predicted_paths
from cwcli.channels.published import (
    EGO_ONLINE,
    EGO_PATH,
    OBSERVER_PATH,
    OBSERVER_PATH_LINES,
    REMOTE_ONLINE,
    REMOTE_PATH,
    REMOTE_STATE,
    TARGETS_ONLINE,
)
from cwcli.channels.rejected import make_rejected_measurement_channel, read_gated_measurements
from cwcli.channels.road_event import make_road_event_channels, read_road_events
from cwcli.channels.target import make_target_channels, read_targets_as_states
from cwcli.channels.vehicle_state import VehicleStates, make_vehicle_state_channel, read_vehicle_states
from cwcli.channels.warning import make_warning_and_log_channels, read_warnings
from cwcli.control.encounter import BRAKING_POLICY_NAMES
from cwcli.dynamics.samples import STATE_NAMES as LATERAL_NAMES
from cwcli.dynamics.samples import FrameStatus, LateralTrack, count_frame_statuses
from cwcli.estimation.result import GatedMeasurements
from cwcli.prediction.paths import Paths
from cwcli.signals.columns import Columns, OutputChannel, Strings, encode_strings
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.packed_covariances import PackedCovariances
from cwcli.signals.precision import round_to_binary_step
from cwcli.signals.road_events import RoadEvents
from cwcli.signals.vehicle_state import N_STATES
from cwcli.tracking.tracker import TargetTrack, TrackResult
from cwcli.vision.camera import Camera
from cwcli.vision.fit_columns import FitColumns
from cwcli.vision.ground import LaneGeometry
from cwcli.warning.rows import CLEARED, HELD, RAISED, WarningRow, build_warning_rows

T0_NS = 1_700_000_000_000_000_000
STEP_NS = 50_000_000
N = 7
MAP = LocalMap(48.1, 11.5, 500.0)
ROOT = Path(__file__).parents[2]
Order = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Written:
    """What a writer made.

    Attributes:
        channels: Its channels.
        given: Topic -> what a reader must give back.
        readers: Topic -> the reader.
    """

    channels: tuple[OutputChannel, ...]
    given: Mapping[str, Any] = field(default_factory=dict)
    readers: Mapping[str, Callable[[Columns], Any]] = field(default_factory=dict)


def times(n: int, *, shuffled: np.random.Generator | None = None) -> tuple[Any, Any]:
    """Stamps, and later log times that go up; both shuffled in the same way, as messages arrive late."""
    stamp_ns = T0_NS + STEP_NS * np.arange(n, dtype=np.int64)
    order = np.arange(n) if shuffled is None else shuffled.permutation(n)
    return stamp_ns[order], stamp_ns[order] + 5_000_000


def definite(rng: np.random.Generator, n: int, size: int) -> npt.NDArray[np.float64]:
    root = rng.normal(size=(n, size, size))
    return np.asarray(root @ root.transpose(0, 2, 1) + np.eye(size))


def names(n: int) -> Strings:
    return encode_strings([("ego", "other", "third")[k % 3] for k in range(n)])


def sorted_like(given: Any, log_time_ns: npt.NDArray[np.int64]) -> Any:
    """The rows of a value in log-time order, whatever it is made of."""
    order = np.argsort(log_time_ns, kind="stable")
    if isinstance(given, Strings):
        return given.select_rows(order)
    if isinstance(given, np.ndarray):
        return given[order] if len(given) == len(order) else given
    if isinstance(given, Paths):
        return given.paths_of_rows(order)
    if dataclasses.is_dataclass(given) and not isinstance(given, type):
        values = {each.name: getattr(given, each.name) for each in dataclasses.fields(given)}
        return dataclasses.replace(given, **{name: sorted_like(value, log_time_ns) for name, value in values.items()})
    return given


def of_states(rng: np.random.Generator, n: int) -> Written:
    stamp_ns, log_time_ns = times(n, shuffled=rng)
    length_m, width_m = rng.uniform(1.0, 5.0, (2, n))
    state, covariance = (
        round_to_binary_step(rng.normal(size=(n, N_STATES)), 11),
        PackedCovariances.from_dense(definite(rng, n, N_STATES)),
    )
    flags = rng.integers(0, 8, n).astype(np.uint8)
    states = VehicleStates(names(n), stamp_ns, log_time_ns, state, covariance, length_m, width_m, flags)
    channels = tuple(
        make_vehicle_state_channel(channel, states, MAP) for channel in (EGO_ONLINE, REMOTE_STATE, REMOTE_ONLINE)
    )
    topics = [channel.topic for channel in channels]
    return Written(
        channels, dict.fromkeys(topics, sorted_like(states, log_time_ns)), dict.fromkeys(topics, read_vehicle_states)
    )


def of_ego(rng: np.random.Generator, n: int) -> Written:
    state, covariance = (
        round_to_binary_step(rng.normal(size=(n, N_STATES)), 11),
        PackedCovariances.from_dense(definite(rng, n, N_STATES)),
    )
    states = VehicleStates.from_ego_states(times(n)[0], state, covariance)
    channels = make_ego_channels(states, MAP)
    return Written(channels, {channels[0].topic: states}, {channels[0].topic: read_vehicle_states})


def paths_of(rng: np.random.Generator, n: int, *, k: int = 5) -> PredictedPaths:
    stamp_ns, log_time_ns = times(n)
    x_m, y_m, heading_rad, speed_mps = (rng.normal(size=(n, k)) for _ in range(4))
    paths = Paths(0.1 * np.arange(k, dtype=np.float64), x_m, y_m, heading_rad, speed_mps, rng.normal(size=(n, k, 3)))
    return PredictedPaths(names(n), stamp_ns, log_time_ns, "ctra" if n else "", paths)


def of_paths(rng: np.random.Generator, n: int) -> Written:
    written, given = [], {}
    for channel in (EGO_PATH, REMOTE_PATH, OBSERVER_PATH):
        stamp_ns, log_time_ns = times(n, shuffled=rng)
        predicted = dataclasses.replace(paths_of(rng, n), stamp_ns=stamp_ns, log_time_ns=log_time_ns)
        written.append(
            make_predicted_path_channel(channel, predicted, frame_id="odom" if channel is OBSERVER_PATH else "")
        )
        given[channel.topic] = sorted_like(predicted, log_time_ns) if n else paths_of(rng, 0, k=0)  # no path, no length
    return Written(tuple(written), given, dict.fromkeys(given, read_predicted_paths))


def of_path_scene(rng: np.random.Generator, n: int) -> Written:
    return Written((make_path_scene_channel([paths_of(rng, n), paths_of(rng, n)]),))


def of_targets(rng: np.random.Generator, n: int) -> Written:
    stamp_ns = times(n)[0]
    state = np.column_stack([rng.normal(size=(n, 2)), 5.0 + rng.uniform(size=(n, 2)), rng.normal(size=n)])
    sources = np.zeros(n, np.int64)
    track = TargetTrack(4, stamp_ns, state, definite(rng, n, 5), sources, T0_NS)
    result = TrackResult((track,), "map", ("/lidar",), {}, {}, ("x_m", "y_m", "vx_mps", "vy_mps", "turn_rate_radps"))
    known_ns = stamp_ns, stamp_ns + 9
    channels = make_target_channels(result, in_map=True, known_ns=known_ns)
    online = make_target_channels(result, in_map=True, known_ns=known_ns, channel=TARGETS_ONLINE)
    speed = np.hypot(*state[:, 2:4].T)
    given = {
        "ids": encode_strings(["4"] * n),
        "stamp_ns": stamp_ns,
        "log_time_ns": stamp_ns + 9,
        "xy": state[:, :2],
        "velocity": state[:, 2:4],
        "yaw_rate_radps": state[:, 4],
        "position_covariance": track.covariance[:, :2, :2],
        "yaw_rate_variance": track.covariance[:, 4, 4],
    }

    def read(columns: Columns) -> dict[str, Any]:
        back = read_targets_as_states(columns)
        heading, yaw_rate = back.state[:, 3], back.state[:, 5]
        np.testing.assert_allclose(back.state[:, 2], speed)
        return {
            "ids": back.ids,
            "stamp_ns": back.stamp_ns,
            "log_time_ns": back.log_time_ns,
            "xy": back.state[:, :2],
            "velocity": back.state[:, 2:3] * np.column_stack([np.cos(heading), np.sin(heading)]),
            "yaw_rate_radps": yaw_rate,
            "position_covariance": back.covariance[:, :2, :2],
            "yaw_rate_variance": back.covariance[:, 5, 5],
        }

    topics = (channels[0].topic, online[0].topic)
    return Written((*channels, *online), dict.fromkeys(topics, given), dict.fromkeys(topics, read))


def of_warnings(rng: np.random.Generator, n: int) -> Written:
    stamp_ns, log_time_ns = times(n)
    states = [RAISED, HELD, HELD, CLEARED]
    rows = [
        WarningRow(log, stamp, log - 1, 1 + k // 4, states[k % 4], f"v{k % 2}", f"says {k}", *rng.uniform(size=5))
        for k, (stamp, log) in enumerate(zip(stamp_ns.tolist(), log_time_ns.tolist(), strict=True))
    ]
    cwcli, ttc = (
        build_warning_rows(part, rule=rule, host_id="ego") for rule, part in (("a", rows[::2]), ("b", rows[1::2]))
    )
    channels = make_warning_and_log_channels([cwcli, ttc])
    whole = build_warning_rows(rows, rule="a", host_id="ego")
    rules = encode_strings(["ab"[k % 2] for k in range(n)])
    return Written(
        channels, {channels[0].topic: dataclasses.replace(whole, rule=rules)}, {channels[0].topic: read_warnings}
    )


def of_replays(rng: np.random.Generator, n: int) -> Written:
    stamp_ns = times(n)[0]
    states = tuple(round_to_binary_step(rng.normal(size=(n, N_STATES)), 11) for _ in BRAKING_POLICY_NAMES)
    series = tuple(
        {name: rng.uniform(size=n) for name in CONTROL_STEP_FIELDS_THAT_VARY_BY_STEP[:-1]} for _ in BRAKING_POLICY_NAMES
    )
    series = tuple({**each, CONTROL_STEP_FIELDS_THAT_VARY_BY_STEP[-1]: np.zeros(n, np.bool_)} for each in series)
    replays = [ReplayedSteps(1, "car", stamp_ns, states, series)]
    channels = make_replay_channels(replays, host_size_m=(4.5, None), local_map=MAP)
    given = {
        channel.topic: VehicleStates.from_ego_states(stamp_ns, states[policy], size_m=(4.5, None))
        for policy, channel in enumerate(channels[::3])
    }
    return Written(channels, given, dict.fromkeys(given, read_vehicle_states))


def of_lanes(rng: np.random.Generator, n: int) -> Written:
    stamp_ns, log_time_ns = times(n)
    found = rng.uniform(size=(n, 2)) > 0.4
    parabolas = np.where(found[..., None], rng.normal(size=(n, 2, 3)), np.nan)
    nothing = np.full((n, 2, 3, 3), np.nan)
    score, probability = (rng.uniform(size=(n, 2)) for _ in range(2))
    state, change = rng.integers(1, 4, n).astype(np.int8), rng.integers(-1, 2, n).astype(np.int8)
    steady_s = rng.uniform(0.0, 9.0, n)
    kind, colour = rng.integers(0, 3, (2, n, 2)).astype(np.int8)
    fits = FitColumns(
        parabolas,
        score,
        probability,
        found,
        nothing,
        np.zeros(n),
        np.zeros(n),
        state,
        steady_s,
        change,
        nothing[:, :, 0],
        kind,
        colour,
        np.full((n, 7, 7), np.nan),
    )
    road, numbers = rng.normal(size=(n, 2, 3)), rng.normal(size=(8, n))
    geometry = LaneGeometry(road[:, 0], road[:, 1], *numbers)
    frames = LaneFrames(
        index=np.arange(n),
        log_time_ns=log_time_ns,
        stamp_ns=stamp_ns,
        image_size=np.tile([640, 480], (n, 1)),
        search_size=np.tile([320, 240], (n, 1)),
        horizon_px=rng.uniform(80.0, 100.0, n),
        camera_pitch_rad=rng.normal(size=n),
        camera_yaw_rad=rng.normal(size=n),
        fits=fits,
        roads=np.where(found[..., None], rng.normal(size=(n, 2, 4)), np.nan),
        top_px=rng.uniform(100.0, 120.0, n),
        pinhole=rng.uniform(100.0, 120.0, (n, 2)),
        geometry=geometry,
        preview_m=33.5,
        rectified_from=(lambda width_px, height_px: Camera(width_px, height_px, 500.0, 501.0, 320.0, 240.0))
        if n
        else None,
    )
    lanes = make_lanes_channel(frames)
    given = {
        "stamp_ns": stamp_ns,
        "log_time_ns": log_time_ns,
        "found": found,
        "road": road,
        "preview": numbers[:3].T,
        "preview_sigma": numbers[3:6].T,
        "preview_m": np.full(n, 33.5),
        "lane_width_m": numbers[6],
        "curvature_change_1pm2": numbers[7],
        "camera_pitch_rad": frames.camera_pitch_rad,
        "camera_yaw_rad": frames.camera_yaw_rad,
        "image_size": frames.image_size,
        "search_size": frames.search_size,
        "parabolas": parabolas,
        "roads": frames.roads,
        "horizon_px": frames.horizon_px,
        "top_px": frames.top_px,
        "pinhole": frames.pinhole,
        "focal_length_px": [500.0] * n,
        "state": state,
        "steady_s": steady_s,
        "lane_change": change,
    }

    def read(columns: Columns) -> dict[str, Any]:
        back: LaneRows = read_lanes(columns)
        found: dict[str, Any] = {name: getattr(back, name, None) for name in given}
        found |= {
            name: getattr(back.image_boundaries, name)
            for name in ("parabolas", "roads", "horizon_px", "top_px", "pinhole")
        }
        focal_px = [getattr(back.lenses.camera_before_rectification(row), "fx", None) for row in range(n)]
        return found | {"focal_length_px": focal_px}

    return Written((lanes, make_lane_annotation_channel(frames)), {lanes.topic: given}, {lanes.topic: read})


def of_observed(rng: np.random.Generator, n: int) -> Written:
    stamp_ns, log_time_ns = times(n)
    status = rng.integers(0, len(FrameStatus), n).astype(np.int8)
    speed_mps, steer_rad, curvature_1pm, mass_kg, sigma_kg = (rng.normal(size=n) for _ in range(5))
    track = LateralTrack(
        stamp_ns,
        rng.normal(size=(n, len(LATERAL_NAMES))),
        rng.uniform(2.0, 33.5, n),
        definite(rng, n, len(LATERAL_NAMES)),
        speed_mps,
        steer_rad,
        curvature_1pm,
        mass_kg,
        sigma_kg,
        status,
        count_frame_statuses(status),
    )
    observed = ObservedDrive(log_time_ns, track)
    channel = make_observer_channel(observed)

    def read(columns: Columns) -> Any:
        back = read_observed_drive(columns)
        truth_ns, truth = read_lateral_truth_stamps_and_states(columns)
        np.testing.assert_array_equal(truth_ns, back.track.stamp_ns)
        np.testing.assert_array_equal(truth, back.track.state)
        return back

    return Written((channel,), {channel.topic: observed}, {channel.topic: read})


def of_path_lines(rng: np.random.Generator, n: int) -> Written:
    stamp_ns, log_time_ns = times(n)
    colour = (0.1, 0.2, 0.3, 0.4)

    def shapes(start: int, stop: int) -> list[list[ImageShape]]:
        shape = ImageShape(LINE_LOOP, rng.uniform(size=(4, 2)), colour, colour, 2.0)
        return [[shape] * (row % 3) for row in range(start, stop)]

    return Written(
        (make_image_annotation_channel(OBSERVER_PATH_LINES, stamp_ns=stamp_ns, log_time_ns=log_time_ns, shapes=shapes),)
    )


def of_measures(rng: np.random.Generator, n: int) -> Written:
    stamp_ns, log_time_ns = times(n)
    ego = VehicleStates.from_ego_states(stamp_ns, rng.normal(size=(n, N_STATES)))
    ego = dataclasses.replace(ego, log_time_ns=log_time_ns)
    columns = {"stamp_ns": stamp_ns, "ego_id": ego.ids, "other_id": names(n), "ttc_s": rng.normal(size=n)}
    return Written((make_measures_channel(ego, columns),))


def of_rejected(rng: np.random.Generator, n: int) -> Written:
    stamp_ns, _ = times(n)
    gated = GatedMeasurements(stamp_ns, names(n), names(n), rng.uniform(11.0, 500.0, n), np.full(n, 10.8))
    channel = make_rejected_measurement_channel(gated)
    return Written((channel,), {channel.topic: gated}, {channel.topic: read_gated_measurements})


def of_road_events(rng: np.random.Generator, n: int) -> Written:
    stamp_ns, log_time_ns = times(n)
    numbers = [rng.normal(size=n) for _ in range(5)]
    events = RoadEvents(names(n), names(n), stamp_ns, log_time_ns, stamp_ns + STEP_NS, *numbers)
    (channel,) = make_road_event_channels(events, MAP)
    return Written((channel,), {channel.topic: events}, {channel.topic: read_road_events})


CASES = (
    of_rejected,
    of_road_events,
    of_measures,
    of_states,
    of_ego,
    of_paths,
    of_path_scene,
    of_targets,
    of_warnings,
    of_replays,
    of_lanes,
    of_observed,
    of_path_lines,
)
