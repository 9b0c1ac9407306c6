"""Laws that every filter and every motion model of the registries must keep."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cwcli.kernels import track as kernel
from cwcli.metrics.chi_square import chi_square_mean_bounds
from cwcli.simulation.dual_sensor import (
    TARGET_POSITIONS_BY_PATH_SHAPE,
    SensorNoise,
    observe_single_target,
    times_and_true_states_on_path,
)
from cwcli.tracking.config import IS_UNSCENTED_BY_FILTER, MOTION_MODELS, FilterConfig
from cwcli.tracking.detections import DetectionKind, Detections, SensorModel
from cwcli.tracking.prepare import DetectionRows, prepare_detections
from cwcli.tracking.single_target import filter_single_target, nis_consistency_by_source

NOISE = SensorNoise()
EPS = float(np.finfo(float).eps)
EIGENVALUE_ROUNDING = 1e-13
"""How far below zero rounding may put an eigenvalue of a correlation matrix of up to six states: some hundred `EPS`."""
SOME_STATE = {
    "cv": [3.0, -2.0, 4.0, 1.0],
    "ca": [3.0, -2.0, 4.0, 1.0, 0.5, -1.0],
    "ctrv": [3.0, -2.0, 4.0, 1.0, 0.7],
}
filters_and_models = pytest.mark.parametrize(
    ("name", "model"), [(f, m) for f in IS_UNSCENTED_BY_FILTER for m in MOTION_MODELS]
)


def moved(model, state, dt_s, p0=None, name="ekf", noise=0.0):
    """State and covariance after dt, through the kernel."""
    x = np.array([state], float)
    p = np.zeros((1, len(state), len(state))) if p0 is None else np.array([p0], float)
    config = FilterConfig(filter=name, model=model, noise=noise, turn_noise=noise)
    kernel.predict_many(config.build_kernel_filter(), x, p, dt_s)
    return x[0], p[0]


def check_covariances(p):
    """Finite, symmetric to the last bit, and positive: no correlation matrix has an eigenvalue below its rounding."""
    assert np.isfinite(p).all()
    np.testing.assert_array_equal(p, p.transpose(0, 2, 1))
    scale = np.sqrt(np.diagonal(p, axis1=1, axis2=2))
    assert (scale > 0.0).all()
    correlation = p / (scale[:, :, None] * scale[:, None, :])
    assert np.linalg.eigvalsh(correlation).min() > -EIGENVALUE_ROUNDING


def random_rows(seed, n=60, *, kinds=(0, 1, 2), repeat_stamps=False):
    """Detections that make no sense at all: any place, any noise from tiny to huge, any time step."""
    rng = np.random.default_rng(seed)
    kind = rng.choice(kinds, n).astype(np.int8)
    z = np.where((kind == 0)[:, None], rng.normal(0, 30, (n, 3)), 0.0)
    polar = np.stack([rng.exponential(20, n), rng.uniform(-np.pi, np.pi, n), rng.normal(0, 10, n)], axis=1)
    z = np.where((kind > 0)[:, None], polar, z)
    sigma = 10.0 ** rng.uniform(-4, 2, (n, 3))
    sigma[kind > 0, 1] = np.minimum(sigma[kind > 0, 1], 0.5)
    r = np.einsum("ni,ij->nij", sigma**2, np.eye(3))
    step = rng.choice([0, 1, 50, 3000], n) if repeat_stamps else rng.integers(1, 3000, n)
    stamp = np.cumsum(step) * 1_000_000
    zero = np.zeros(n, np.int64)
    return DetectionRows(
        stamp, zero, kind, np.ascontiguousarray(z), np.ascontiguousarray(r), rng.normal(0, 5, (n, 4)), zero, ("s",)
    )


@pytest.mark.parametrize("model", MOTION_MODELS)
def test_no_time_no_motion(model) -> None:
    x, p = moved(model, SOME_STATE[model], 0.0, np.eye(len(SOME_STATE[model])), noise=1.0)
    np.testing.assert_allclose(x, SOME_STATE[model], atol=0.0)
    np.testing.assert_allclose(p, np.eye(len(x)), atol=0.0)


@pytest.mark.parametrize("model", MOTION_MODELS)
def test_two_steps_are_one(model) -> None:
    half, _ = moved(model, SOME_STATE[model], 0.35)
    np.testing.assert_allclose(moved(model, half, 0.35)[0], moved(model, SOME_STATE[model], 0.7)[0], atol=1e-12)


@pytest.mark.parametrize("turn_rate", [0.0, 1e-9, 1e-5, 1e-3, 0.7, -0.7])
@pytest.mark.parametrize("model", MOTION_MODELS)
def test_the_covariance_moves_with_the_finite_difference_jacobian(model, turn_rate) -> None:
    state = np.array(SOME_STATE[model])
    if model == "ctrv":
        state[4] = turn_rate
    d = len(state)
    f = np.zeros((d, d))
    for k in range(d):
        h = np.zeros(d)
        h[k] = 1e-6
        f[:, k] = (moved(model, state + h, 0.3)[0] - moved(model, state - h, 0.3)[0]) / 2e-6
    p0 = np.eye(d) + 0.1
    np.testing.assert_allclose(moved(model, state, 0.3, p0)[1], f @ p0 @ f.T, rtol=1e-6, atol=1e-7)


def test_a_constant_turn_keeps_the_speed_and_closes_the_circle() -> None:
    state = np.array([0.0, 0.0, 3.0, 4.0, 0.5])
    x, _ = moved("ctrv", state, 2 * np.pi / 0.5)
    np.testing.assert_allclose(x, state, atol=1e-9)
    x, _ = moved("ctrv", state, 1.234)
    assert np.hypot(x[2], x[3]) == pytest.approx(5.0)


@filters_and_models
@pytest.mark.parametrize("cartesian", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(6))
def test_covariances_stay_symmetric_and_positive(name, model, cartesian, seed) -> None:
    rows = random_rows(seed, repeat_stamps=seed % 2 == 1)
    config = FilterConfig(
        filter=name, model=model, cartesian_below=cartesian, gate_probability=1.0, max_gap_s=1e9, noise=0.5
    )
    for smooth in (False, True):
        check_covariances(filter_single_target(rows, config, smooth=smooth).covariance)


@filters_and_models
def test_covariances_stay_positive_whatever_the_last_bits_are(name, model) -> None:
    """Another processor rounds otherwise: the same rows, each number moved by one unit in its last place at random.

    Steps of up to 3,000 s and noise from 0.1 mm to 100 m: a covariance of 1e6 m and more is left with 0.1 mm.
    """
    rng = np.random.default_rng(7)
    config = FilterConfig(filter=name, model=model, gate_probability=1.0, max_gap_s=1e9, noise=0.5)
    for seed in range(12):
        rows = random_rows(seed)
        for _ in range(4):
            moved_z = rows.z * (1.0 + rng.choice([-EPS, 0.0, EPS], rows.z.shape))
            moved_r = rows.r * (1.0 + rng.choice([-EPS, 0.0, EPS], (len(rows.z), 1, 1)))
            again = replace(rows, z=moved_z, r=moved_r)
            for smooth in (False, True):
                check_covariances(filter_single_target(again, config, smooth=smooth).covariance)


@pytest.mark.parametrize("model", ["cv", "ca"])
def test_both_filters_and_the_closed_form_agree_where_all_is_linear(model) -> None:
    """Positions only, a linear model: the smoother is the least-squares solution over all states at once."""
    rows = random_rows(3, 25, kinds=(0,))
    rng = np.random.default_rng(1)
    rows = replace(rows, stamp_ns=np.arange(25) * 100_000_000, r=np.tile(np.diag([0.04, 0.09, 1.0]), (25, 1, 1)),
                   z=np.cumsum(rng.normal(0, 0.3, (25, 3)), axis=0))  # fmt: skip
    config = FilterConfig(model=model, noise=0.8, gate_probability=1.0, start_speed_mps=5.0)
    out = {f: filter_single_target(rows, replace(config, filter=f), smooth=True) for f in IS_UNSCENTED_BY_FILTER}
    causal = {f: filter_single_target(rows, replace(config, filter=f), smooth=False) for f in IS_UNSCENTED_BY_FILTER}
    for both in (out, causal):
        np.testing.assert_allclose(both["ukf"].state, both["ekf"].state, atol=1e-12)
        np.testing.assert_allclose(both["ukf"].covariance, both["ekf"].covariance, atol=1e-12)
    d, n = len(MOTION_MODELS[model].states), 25
    f = np.stack([moved(model, e, 0.1)[0] for e in np.eye(d)], axis=1)
    q = moved(model, np.zeros(d), 0.1, noise=0.8)[1]
    information, vector = np.zeros((n * d, n * d)), np.zeros(n * d)
    information[:d, :d] = np.linalg.inv(causal["ekf"].covariance[0])
    vector[:d] = information[:d, :d] @ causal["ekf"].state[0]
    step = np.hstack([-f, np.eye(d)])
    h = np.eye(2, d)
    for i in range(1, n):
        part = slice((i - 1) * d, (i + 1) * d)
        information[part, part] += step.T @ np.linalg.solve(q, step)
        part = slice(i * d, (i + 1) * d)
        weight = np.linalg.inv(rows.r[i, :2, :2])
        information[part, part] += h.T @ weight @ h
        vector[part] += h.T @ weight @ rows.z[i, :2]
    expected = np.linalg.solve(information, vector).reshape(n, d)
    np.testing.assert_allclose(out["ekf"].state, expected, atol=1e-6)
    blocks = np.linalg.inv(information).reshape(n, d, n, d)
    np.testing.assert_allclose(out["ekf"].covariance, blocks[np.arange(n), :, np.arange(n)], atol=1e-6)
    np.testing.assert_allclose(causal["ekf"].state[-1], expected[-1], atol=1e-6)


@filters_and_models
def test_what_is_seen_exactly_is_known_exactly(name, model) -> None:
    """A detection almost without noise: the position is the detection, the other coordinate frame does not matter."""
    rows = random_rows(11, 30, kinds=(0,))
    rows = replace(rows, r=np.tile(np.eye(3) * 1e-10, (30, 1, 1)))
    out = filter_single_target(
        rows, FilterConfig(filter=name, model=model, gate_probability=1.0, max_gap_s=1e9), smooth=False
    )
    np.testing.assert_allclose(out.state[:, :2], rows.z[:, :2], atol=1e-4)


@filters_and_models
@pytest.mark.parametrize("angle", [0.7, np.pi])
def test_turning_the_world_turns_the_track(name, model, angle) -> None:
    scene = observe_single_target(*times_and_true_states_on_path("weave", 120), NOISE, np.random.default_rng(3))
    data = [
        Detections("lidar", DetectionKind.POSITION, scene.lidar_stamp_ns, scene.lidar_xy),
        Detections("radar", DetectionKind.RADAR, scene.radar_stamp_ns, scene.radar),
    ]
    plain = filter_single_target(prepare_detections(data).rows, FilterConfig(filter=name, model=model))
    turned_sensors = {s: SensorModel(yaw_rad=angle) for s in ("lidar", "radar")}
    turned = filter_single_target(prepare_detections(data, turned_sensors).rows, FilterConfig(filter=name, model=model))
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    # sigma points lie along the columns of a Cholesky factor: half a turn maps them onto each other, another angle
    # moves them, which changes the start, where the velocity is open, by a small part of the noise of 0.15 m
    tolerance = 0.03 if name == "ukf" and angle != np.pi else 1e-9
    np.testing.assert_allclose(turned.state[:, :2], plain.state[:, :2] @ turn.T, atol=tolerance)
    np.testing.assert_allclose(turned.state[:, 2:4], plain.state[:, 2:4] @ turn.T, atol=5 * tolerance)


def walk(rng, n, dt, noise):
    """A target that moves by the filter's own law, constant velocity with white acceleration."""
    root = np.linalg.cholesky([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]) * noise
    state = np.zeros((n, 4))
    state[0] = *rng.normal((15.0, 5.0), 1.0), *rng.normal(0, 2.0, 2)
    for i in range(1, n):
        kick = root @ rng.standard_normal((2, 2))
        state[i] = *(state[i - 1, :2] + dt * state[i - 1, 2:] + kick[0]), *(state[i - 1, 2:] + kick[1])
    return state


@pytest.mark.parametrize("name", IS_UNSCENTED_BY_FILTER)
def test_nees_and_nis_lie_inside_their_bounds(name) -> None:
    """50 seeded runs of 100 samples: the errors are as large as the covariances say (Bar-Shalom et al., 5.4.2)."""
    rng = np.random.default_rng(20)
    n, dt, n_runs = 100, 0.05, 50
    stamp = np.round(np.arange(n) * dt * 1e9).astype(np.int64)
    config = FilterConfig(filter=name, model="cv", noise=0.5, start_speed_mps=2.0, gate_probability=1.0)
    nees: dict[bool, list[Any]] = {False: [], True: []}
    nis: dict[str, list[Any]] = {"lidar": [], "radar": []}
    for _ in range(n_runs):
        state = walk(rng, n, dt, 0.5)
        r = np.hypot(state[:, 0], state[:, 1])
        polar = np.stack([r, np.arctan2(state[:, 1], state[:, 0]), (state[:, :2] * state[:, 2:]).sum(axis=1) / r], 1)
        data = [
            Detections(
                "lidar", DetectionKind.POSITION, stamp[::2], state[::2, :2] + 0.1 * rng.standard_normal((n // 2, 2))
            ),
            Detections(
                "radar",
                DetectionKind.RADAR,
                stamp[1::2],
                polar[1::2] + rng.standard_normal((n // 2, 3)) * (0.3, 0.02, 0.2),
            ),
        ]
        sensors = {"lidar": SensorModel(sigma=(0.1, 0.1)), "radar": SensorModel(sigma=(0.3, 0.02, 0.2))}
        rows = prepare_detections(data, sensors).rows
        for smooth, store in nees.items():
            out = filter_single_target(rows, config, smooth=smooth)
            error = out.state[60] - state[60]
            store.append(error @ np.linalg.solve(out.covariance[60], error))
        for source, check in nis_consistency_by_source(
            rows.sources, rows.source, out.nis, out.n_values, out.status
        ).items():
            nis[source].append(check.nis_mean)
    for store in nees.values():
        low, high = chi_square_mean_bounds(4, n_runs, 0.99)
        assert low < np.mean(store) < high
    for source, dof in (("lidar", 2), ("radar", 3)):
        low, high = chi_square_mean_bounds(dof, n_runs * (49 if source == "lidar" else 50), 0.99)
        assert low < np.mean(nis[source]) < high


@pytest.mark.parametrize("name", TARGET_POSITIONS_BY_PATH_SHAPE)
def test_a_scene_repeats_with_its_seed_and_its_velocity_is_the_paths(name) -> None:
    truth = times_and_true_states_on_path(name, 50)
    a, b = (observe_single_target(*truth, NOISE, np.random.default_rng(9)) for _ in range(2))
    np.testing.assert_array_equal(a.radar, b.radar)
    middle = (a.truth_state[2:, :2] - a.truth_state[:-2, :2]) / 0.1
    np.testing.assert_allclose(a.truth_state[1:-1, 2:], middle, atol=0.02)
