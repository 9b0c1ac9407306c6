"""What the default filter makes of a frame's sigmas: by hand."""

import numpy as np
import pytest

from cwcli.dynamics.config import FilterNoise, ObserverConfig
from cwcli.dynamics.filter import observe_with_kalman_filter
from cwcli.dynamics.samples import LaneSamples, ScalarSamples
from cwcli.dynamics.vehicle import load_vehicle

CAR = load_vehicle()


def start_covariance(noise: FilterNoise) -> np.ndarray:
    """Of the first frame, whose y_L and e_L are known no better than the frame tells."""
    one = np.zeros(1, np.int64)
    lanes = LaneSamples(one, np.zeros(1), np.zeros(1), np.zeros(1), np.full(1, 0.04), np.full(1, 0.003), None)
    track = observe_with_kalman_filter(lanes, ScalarSamples(one, np.full(1, 25.0)), CAR, ObserverConfig(noise=noise))
    return track.covariance[0]


def test_half_of_the_floors_is_noise_and_all_of_them_last() -> None:
    noise = FilterNoise(camera_yaw_rad=0.0, lateral_floor_m=0.06, heading_floor_rad=0.008, floor_share=0.5)
    covariance = start_covariance(noise)
    assert covariance[2, 2] == pytest.approx(0.04**2 + 0.03**2 + 0.06**2)
    assert covariance[3, 3] == pytest.approx(0.003**2 + 0.004**2 + 0.008**2)


def test_floors_can_be_left_out_of_the_noise() -> None:
    noise = FilterNoise(camera_yaw_rad=0.0, lateral_floor_m=0.06, heading_floor_rad=0.008, floor_share=0.0)
    assert start_covariance(noise)[2, 2] == pytest.approx(0.04**2 + 0.06**2)
