"""Which remote state is used, how old it is, and where it then is."""

import numpy as np
import pytest

from cwcli.prediction.paths import Paths
from cwcli.warning.remote_alignment import interpolate_paths, pair_with_newest_state
from tests.unit.warning.vehicles import straight


def test_a_state_is_used_once_it_has_been_received() -> None:
    host = straight("host", speed_mps=0.0, duration_s=1.0)
    other = straight("a", speed_mps=0.0, duration_s=1.0, rate_hz=10.0, delay_s=0.12)
    pairing = pair_with_newest_state(host, other, "received", 1.0)
    # made at 0, 0.1, ...; known at 0.12, 0.22, ...: at 0.15 the one of 0, at 0.25 the one of 0.1
    assert pairing.host_row[:3].tolist() == [3, 4, 5]
    np.testing.assert_allclose(pairing.age_s[:4], [0.15, 0.20, 0.15, 0.20])
    assert pairing.n_without_message == 3


def test_with_stamps_the_link_has_no_delay() -> None:
    host = straight("host", speed_mps=0.0, duration_s=1.0)
    other = straight("a", speed_mps=0.0, duration_s=1.0, rate_hz=10.0, delay_s=0.12)
    pairing = pair_with_newest_state(host, other, "stamp", 1.0)
    np.testing.assert_allclose(pairing.age_s[:4], [0.0, 0.05, 0.0, 0.05])
    assert pairing.n_without_message == 0


def test_a_message_that_overtakes_another_counts_by_its_stamp() -> None:
    host = straight("host", speed_mps=0.0, duration_s=1.0)
    other = straight("a", speed_mps=0.0, duration_s=1.0, rate_hz=10.0)
    late = other.log_time_ns.copy()
    late[2] += 300_000_000  # made at 0.2, received at 0.5, after those of 0.3 to 0.5
    swapped = type(other)(other.id, other.stamp_ns, late, other.state, other.paths)
    pairing = pair_with_newest_state(host, swapped, "received", 1.0)
    by_time = dict(zip(pairing.host_row.tolist(), pairing.other_row.tolist(), strict=True))
    assert by_time[5] == 1  # at 0.25 s
    assert by_time[6] == 3  # at 0.30 s
    assert by_time[10] == 5  # at 0.50 s the late one is of no use


def test_old_states_are_not_used_and_counted() -> None:
    host = straight("host", speed_mps=0.0, duration_s=3.0)
    other = straight("a", speed_mps=0.0, duration_s=1.0, rate_hz=10.0)
    pairing = pair_with_newest_state(host, other, "received", 0.5)
    assert pairing.host_row[-1] == 30  # 1.5 s
    assert pairing.n_stale == 30


def test_paths_are_read_between_points_and_go_straight_on_past_their_end() -> None:
    track = straight("a", speed_mps=10.0, heading_rad=np.pi / 2, duration_s=1.0, horizon_s=2.5)
    assert isinstance(track.paths, Paths)
    points = interpolate_paths(track.paths, np.array([0, 4]), np.array([0.0, 0.13]), np.array([0.0, 0.07, 2.5]))
    np.testing.assert_allclose(points.y_m, [[0.0, 0.7, 25.0], [3.3, 4.0, 28.3]], atol=1e-9)
    np.testing.assert_allclose(points.x_m, 0.0, atol=1e-9)
    assert points.is_beyond_end.tolist() == [False, True]


def test_braking_remote_is_brought_forward_by_its_own_model() -> None:
    track = straight("a", speed_mps=10.0, accel_mps2=-4.0, duration_s=1.0, horizon_s=3.5)
    assert isinstance(track.paths, Paths)
    points = interpolate_paths(track.paths, np.array([0]), np.array([0.5]), np.array([0.0, 1.0]))
    # 10 t - 2 t^2 at 0.5 and 1.5 s
    assert points.x_m[0] == pytest.approx([4.5, 10.5], abs=1e-9)
    assert points.speed_mps[0] == pytest.approx([8.0, 4.0], abs=1e-9)
