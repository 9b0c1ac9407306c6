"""The scale of the ellipses: causal, bounded, and on target in the long run."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from cwcli.prediction.calibrate import (
    ScaleAdaptation,
    initial_log_scale_of_each_row,
    log_variance_scale_from_outcomes,
    plan_vehicle_paths,
    scale_covariance_by_outcomes,
)
from cwcli.prediction.fleet import load_fleet_prior
from cwcli.prediction.model_comparison import ComparedStarts, compare_models_at_horizons
from cwcli.prediction.models import MODELS
from cwcli.prediction.outcome import ELLIPSE_50_SQUARED_RADIUS, ELLIPSE_90_SQUARED_RADIUS, horizon_errors
from cwcli.prediction.outcome_history import PathStarts, measure_acting_time_s
from cwcli.prediction.paths import Paths
from cwcli.prediction.rollout import RolloutSettings, roll_out_paths

FloatArray = npt.NDArray[np.float64]
T0_NS = 1_700_000_000_000_000_000
STEP_S = 0.1


def stamps(n: int) -> npt.NDArray[np.int64]:
    return T0_NS + np.arange(n) * 100_000_000


def standing(n: int, variance_m2: float) -> Paths:
    """n starts of a car that is predicted to stand at the origin, with a round covariance."""
    covariance = np.zeros((n, 8, 8))
    covariance[:, 0, 0] = covariance[:, 1, 1] = variance_m2
    return roll_out_paths("cv", np.zeros((n, 8)), covariance)


def known_start(paths: Paths) -> Paths:
    """The same paths from a start that is known to the millimetre."""
    covariance = paths.position_covariance_m2.copy()
    covariance[:, 0, [0, 2]] = 1e-6
    return replace(paths, position_covariance_m2=covariance)


def white(n: int, sigma_m: float, seed: int) -> FloatArray:
    return np.random.default_rng(seed).normal(size=(n, 2)) * sigma_m


def variance_scale(
    paths: Paths, stamp_ns: npt.NDArray[np.int64], xy: FloatArray, adaptation: ScaleAdaptation | None = None
) -> FloatArray:
    """Of the 90 % ellipse at 2.5 s, the last knot."""
    return np.exp(log_variance_scale_from_outcomes(paths, stamp_ns, xy, adaptation)[:, -1, 1])


@pytest.mark.parametrize("true_sigma", [0.3, 1.0, 2.5])
@pytest.mark.parametrize("horizon_s", [0.5, 1.0, 1.5, 2.5])
def test_coverage_reaches_its_level_whatever_the_claimed_sigma(true_sigma: float, horizon_s: float) -> None:
    n = 12_000  # 20 min
    positions = white(n, true_sigma, 0)
    paths = scale_covariance_by_outcomes(known_start(standing(n, 1.0)), stamps(n), positions)
    errors = horizon_errors(paths, stamps(n), stamps(n), positions, [horizon_s])
    known = errors.is_known[:, 0]
    assert (errors.mahalanobis2[known, 0] <= ELLIPSE_90_SQUARED_RADIUS)[2000:].mean() == pytest.approx(0.9, abs=0.02)
    assert (errors.core_mahalanobis2[known, 0] <= ELLIPSE_50_SQUARED_RADIUS)[2000:].mean() == pytest.approx(
        0.5, abs=0.02
    )


def test_each_ellipse_holds_its_share_of_errors_with_heavy_tails() -> None:
    n = 12_000
    positions = (
        white(n, 1.0, 6)
        * np.repeat(np.random.default_rng(7).choice([0.3, 3.0], p=[0.8, 0.2], size=n // 40), 40)[:, None]
    )
    paths = scale_covariance_by_outcomes(known_start(standing(n, 1.0)), stamps(n), positions)
    errors = horizon_errors(paths, stamps(n), stamps(n), positions, [1.0])
    known = errors.is_known[:, 0]
    assert (errors.mahalanobis2[known, 0] <= ELLIPSE_90_SQUARED_RADIUS)[2000:].mean() == pytest.approx(0.9, abs=0.03)
    assert (errors.mahalanobis2[known, 0] <= ELLIPSE_50_SQUARED_RADIUS)[2000:].mean() > 0.6
    assert (errors.core_mahalanobis2[known, 0] <= ELLIPSE_50_SQUARED_RADIUS)[2000:].mean() == pytest.approx(
        0.5, abs=0.03
    )


def test_scale_knows_nothing_of_outcomes_to_come() -> None:
    n = 400
    positions = white(n, 3.0, 1)
    before = variance_scale(standing(n, 1.0), stamps(n), positions)
    changed = positions.copy()
    changed[200:] += 50.0
    after = variance_scale(standing(n, 1.0), stamps(n), changed)
    np.testing.assert_array_equal(after[:200], before[:200])
    assert after[230] > before[230]


def test_scale_is_one_until_there_is_an_outcome() -> None:
    scale = variance_scale(standing(100, 1.0), stamps(100), white(100, 9.0, 2))
    assert (scale[:25] == 1.0).all()  # the first outcome is known after 2.5 s
    assert scale[26] > 1.0


def test_scale_by_hand() -> None:
    # every outcome outside: the log grows by 0.3 * 0.1 s * 0.9 with each; the first start's own step is 0
    positions = np.full((40, 2), 100.0)
    scale = variance_scale(standing(40, 1.0), stamps(40), positions)
    np.testing.assert_allclose(np.log(scale[25:]), np.arange(15) * 0.027, atol=1e-12)


def test_scale_stays_within_its_limit() -> None:
    far = np.full((3000, 2), 1e6)
    assert variance_scale(standing(3000, 1.0), stamps(3000), far)[-1] == pytest.approx(ScaleAdaptation().limit)
    near = np.zeros((3000, 2))
    low = variance_scale(standing(3000, 1.0), stamps(3000), near, ScaleAdaptation(rate_1ps=2.0))[-1]
    assert low == pytest.approx(1.0 / ScaleAdaptation().limit)


def test_scale_is_linear_between_the_knots_and_nothing_at_the_start() -> None:
    paths, far = standing(300, 1.0), np.full((300, 2), 100.0)
    found = scale_covariance_by_outcomes(paths, stamps(300), far)
    np.testing.assert_array_equal(found.position_covariance_m2[:, 0], paths.position_covariance_m2[:, 0])
    ratio = np.log(found.position_covariance_m2[60, :, 0] / paths.position_covariance_m2[60, :, 0])
    at_knots = log_variance_scale_from_outcomes(paths, stamps(300), far)[60, :, 1]
    assert at_knots[0] > at_knots[-1] > 0.0  # the first outcomes are known sooner at 0.5 s than at 2.5 s
    np.testing.assert_allclose(ratio, np.interp(paths.time_s, [0.0, 0.5, 1.0, 2.5], [0.0, *at_knots]), atol=1e-12)


def test_path_shorter_than_a_knot_is_judged_at_its_end() -> None:
    paths = roll_out_paths(
        "cv", np.zeros((50, 8)), np.tile(np.eye(8), (50, 1, 1)), settings=RolloutSettings(horizon_s=0.3)
    )
    scale = log_variance_scale_from_outcomes(paths, stamps(50), np.full((50, 2), 100.0))
    assert scale.shape == (50, 1, 2)
    assert (
        np.flatnonzero(scale[:, 0, 1])[0] == 4
    )  # the outcome of start 1 is known at start 4; the first one's step is 0


def test_default_begins_with_the_ellipse_of_the_fleet() -> None:
    state, covariance = np.zeros((3, 8)), np.tile(np.eye(8), (3, 1, 1))
    starts, settings = PathStarts(np.zeros(3, dtype=np.int64), stamps(3), state, covariance), RolloutSettings(5.0)
    for name, factor in (
        ("auto", np.exp(load_fleet_prior().log_squared[:, 4]) / ELLIPSE_90_SQUARED_RADIUS),
        ("cv", np.ones(4)),
    ):
        assert MODELS[name].learns == (name == "auto")
        without_scale = roll_out_paths(name, state, covariance, settings)
        bare = without_scale.position_covariance_m2[:, [0, 10, 20, 50, 100], 0]
        scaled = plan_vehicle_paths(name, starts, settings).paths_of_rows(slice(None))
        found = scaled.position_covariance_m2[:, [10, 20, 50, 100], 0]
        kept = np.maximum(1.0 - factor, 0.0) * bare[:, :1]  # of the start, where the factor is below 1
        np.testing.assert_allclose(found, factor * bare[:, 1:] + kept)


def test_scale_below_one_leaves_the_uncertainty_of_the_start_as_it_is() -> None:
    # P0 = 4 and P = 9 m^2 from 0.5 s on; all outcomes inside: the log falls by 0.3 * 0.1 s * 0.1 with each
    n = 400
    paths = standing(n, 9.0)
    covariance = paths.position_covariance_m2.copy()
    covariance[:, 0, [0, 2]] = 4.0
    found = scale_covariance_by_outcomes(replace(paths, position_covariance_m2=covariance), stamps(n), np.zeros((n, 2)))
    scale = np.exp(-0.003 * (n - 1 - 25))  # the first outcome is known after 2.5 s, and its step is 0
    assert found.position_covariance_m2[-1, 0, 0] == pytest.approx(4.0)
    assert found.position_covariance_m2[-1, -1, 0] == pytest.approx(4.0 + scale * (9.0 - 4.0))
    # the logarithm of the 50 % ellipse falls by 0.3 * 0.1 s * 0.5: at start 200 by 0.015 * 175
    errors = horizon_errors(found, stamps(n), stamps(n), np.full((n, 2), 1.0), [2.5])
    assert errors.core_mahalanobis2[200, 0] == pytest.approx(2.0 / (4.0 + np.exp(-0.015 * 175) * (9.0 - 4.0)))


def test_vehicles_are_kept_apart_and_rows_may_be_mixed() -> None:
    n = 300
    state = np.zeros((2 * n, 8))
    state[1::2, :2] = white(n, 5.0, 3)
    covariance = np.tile(np.diag([1.0, 1.0, 0, 0, 0, 0, 0, 0]), (2 * n, 1, 1))
    vehicle = np.tile([0, 1], n)
    both_ns = np.repeat(stamps(n), 2)
    order = np.random.default_rng(4).permutation(2 * n)
    mixed = plan_vehicle_paths(
        "cv", PathStarts(vehicle[order], both_ns[order], state[order], covariance[order])
    ).paths_of_rows(slice(None))
    for one in (0, 1):
        rows = np.flatnonzero(vehicle == one)
        alone = scale_covariance_by_outcomes(
            roll_out_paths("cv", state[rows], covariance[rows]), both_ns[rows], state[rows, :2]
        )
        found = np.empty_like(mixed.position_covariance_m2)
        found[order] = mixed.position_covariance_m2
        np.testing.assert_allclose(found[rows], alone.position_covariance_m2)


def test_ellipses_of_a_vehicle_begin_with_what_the_others_showed() -> None:
    # four cars stay where they are, nearer than the ellipses expect: a fifth appears when much is known of them
    n = 600
    state, covariance = np.zeros((n + 100, 8)), np.tile(np.eye(8) * 25.0, (n + 100, 1, 1))
    vehicle = np.concatenate([np.arange(n) % 4, np.full(100, 4)])
    stamp_ns = np.concatenate([stamps(n), stamps(n)[-1] + stamps(100) + 1])
    paths = plan_vehicle_paths(
        "auto", PathStarts(vehicle, stamp_ns, state, covariance), settings=RolloutSettings(horizon_s=2.5)
    ).paths_of_rows(slice(None), has_core=True)
    area = paths.position_covariance_m2[:, -1, 0]
    assert area[n] < 0.5 * area[0]
    cut = plan_vehicle_paths(
        "auto",
        PathStarts(vehicle[:n], stamp_ns[:n], state[:n], covariance[:n]),
        settings=RolloutSettings(horizon_s=2.5),
    ).paths_of_rows(slice(None), has_core=True)
    np.testing.assert_array_equal(paths.position_covariance_m2[:n], cut.position_covariance_m2)
    assert paths.core_factor is not None and cut.core_factor is not None
    np.testing.assert_array_equal(paths.core_factor[:n], cut.core_factor)


def test_errors_of_the_models_have_the_ellipses_of_the_published_paths() -> None:
    rng = np.random.default_rng(8)
    n = 240
    state, covariance = np.zeros((n, 8)), np.tile(np.eye(8), (n, 1, 1))
    state[:, :2] = rng.normal(size=(n, 2))
    vehicle, stamp_ns = np.arange(n) % 3, stamps(n)
    paths = plan_vehicle_paths(
        "auto", PathStarts(vehicle, stamp_ns, state, covariance), settings=RolloutSettings(horizon_s=2.5)
    ).paths_of_rows(slice(None), has_core=True)
    starts = PathStarts(vehicle, stamp_ns, state, covariance, stamp_ns)
    acted = measure_acting_time_s(starts)
    begin = initial_log_scale_of_each_row("auto", starts, acted, RolloutSettings(horizon_s=2.5, step_s=0.05))
    rows = np.flatnonzero(vehicle == 1)
    track = stamp_ns[rows], state[rows, :2]
    published = horizon_errors(paths.paths_of_rows(rows), stamp_ns[rows], *track, [1.0, 2.5])
    compared = compare_models_at_horizons(
        ["auto"],
        ComparedStarts(stamp_ns[rows], state[rows], covariance[rows], *track, acted[rows], begin[rows]),
        horizons_s=[1.0, 2.5],
    )["auto"]
    np.testing.assert_allclose(compared.mahalanobis2, published.mahalanobis2)
    np.testing.assert_allclose(compared.core_mahalanobis2, published.core_mahalanobis2)
