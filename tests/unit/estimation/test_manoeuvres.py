"""What contradicts the online state: a manoeuvre is followed at once, a position that jumped alone is not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from cwcli.estimation import EstimatorConfig, Kind, Measurements, Track, estimate_track
from cwcli.estimation.model import MotionParameters
from cwcli.estimation.passes import FilterStart, SensorSeries, run_filter_pass
from cwcli.kernels.ekf import UpdateStatus
from cwcli.signals.vehicle_state import HEADING, SPEED, StateFlag
from tests.unit.estimation import naive_messages

EPOCH_NS = 1_700_000_000_000_000_000
ONLINE = EstimatorConfig(latency="none", sensor_model="none", causal=True, blind=True, compares_sources=False)
POSITION_SIGMA_M, SPEED_SIGMA_MPS, HEADING_SIGMA_RAD = 0.5, 0.1, 0.01


@dataclass(frozen=True)
class Drive:
    """What a sender says, without noise: times (n,), positions (n, 2), speeds (n,), headings (n,)."""

    time_s: np.ndarray
    xy_m: np.ndarray
    speed_mps: np.ndarray
    heading_rad: np.ndarray


def _drive(accel_mps2: np.ndarray, yaw_rate_radps: np.ndarray, *, speed_mps: float, step_s: float) -> Drive:
    """Integrate rates (n,) that stand 0.01 s apart; the messages are `step_s` apart."""
    speed = speed_mps + np.cumsum(accel_mps2) * 0.01
    heading = np.cumsum(yaw_rate_radps) * 0.01
    xy = np.cumsum(speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0) * 0.01
    rows = np.arange(0, len(speed), round(step_s / 0.01))
    return Drive(rows * 0.01, xy[rows], speed[rows], heading[rows])


def _measurements(drive: Drive, seed: int = 1) -> list[Measurements]:
    rng = np.random.default_rng(seed)
    n = len(drive.time_s)
    stamp_ns = EPOCH_NS + np.round(drive.time_s * 1e9).astype(np.int64)
    xy = drive.xy_m + rng.normal(0.0, POSITION_SIGMA_M, (n, 2))
    speed = drive.speed_mps + rng.normal(0.0, SPEED_SIGMA_MPS, n)
    heading = drive.heading_rad + rng.normal(0.0, HEADING_SIGMA_RAD, n)
    return [
        Measurements("car", Kind.POSITION, stamp_ns, xy, np.full((n, 2), POSITION_SIGMA_M**2)),
        Measurements("car", Kind.SPEED, stamp_ns, speed, np.full(n, SPEED_SIGMA_MPS**2)),
        Measurements("car", Kind.HEADING, stamp_ns, heading, np.full(n, HEADING_SIGMA_RAD**2)),
    ]


def _estimate(measurements: list[Measurements], drive: Drive) -> Track:
    return estimate_track(measurements, ONLINE, EPOCH_NS + np.round(drive.time_s * 1e9).astype(np.int64))


def _rejected(track: Track) -> int:
    return sum(report.n_gated for report in track.sources)


@pytest.mark.parametrize("step_s", [0.1, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("accel_mps2", [-8.0, -5.0, 4.0])
def test_full_braking_is_followed_at_once(accel_mps2: float, step_s: float) -> None:
    """From 23 m/s within one step: no message is thrown away, and the state errs by its noise and one step's lag."""
    time_s = np.arange(0.0, 30.0, 0.01)
    drive = _drive(accel_mps2 * ((time_s >= 15.0) & (time_s < 16.5)), 0 * time_s, speed_mps=23.0, step_s=step_s)
    track = _estimate(_measurements(drive), drive)
    error = np.abs(track.state[:, SPEED] - drive.speed_mps)[5:]
    assert _rejected(track) == 0
    assert error.max() < 0.6
    assert (error / np.sqrt(track.covariance[5:, SPEED, SPEED])).max() < 5.5
    assert not (track.flags > 0).any()  # the first message holds a whole state, so no state is starting


def test_a_swerve_is_followed_at_once() -> None:
    """0.5 rad/s at 14 m/s, 7 m/s^2 to the left, begins within one step."""
    time_s = np.arange(0.0, 25.0, 0.01)
    drive = _drive(0 * time_s, 0.5 * ((time_s >= 15.0) & (time_s < 17.0)), speed_mps=14.0, step_s=0.2)
    track = _estimate(_measurements(drive), drive)
    assert _rejected(track) == 0
    assert np.abs(track.state[5:, HEADING] - drive.heading_rad[5:]).max() < 0.06


def test_a_position_that_jumps_alone_is_no_manoeuvre_and_is_believed_later() -> None:
    """10 m to the left while speed and heading go on: 15 s, the bound, and not 2 s; the states say so meanwhile."""
    time_s = np.arange(0.0, 50.0, 0.01)
    drive = _drive(0 * time_s, 0 * time_s, speed_mps=14.0, step_s=0.1)
    measured = _measurements(drive)
    measured[0].values[drive.time_s >= 25.0, 1] += 10.0
    track = _estimate(measured, drive)
    within = (drive.time_s >= 25.2) & (drive.time_s < 39.9)
    assert np.abs(track.state[within, 1]).max() < 1.0
    assert ((track.flags[within] & StateFlag.REJECTING) > 0).all()
    doubted = within & (drive.time_s > 27.1)
    assert np.sqrt(track.covariance[doubted, 1, 1]).min() > 4.0  # half of 10 m squared, 25 m^2 of each axis, less noise
    after = drive.time_s > 41.0
    assert np.abs(track.state[after, 1] - 10.0).max() < 1.0
    assert not (track.flags[after & (drive.time_s > 43.0)] > 0).any()


def test_a_position_that_agreed_shortly_is_denied_shortly() -> None:
    """10 m to the left for 20 s, believed after 15 s: it then agreed for 5 s, so the right place waits for 5 s."""
    time_s = np.arange(0.0, 60.0, 0.01)
    drive = _drive(0 * time_s, 0 * time_s, speed_mps=14.0, step_s=0.1)
    measured = _measurements(drive)
    measured[0].values[(drive.time_s >= 25.0) & (drive.time_s < 45.0), 1] += 10.0
    track = _estimate(measured, drive)
    assert np.abs(track.state[(drive.time_s > 41.0) & (drive.time_s < 45.0), 1] - 10.0).max() < 1.0
    assert np.abs(track.state[drive.time_s > 51.0, 1]).max() < 1.0


@pytest.mark.parametrize("speed_mps", [40.0, 0.0])
def test_a_speed_that_no_car_reaches_is_no_manoeuvre(speed_mps: float) -> None:
    """From 20 m/s within 0.1 s, for one second: rejected and said, and the state stays right."""
    time_s = np.arange(0.0, 30.0, 0.01)
    drive = _drive(0 * time_s, 0 * time_s, speed_mps=20.0, step_s=0.1)
    measured = _measurements(drive)
    wrong = (drive.time_s >= 15.0) & (drive.time_s < 16.0)
    measured[1].values[wrong] = speed_mps
    track = _estimate(measured, drive)
    assert track.sources[1].n_gated == np.count_nonzero(wrong)
    assert np.abs(track.state[5:, SPEED] - 20.0).max() < 1.0
    late = (drive.time_s >= 15.15) & (drive.time_s < 15.95)
    assert ((track.flags[late] & StateFlag.REJECTING) > 0).all()
    # 0.9 s of 2 s, squared, and half of it: 0.101 of 20 m/s squared, 40.5 m^2/s^2; the state errs by up to 1 m/s
    assert np.sqrt(track.covariance[late, SPEED, SPEED])[-1] == pytest.approx(6.36, rel=0.06)


def test_a_single_outlier_flags_no_state() -> None:
    time_s = np.arange(0.0, 30.0, 0.01)
    drive = _drive(0 * time_s, 0 * time_s, speed_mps=20.0, step_s=0.1)
    measured = _measurements(drive)
    measured[0].values[150] += 30.0
    track = _estimate(measured, drive)
    assert track.sources[0].n_gated == 1
    assert not (track.flags & StateFlag.REJECTING).any()


def test_hindsight_states_are_not_flagged_as_rejecting() -> None:
    time_s = np.arange(0.0, 40.0, 0.01)
    drive = _drive(0 * time_s, 0 * time_s, speed_mps=20.0, step_s=0.1)
    measured = _measurements(drive)
    measured[0].values[150:160] += 30.0
    track = estimate_track(measured, EstimatorConfig(latency="none"), measured[0].stamp_ns)
    assert track.sources[0].n_gated >= 10
    assert not (track.flags & StateFlag.REJECTING).any()


def test_messages_of_other_sources_are_no_whole_message() -> None:
    """Three topics at one time: nobody says that they belong together, so the gate waits as for any source."""
    time_s = np.arange(0.0, 30.0, 0.01)
    drive = _drive(-8.0 * ((time_s >= 15.0) & (time_s < 16.5)), 0 * time_s, speed_mps=23.0, step_s=0.5)
    measured = [
        Measurements(f"/{m.kind.name}", m.kind, m.stamp_ns, m.values, m.covariance) for m in _measurements(drive)
    ]
    assert _rejected(_estimate(measured, drive)) > 0


@pytest.mark.parametrize("seed", range(8))
def test_what_counts_as_a_manoeuvre_is_what_the_twin_says(seed: int) -> None:
    """Random jumps of all quantities, large and small: each row beyond the gate is taken where the twin agrees."""
    rng = np.random.default_rng(seed)
    n = 160
    time_s = np.cumsum(rng.choice([0.1, 0.2, 0.7], n))
    speed = np.clip(15.0 + np.cumsum(rng.choice([0.0, 0.0, 0.8, -0.9, -2.0], n)), 0.0, 40.0)
    heading = 0.3 + np.cumsum(rng.choice([0.0, 0.0, 0.0, 0.08, -0.1], n))
    step = np.diff(time_s, prepend=time_s[0])
    xy = np.cumsum((speed * step)[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)
    speed = speed + rng.choice([0.0] * 12 + [8.0, -1.5], n)
    heading = heading + rng.choice([0.0] * 12 + [1.0, 0.12], n)
    xy = xy + rng.choice([0.0] * 14 + [3.0, 15.0], n)[:, None]
    series = [
        _series(Kind.POSITION, time_s, xy, POSITION_SIGMA_M, gate=13.8),
        _series(Kind.SPEED, time_s, speed[:, None], SPEED_SIGMA_MPS, gate=10.8),
        _series(Kind.HEADING, time_s, heading[:, None], HEADING_SIGMA_RAD, gate=10.8),
    ]
    state = np.array([*xy[0], speed[0], heading[0], 0.0, 0.0, 0.0, 0.0])
    start = FilterStart(time_s[0], state, np.diag([1.0, 1.0, 0.1, 0.01, 1.0, 0.1, 1.0, 0.1]))
    motion = MotionParameters().to_process_model(np.zeros(8))
    status = np.array(
        run_filter_pass(series, start, motion, np.zeros(0), smooth=False, reset_after=20).status, dtype=int
    )
    sender = naive_messages.Sender()
    taken = np.zeros(n, np.bool_)
    for i in range(n):
        message = naive_messages.Message(
            time_s[i], xy[i, 0], xy[i, 1], speed[i], heading[i], POSITION_SIGMA_M, SPEED_SIGMA_MPS, HEADING_SIGMA_RAD
        )
        agrees = sender.agrees(message)
        is_beyond = status[:, i] != UpdateStatus.USED
        assert not (is_beyond & (status[:, i] != UpdateStatus.USED_IN_MANOEUVRE) & agrees).any()
        assert not ((status[:, i] == UpdateStatus.USED_IN_MANOEUVRE) & (not agrees)).any()
        taken[i] = agrees and is_beyond.any()
        sender.add(message, believed=bool((status[:, i] != UpdateStatus.GATED).all()))
    assert taken.any()
    assert (status == UpdateStatus.GATED).any()


def _series(kind: Kind, time_s: np.ndarray, values: np.ndarray, sigma: float, *, gate: float) -> SensorSeries:
    n, width = values.shape
    padded, noise = np.zeros((n, 2)), np.zeros((n, 3))
    padded[:, :width] = values
    noise[:, 0] = sigma**2
    noise[:, 2] = sigma**2 if width == 2 else 0.0
    return SensorSeries("car", kind, time_s, padded, noise, gate_nis=gate)
