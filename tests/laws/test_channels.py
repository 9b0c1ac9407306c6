"""Laws that every published channel obeys: what is written is in its schema, in order, and is read back as it was."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from cwcli.channels.control_step import SERIES, ReplayedSteps, write_replays
from cwcli.channels.ego_viewers import write_ego
from cwcli.channels.image_lines import LINE_LOOP, Shape, write_image_lines
from cwcli.channels.lanes import LaneFrames, LaneRows, read_lanes, write_lane_lines, write_lanes
from cwcli.channels.lateral_state import STATE_NAMES as LATERAL_NAMES
from cwcli.channels.lateral_state import Observed, read_lateral_truth, read_observed, write_observed
from cwcli.channels.path_scene import write_path_scene
from cwcli.channels.predicted_path import PredictedPaths, read_paths, write_paths
from cwcli.channels.published import (
    EGO_PATH,
    OBSERVER_PATH,
    OBSERVER_PATH_LINES,
    POLICY,
    PUBLISHED,
    REMOTE_PATH,
    REMOTE_STATE,
    Channel,
    topics,
)
from cwcli.channels.target import read_targets, write_targets
from cwcli.channels.vehicle_state import VehicleStates, read_states, write_states
from cwcli.channels.warning import read_warnings, write_warnings
from cwcli.control.encounter import POLICIES
from cwcli.dynamics.samples import FrameStatus, LateralTrack, count_statuses
from cwcli.errors import DataError
from cwcli.logs.read.reader import Log
from cwcli.logs.write.writer import LogWriter
from cwcli.prediction.paths import Paths
from cwcli.signals.columns import Columns, OutputChannel, Strings, strings_from
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.vehicle_state import N_STATES
from cwcli.tracking.tracker import TargetTrack, TrackResult
from cwcli.vision.camera import Camera
from cwcli.vision.fit_columns import FitColumns
from cwcli.vision.ground import LaneGeometry
from cwcli.warning.rows import CLEARED, HELD, RAISED, WarningRow, warning_rows

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
    return strings_from([("ego", "other", "third")[k % 3] for k in range(n)])


def sorted_like(given: Any, log_time_ns: npt.NDArray[np.int64]) -> Any:
    """The rows of a value in log-time order, whatever it is made of."""
    order = np.argsort(log_time_ns, kind="stable")
    if isinstance(given, Strings):
        return given.rows(order)
    if isinstance(given, np.ndarray):
        return given[order] if len(given) == len(order) else given
    if isinstance(given, Paths):
        return given.take(order)
    if dataclasses.is_dataclass(given) and not isinstance(given, type):
        values = {each.name: getattr(given, each.name) for each in dataclasses.fields(given)}
        return dataclasses.replace(given, **{name: sorted_like(value, log_time_ns) for name, value in values.items()})
    return given


def of_states(rng: np.random.Generator, n: int) -> Written:
    stamp_ns, log_time_ns = times(n, shuffled=rng)
    size_m = rng.uniform(1.0, 5.0, (2, n))
    state, covariance = rng.normal(size=(n, N_STATES)), definite(rng, n, N_STATES)
    states = VehicleStates(names(n), stamp_ns, log_time_ns, state, covariance, *size_m)
    topic = REMOTE_STATE.topic
    expected = {topic: sorted_like(states, log_time_ns)}
    return Written((write_states(REMOTE_STATE, states, MAP),), expected, {topic: read_states})


def of_ego(rng: np.random.Generator, n: int) -> Written:
    states = VehicleStates.of_ego(times(n)[0], rng.normal(size=(n, N_STATES)), definite(rng, n, N_STATES))
    channels = write_ego(states, MAP)
    return Written(channels, {channels[0].topic: states}, {channels[0].topic: read_states})


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
        written.append(write_paths(channel, predicted, frame_id="odom" if channel is OBSERVER_PATH else ""))
        given[channel.topic] = sorted_like(predicted, log_time_ns) if n else paths_of(rng, 0, k=0)  # no path, no length
    return Written(tuple(written), given, dict.fromkeys(given, read_paths))


def of_path_scene(rng: np.random.Generator, n: int) -> Written:
    return Written((write_path_scene([paths_of(rng, n), paths_of(rng, n)]),))


def of_targets(rng: np.random.Generator, n: int) -> Written:
    stamp_ns = times(n)[0]
    state = np.column_stack([rng.normal(size=(n, 2)), 5.0 + rng.uniform(size=(n, 2)), rng.normal(size=n)])
    sources = np.zeros(n, np.int64)
    track = TargetTrack(4, stamp_ns, state, definite(rng, n, 5), sources, T0_NS)
    result = TrackResult((track,), "map", ("/lidar",), {}, {}, ("x_m", "y_m", "vx_mps", "vy_mps", "turn_rate_radps"))
    channels = write_targets(result, in_map=True, known_ns=(stamp_ns, stamp_ns + 9))
    speed = np.hypot(*state[:, 2:4].T)
    given = {
        "ids": strings_from(["4"] * n),
        "stamp_ns": stamp_ns,
        "log_time_ns": stamp_ns + 9,
        "xy": state[:, :2],
        "velocity": state[:, 2:4],
        "yaw_rate_radps": state[:, 4],
        "position_covariance": track.covariance[:, :2, :2],
        "yaw_rate_variance": track.covariance[:, 4, 4],
    }

    def read(columns: Columns) -> dict[str, Any]:
        back = read_targets(columns)
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

    return Written(channels, {channels[0].topic: given}, {channels[0].topic: read})


def of_warnings(rng: np.random.Generator, n: int) -> Written:
    stamp_ns, log_time_ns = times(n)
    states = [RAISED, HELD, HELD, CLEARED]
    rows = [
        WarningRow(int(log), int(stamp), 1 + k // 4, states[k % 4], f"v{k % 2}", f"says {k}", *rng.uniform(size=5))
        for k, (stamp, log) in enumerate(zip(stamp_ns, log_time_ns, strict=True))
    ]
    cwcli, ttc = (warning_rows(part, rule=rule, host_id="ego") for rule, part in (("a", rows[::2]), ("b", rows[1::2])))
    channels = write_warnings([cwcli, ttc])
    whole = warning_rows(rows, rule="a", host_id="ego")
    rules = strings_from(["ab"[k % 2] for k in range(n)])
    return Written(
        channels, {channels[0].topic: dataclasses.replace(whole, rule=rules)}, {channels[0].topic: read_warnings}
    )


def of_replays(rng: np.random.Generator, n: int) -> Written:
    stamp_ns = times(n)[0]
    states = tuple(rng.normal(size=(n, N_STATES)) for _ in POLICIES)
    series = tuple({name: rng.uniform(size=n) for name in SERIES[:-1]} for _ in POLICIES)
    series = tuple({**each, SERIES[-1]: np.zeros(n, np.bool_)} for each in series)
    replays = [ReplayedSteps(1, "car", stamp_ns, states, series)]
    channels = write_replays(replays, host_size_m=(4.5, None), local_map=MAP)
    given = {
        channel.topic: VehicleStates.of_ego(stamp_ns, states[policy], size_m=(4.5, None))
        for policy, channel in enumerate(channels[::3])
    }
    return Written(channels, given, dict.fromkeys(given, read_states))


def of_lanes(rng: np.random.Generator, n: int) -> Written:
    stamp_ns, log_time_ns = times(n)
    found = rng.uniform(size=(n, 2)) > 0.4
    parabolas = np.where(found[..., None], rng.normal(size=(n, 2, 3)), np.nan)
    nothing = np.full((n, 2, 3, 3), np.nan)
    score, probability = (rng.uniform(size=(n, 2)) for _ in range(2))
    fits = FitColumns(parabolas, score, probability, found, nothing, np.zeros(n), np.zeros(n))
    road, numbers = rng.normal(size=(n, 2, 3)), rng.normal(size=(7, n))
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
        roads=np.where(found[..., None], rng.normal(size=(n, 2, 3)), np.nan),
        top_px=rng.uniform(100.0, 120.0, n),
        geometry=geometry,
        preview_m=33.5,
        rectified_from=(lambda width_px, height_px: Camera(width_px, height_px, 500.0, 501.0, 320.0, 240.0))
        if n
        else None,
    )
    lanes = write_lanes(frames)
    given = {
        "stamp_ns": stamp_ns,
        "log_time_ns": log_time_ns,
        "found": found,
        "road": road,
        "preview": numbers[:3].T,
        "preview_sigma": numbers[3:6].T,
        "preview_m": np.full(n, 33.5),
        "lane_width_m": numbers[6],
        "camera_pitch_rad": frames.camera_pitch_rad,
        "camera_yaw_rad": frames.camera_yaw_rad,
        "image_size": frames.image_size,
        "search_size": frames.search_size,
        "parabolas": parabolas,
        "roads": frames.roads,
        "horizon_px": frames.horizon_px,
        "top_px": frames.top_px,
        "focal_length_px": [500.0] * n,
    }

    def read(columns: Columns) -> dict[str, Any]:
        back: LaneRows = read_lanes(columns)
        found: dict[str, Any] = {name: getattr(back, name, None) for name in given}
        found |= {name: getattr(back.drawn, name) for name in ("parabolas", "roads", "horizon_px", "top_px")}
        focal_px = [getattr(back.lenses.camera(row), "fx", None) for row in range(n)]
        return found | {"focal_length_px": focal_px}

    return Written((lanes, write_lane_lines(frames)), {lanes.topic: given}, {lanes.topic: read})


def of_observed(rng: np.random.Generator, n: int) -> Written:
    stamp_ns, log_time_ns = times(n)
    status = rng.integers(0, len(FrameStatus), n).astype(np.int8)
    speed_mps, steer_rad, curvature_1pm, mass_kg, sigma_kg = (rng.normal(size=n) for _ in range(5))
    track = LateralTrack(
        stamp_ns,
        rng.normal(size=(n, len(LATERAL_NAMES))),
        definite(rng, n, len(LATERAL_NAMES)),
        speed_mps,
        steer_rad,
        curvature_1pm,
        mass_kg,
        sigma_kg,
        status,
        count_statuses(status),
    )
    observed = Observed(log_time_ns, track, 33.5)
    channel = write_observed(observed)

    def read(columns: Columns) -> Any:
        back = read_observed(columns)
        truth_ns, truth = read_lateral_truth(columns)
        np.testing.assert_array_equal(truth_ns, back.track.stamp_ns)
        np.testing.assert_array_equal(truth, back.track.state)
        return back

    return Written((channel,), {channel.topic: observed}, {channel.topic: read})


def of_path_lines(rng: np.random.Generator, n: int) -> Written:
    stamp_ns, log_time_ns = times(n)
    colour = (0.1, 0.2, 0.3, 0.4)

    def shapes(start: int, stop: int) -> list[list[Shape]]:
        shape = Shape(LINE_LOOP, rng.uniform(size=(4, 2)), colour, colour, 2.0)
        return [[shape] * (row % 3) for row in range(start, stop)]

    return Written((write_image_lines(OBSERVER_PATH_LINES, stamp_ns=stamp_ns, log_time_ns=log_time_ns, shapes=shapes),))


CASES = (
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
EACH = pytest.mark.parametrize("case", CASES)
SIZE = pytest.mark.parametrize("n", [0, 1, N])


def assert_same(found: Any, expected: Any, where: str = "") -> None:
    """Equal arrays; strings are compared as they read."""
    if isinstance(expected, Strings):
        texts = ([each.values[code] if code >= 0 else "" for code in each.codes] for each in (found, expected))
        assert next(texts) == next(texts), where
    elif isinstance(expected, Mapping):
        for name, value in expected.items():
            assert_same(found[name], value, f"{where}.{name}")
    elif dataclasses.is_dataclass(expected):
        for each in dataclasses.fields(expected):
            assert_same(getattr(found, each.name), getattr(expected, each.name), f"{where}.{each.name}")
    elif where.endswith(("velocity", "variance")):  # by way of speed and heading, and of sigmas
        np.testing.assert_allclose(found, expected, rtol=1e-12, err_msg=where)
    else:
        np.testing.assert_array_equal(found, expected, err_msg=where)


def test_every_published_channel_is_here_and_nothing_else() -> None:
    written = [channel for case in CASES for channel in case(np.random.default_rng(1), N).channels]
    assert {channel.topic: channel.schema_name for channel in written} == topics()
    roles = {channel.topic for channel in PUBLISHED if channel.role}
    read = {topic for case in CASES for topic in case(np.random.default_rng(1), N).readers}
    assert roles <= read  # what later stages find has a reader


@EACH
@SIZE
def test_rows_are_in_log_order_not_before_their_stamps_and_all_there(
    case: Callable[[np.random.Generator, int], Written], n: int
) -> None:
    for channel in case(np.random.default_rng(2), n).channels:
        log_time_ns = channel.log_time_ns
        assert log_time_ns.dtype == np.int64
        assert (np.diff(log_time_ns) >= 0).all()
        assert all(len(column) == len(log_time_ns) for column in channel.fields.values())
        stamps = channel.fields.get("stamp_ns", channel.fields.get("timestamp"))
        if stamps is not None:
            assert (np.asarray(stamps) <= log_time_ns).all()


@EACH
@SIZE
def test_the_file_holds_as_many_messages_and_other_libraries_decode_them(
    case: Callable[[np.random.Generator, int], Written], n: int, tmp_path: Path
) -> None:
    channels = case(np.random.default_rng(3), n).channels
    with LogWriter(tmp_path / "log.mcap") as log:
        for channel in channels:
            log.write_columns(channel)
    counts = {channel.topic: 0 for channel in channels}
    with (tmp_path / "log.mcap").open("rb") as stream:
        for schema, channel_of, _, _ in make_reader(
            stream, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            assert schema is not None
            assert schema.name == topics()[channel_of.topic]
            counts[channel_of.topic] += 1
    assert counts == {channel.topic: len(channel) for channel in channels}


@EACH
@SIZE
def test_what_is_read_back_is_what_was_given(
    case: Callable[[np.random.Generator, int], Written], n: int, tmp_path: Path
) -> None:
    written = case(np.random.default_rng(4), n)
    with LogWriter(tmp_path / "log.mcap") as writer:
        for channel in written.channels:
            writer.write_columns(channel)
    with Log.open(tmp_path / "log.mcap") as file, Log.open(ROOT / "sample_logs" / "straight.mcap") as other:
        memory = other.with_channels(written.channels)
        for topic, read in written.readers.items():
            for log in (file, memory):
                assert_same(read(log.columns(topic)), written.given[topic], topic)


@EACH
def test_a_channel_of_another_version_is_an_error_that_says_what_to_do(
    case: Callable[[np.random.Generator, int], Written],
) -> None:
    written = case(np.random.default_rng(5), N)
    for topic, read in written.readers.items():
        if read is read_warnings or topic.endswith("/lanes"):
            continue  # lenient: the report draws what there is
        with Log.open(ROOT / "sample_logs" / "straight.mcap") as log:
            columns = log.with_channels(written.channels).columns(topic)
        for name in ("stamp_ns", "covariance" if "covariance" in columns.fields else "x_m"):
            fields = {each: values for each, values in columns.fields.items() if each != name}
            if name == "covariance" and topic == "/cwcli/observer":
                continue  # a method may give none
            with pytest.raises(DataError) as raised:
                read(dataclasses.replace(columns, fields=fields))
            assert name in raised.value.what
            assert raised.value.where == topic
            assert "--replace" in raised.value.hint


def test_a_descriptor_of_a_policy_is_one_of_its_topics() -> None:
    own = [channel for channel in PUBLISHED if POLICY in channel.topic]
    assert len(own) == 3
    of_all: list[Channel] = [channel.of(policy) for channel in own for policy in POLICIES]
    assert {channel.topic for channel in of_all} <= set(topics())
