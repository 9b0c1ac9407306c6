"""zhang2011's headline numbers against a computation of their own (`own_zhang2011`, with SciPy)."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.reproduction.zhang2011.example import printed_tables_part, worked_example_part
from cwcli.reproduction.zhang2011.motion import simulated_run_part
from cwcli.simulation.road.camera import camera_of_zhang2011
from tests.papers import own_zhang2011 as own

KMH = 1 / 3.6


@pytest.fixture(scope="module")
def example() -> dict[str, float]:
    return {each.what: each.ours for each in worked_example_part().numbers}


def test_correction_of_the_angle(example: dict[str, float]) -> None:
    """Number 13: 0.000843."""
    assert example["f(v) - 1 over v^2, half load"] == pytest.approx(own.factor(1.0) - 1.0, rel=1e-9)
    assert own.factor(1.0) - 1.0 == pytest.approx(0.000843, abs=1e-6)


@pytest.mark.parametrize(
    ("kmh", "whose"), [(80.0, "model of 80 km/h"), (90.0, "model of 90 km/h"), (88.0, "car at 88 km/h")]
)
def test_the_worked_example_two_seconds_after_the_angle(kmh: float, whose: str, example: dict[str, float]) -> None:
    """Number 14: -1.872 m/s and 0.4152 rad/s at 88 km/h, integrated by SciPy."""
    state = own.driven(kmh * KMH, own.HALF, 0.05, 0.001, np.linspace(0.0, 2.0, 21))[-1]
    for k, name in enumerate(("v_y", "gamma", "y_L", "e_L") if kmh == 88.0 else ("v_y", "gamma")):
        assert example[f"{whose}: {name}"] == pytest.approx(state[k], abs=1e-6)
    if kmh == 88.0:
        assert state[:2] == pytest.approx([-1.872, 0.4152], abs=5e-5)  # the print, to its last digit


def test_the_gains_by_scipys_riccati_solver(example: dict[str, float]) -> None:
    """Number 15, and why the printed ones are none: for R2 = r I the part of y_L and e_L is symmetric, in 0 to 1."""
    for kmh in (80, 90):
        ours = own.gain(kmh * KMH, own.HALF)[2]
        of_curvature = own.gain_with_curvature_noise(kmh * KMH, own.HALF)
        for row, state in enumerate(("v_y", "gamma", "y_L", "e_L")):
            for column, source in enumerate(("y_L", "e_L")):
                what = f"K_{kmh}: {state} from {source}"
                assert example[f"{what}, R1 on all states"] == pytest.approx(ours[row, column], abs=1e-7)
                assert example[what] == pytest.approx(of_curvature[row, column], abs=1e-6)
        part = ours[2:]
        np.testing.assert_allclose(part, part.T, atol=1e-9)
        assert (np.linalg.eigvalsh(part) > 0.0).all()
        assert (np.linalg.eigvalsh(part) < 1.0).all()
    printed = np.array([[0.444, 3.245], [-0.467, 1.630]])
    assert abs(printed[0, 1] - printed[1, 0]) > 3.0


def test_the_observers_of_80_and_90_kmh_on_the_car_at_88(example: dict[str, float]) -> None:
    """Number 16."""
    true = own.driven(88.0 * KMH, own.HALF, 0.05, 0.001, np.linspace(0.0, 2.0, 21))
    blended = np.zeros(4)
    for kmh, weight in ((80, 0.2), (90, 0.8)):
        phi, g, k = own.gain(kmh * KMH, own.HALF)
        state = np.zeros(4)
        for now in true[1:]:
            ahead = phi @ state + g @ (0.05, 0.001)
            state = ahead + k @ (now[2:] - ahead[2:])
        blended += weight * state
        for j, name in enumerate(("v_y", "gamma", "y_L", "e_L")):
            assert example[f"observer of {kmh} km/h at 88 km/h: {name}"] == pytest.approx(state[j], abs=1e-6)
    assert example["blend of both observers at 88 km/h: v_y"] == pytest.approx(blended[0], abs=1e-6)


@pytest.mark.parametrize(
    ("figure", "kmh", "delta", "mass", "told", "label"),
    [
        ("fig 14", 88.0, 0.1, own.HALF, own.HALF, "zhang2011"),
        ("fig 16", 80.0, 0.01, own.FULL, own.FULL, "zhang2011"),
        ("fig 16", 80.0, 0.01, own.FULL, own.HALF, "zhang2011, told half load"),
    ],
)
def test_static_errors_of_figures_14_and_16(
    figure: str, kmh: float, delta: float, mass: float, told: float, label: str
) -> None:
    """Number 17, 18 and 19: with the load known, and the 22.4 % with half load told."""
    found = {each.what: each.ours for each in simulated_run_part(figure).numbers}
    errors = own.static_errors(kmh, delta, mass, told)
    for k, name in enumerate(("v_y", "gamma")):
        assert found[f"{label}: static error of {name}"] == pytest.approx(errors[k], abs=0.01)
    if told != mass:
        assert errors[0] == pytest.approx(22.4, abs=0.1)


def test_static_errors_of_figure_15() -> None:
    """While the speed grows, the errors depend on whether the car turns with the bend, as in the paper, or against."""
    found = {each.what: each.ours for each in simulated_run_part("fig 15").numbers}
    errors = own.static_errors_of_figure_15()
    assert errors[0] == pytest.approx(0.785, abs=0.005)
    assert own.static_errors_of_figure_15(-0.01)[0] == pytest.approx(1.36, abs=0.005)  # docs/papers/zhang2011-motion.md
    for k, name in enumerate(("v_y", "gamma")):
        assert found[f"zhang2011: static error of {name}"] == pytest.approx(errors[k], abs=0.01)


def test_the_worked_example_of_decoding() -> None:
    """Number 20."""
    found = {each.what: each.ours for each in printed_tables_part().numbers}
    ours = own.decoded("01010100011100001011101", ((-0.005, 0.005, 7, 4), (0.3, 2.3, 8, 2), (-100.0, 150.0, 8, 0)))
    assert ours == [-0.0017, 0.74, -9.0]
    assert [found[f"worked example: {letter}"] for letter in "abc"] == pytest.approx(ours)


def test_the_camera_that_the_pictures_are_drawn_with() -> None:
    """Number 21: where points of the road lie in figures 17b to 19b; the optical axis meets the road 33.5 m ahead."""
    camera = camera_of_zhang2011()
    points = np.array([[10.0, 1.5], [20.0, -2.0], [33.5, 0.0], [60.0, 3.0]])
    u, v = camera.project_to_image_px(points[:, 0], points[:, 1], np.zeros(len(points)))
    pitch = np.arctan(1.65 / 33.5)
    ours = own.seen(points, height_m=1.65, focal_px=800.0, centre=(camera.cx, camera.cy), pitch_rad=float(pitch))
    np.testing.assert_allclose(np.column_stack([u, v]), ours, atol=1e-6)
    assert v[2] == pytest.approx(camera.cy, abs=1e-6)
