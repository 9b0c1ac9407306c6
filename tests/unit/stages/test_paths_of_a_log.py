"""Warnings from every state, whatever share of the paths a log holds and however many are in memory at a time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from cwcli.channels.predicted_path import LazyPaths, PredictedPaths, read_predicted_paths
from cwcli.channels.published import EGO_ONLINE, EGO_PATH, EGO_STATE, REMOTE_ONLINE, REMOTE_PATH, REMOTE_STATE
from cwcli.errors import DataError
from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import annotate_log
from cwcli.pipeline.paths import replanned_or_logged_paths_and_notes
from cwcli.pipeline.states import StatesSelection, read_selected_states
from cwcli.signals.columns import Columns, OutputChannel
from cwcli.stages.estimate import EstimateConfig, estimate
from cwcli.stages.inputs.vehicles import build_vehicle_tracks
from cwcli.stages.predict import PredictConfig, predict
from cwcli.warning.pair import PairEvaluation, evaluate_pairs
from cwcli.warning.rules import RULES
from cwcli.warning.types import WarningConfig

ROOT = Path(__file__).parents[3]
TIMES_S = np.unique(np.append(0.05 * np.arange(53), 2.5).round(9))


@pytest.fixture(scope="module")
def predicted() -> Iterator[Log]:
    """A drive with another vehicle, its states and paths in memory."""
    with Log.open(ROOT / "sample_logs" / "rear-end.mcap") as log:
        result = estimate(log, EstimateConfig())
        estimated = log.with_channels(result.channels, {"cwcli.run.estimate": result.metadata})
        result = predict(estimated, PredictConfig())
        yield estimated.with_channels(result.channels, {"cwcli.run.predict": result.metadata})


@pytest.fixture(scope="module")
def written(predicted: Log, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Log]:
    path = tmp_path_factory.mktemp("paths") / "predicted.mcap"
    annotate_log(predicted, (), {}, path)
    with Log.open(path) as log:
        yield log


def pairs_of(log: Log, window_rows: int) -> tuple[PairEvaluation, ...]:
    tracks = {}
    for state, online, path in ((EGO_STATE, EGO_ONLINE, EGO_PATH), (REMOTE_STATE, REMOTE_ONLINE, REMOTE_PATH)):
        states, _ = read_selected_states(log, log.columns(online.topic), state.role, StatesSelection())
        paths, notes = replanned_or_logged_paths_and_notes(log, path.topic, state.role)
        assert notes == () and len(paths) == len(states)
        tracks[state.role] = build_vehicle_tracks(states, paths, with_onset=True)
    (host,), config = tracks[EGO_STATE.role], WarningConfig()
    others = tracks[REMOTE_STATE.role]
    return evaluate_pairs(host, others, RULES[config.rule], config, TIMES_S, window_rows=window_rows)


def as_bytes(value: object) -> object:
    if isinstance(value, Mapping):
        return {name: as_bytes(each) for name, each in value.items()}
    return value if value is None else np.asarray(value).tobytes()


def assert_same_bytes(one: PairEvaluation, other: PairEvaluation) -> None:
    assert (one.spans, one.n_beyond_path, one.n_out_of_reach) == (
        other.spans,
        other.n_beyond_path,
        other.n_out_of_reach,
    )
    assert one.stamp_ns.tobytes() == other.stamp_ns.tobytes() and one.age_s.tobytes() == other.age_s.tobytes()
    for both in ((one.measures, other.measures), (one.decision, other.decision)):
        for each in fields(both[0]):
            assert as_bytes(getattr(both[0], each.name)) == as_bytes(getattr(both[1], each.name)), each.name


def test_the_size_of_a_window_changes_no_bit(predicted: Log) -> None:
    (whole,) = pairs_of(predicted, 10**9)
    assert len(whole.spans) == 1 and len(whole.stamp_ns) > 100
    for window_rows in (3, 32, 128):
        (found,) = pairs_of(predicted, window_rows)
        assert_same_bytes(found, whole)


def test_a_path_is_the_same_bits_alone_and_among_others(predicted: Log) -> None:
    paths, _ = replanned_or_logged_paths_and_notes(predicted, REMOTE_PATH.topic, REMOTE_STATE.role)
    every = paths.select_paths(np.arange(len(paths))).paths_of_rows(np.arange(len(paths)))
    for rows in (np.array([3]), np.arange(5, 90, 7), np.array([60, 4, 17])):
        some = paths.select_paths(rows).paths_of_rows(np.arange(len(rows)))
        for name in ("x_m", "y_m", "heading_rad", "speed_mps", "position_covariance_m2"):
            assert getattr(some, name).tobytes() == getattr(every, name)[rows].tobytes()


def test_a_written_log_holds_some_paths_and_gives_all_again(predicted: Log, written: Log) -> None:
    assert not written.added_channels
    n_written = len(read_predicted_paths(written.columns(REMOTE_PATH.topic)))
    paths, _ = replanned_or_logged_paths_and_notes(written, REMOTE_PATH.topic, REMOTE_STATE.role)
    assert isinstance(paths, LazyPaths)
    assert 0 < n_written < 0.6 * len(paths)
    (one,), (other,) = pairs_of(predicted, 512), pairs_of(written, 512)
    assert_same_bytes(one, other)


def whole_channel(log: Log, more_m: float) -> OutputChannel:
    """The paths that the log holds, as if somebody else had written them so."""
    (channel,) = (each for each in log.added_channels if each.topic == REMOTE_PATH.topic)
    given = dict(log.columns(REMOTE_PATH.topic).fields)
    x_m = np.asarray(given["x_m"], np.float64)
    given["x_m"] = x_m + more_m * np.arange(x_m.shape[1])
    return OutputChannel(channel.topic, channel.schema_name, channel.log_time_ns, given)


def test_paths_that_the_states_do_not_give_are_used_as_they_are_and_told(predicted: Log) -> None:
    """Another version predicted them: here with 3 m/s more."""
    channel = whole_channel(predicted, 0.75)
    found, notes = replanned_or_logged_paths_and_notes(
        predicted.with_channels([channel]), REMOTE_PATH.topic, REMOTE_STATE.role
    )
    assert isinstance(found, PredictedPaths) and len(found) == len(channel)
    told = f"/cwcli/remote/path: {len(channel)} paths of the log are used, as its states do not give the same again"
    assert notes == (told,)


def test_a_log_whose_record_tells_no_rate_holds_all_its_paths(predicted: Log) -> None:
    """As older versions wrote it."""
    record = {"cwcli.run.predict": {"configuration": '{"path_rate_hz": null}'}}
    older = predicted.with_channels([whole_channel(predicted, 0.0)], record)
    found, notes = replanned_or_logged_paths_and_notes(older, REMOTE_PATH.topic, REMOTE_STATE.role)
    assert isinstance(found, PredictedPaths) and notes == ()


def only(columns: Columns, start_ns: int) -> OutputChannel:
    """What a channel holds from a log time on."""
    first = int(np.searchsorted(columns.log_time_ns, start_ns))
    rows = columns.slice_rows(first, len(columns))
    return OutputChannel(rows.topic, rows.schema_name, rows.log_time_ns, rows.fields)


def test_a_log_without_its_first_half_keeps_its_ellipses(predicted: Log) -> None:
    """Their scales were learned in the half that is gone; the positions of `cv` follow from each state alone."""
    result = predict(predicted, PredictConfig(model="cv"))
    log = predicted.with_channels(result.channels, {"cwcli.run.predict": result.metadata})
    middle_ns = int(np.median(log.columns(EGO_ONLINE.topic).log_time_ns))
    topics = (EGO_ONLINE.topic, REMOTE_ONLINE.topic, EGO_PATH.topic)
    half = log.with_channels([only(log.columns(topic), middle_ns) for topic in topics])
    found, notes = replanned_or_logged_paths_and_notes(half, EGO_PATH.topic, EGO_STATE.role)
    assert isinstance(found, PredictedPaths)
    assert notes[0].startswith(f"{EGO_PATH.topic}: {len(found)} paths of the log are used")


def test_states_that_can_not_be_read_are_an_error(predicted: Log) -> None:
    states = predicted.columns(EGO_ONLINE.topic)
    fields = dict(states.fields)
    sigma = fields["sigma"]
    assert isinstance(sigma, np.ndarray)
    fields["sigma"] = sigma[:, :7]  # of eight states
    broken = OutputChannel(states.topic, states.schema_name, states.log_time_ns, fields)
    path = predicted.columns(EGO_PATH.topic)
    given = OutputChannel(path.topic, path.schema_name, path.log_time_ns, path.fields)
    with pytest.raises(DataError, match="sigma"):
        replanned_or_logged_paths_and_notes(predicted.with_channels([broken, given]), EGO_PATH.topic, EGO_STATE.role)


def test_a_fault_in_the_planning_is_not_taken_for_another_log(written: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    def faulty(*_: object) -> LazyPaths:
        raise ValueError("operands could not be broadcast together")

    monkeypatch.setattr("cwcli.pipeline.paths.plan_paths_from_states", faulty)
    with pytest.raises(ValueError, match="broadcast"):
        replanned_or_logged_paths_and_notes(written, EGO_PATH.topic, EGO_STATE.role)
