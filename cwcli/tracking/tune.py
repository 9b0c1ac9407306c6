"""Fit process and measurement noise to the detections alone, by maximum likelihood.

The likelihood of the innovations measures how well the filter's covariance fits the detections; no truth is used. The
search is Nelder and Mead's (Computer J. 7, 1965), in logarithms, so that every parameter stays positive.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.tracking.config import FilterConfig
from cwcli.tracking.prepare import DetectionRows
from cwcli.tracking.single_target import log_likelihood_of_rows

MAX_TUNED_NOISE_FACTOR = 300.0
"""Largest factor on a noise, and the inverse of the smallest. Chosen by hand."""
MAX_TUNING_ROWS = 20_000
"""Largest number of rows that the noise is fitted to: more rows take longer and hardly improve it. Chosen by hand."""


@dataclass(frozen=True)
class TunedFilter:
    """The result of `tune`.

    Attributes:
        config: The given configuration with its process noise replaced.
        scale: Source -> factors on the sigma of each value: one for x and y together (POSITION), or range, azimuth
            and range rate (RADAR).
        log_likelihood_before, log_likelihood: At the given and at the found noise.
        n_evaluations: Number of runs of the filter.
    """

    config: FilterConfig
    scale: dict[str, tuple[float, ...]]
    log_likelihood_before: float
    log_likelihood: float
    n_evaluations: int


def scale_sigmas(rows: DetectionRows, scale: Mapping[str, tuple[float, ...]]) -> DetectionRows:
    """Multiply every sigma of the rows by its source's factors."""
    if not scale:
        return rows
    r = rows.r.copy()
    for k, name in enumerate(rows.sources):
        if name not in scale:
            continue
        factors = np.ones(3)
        stated_scale = scale[name]
        factors[: 2 if len(stated_scale) == 1 else 3] = stated_scale[0] if len(stated_scale) == 1 else stated_scale
        r[rows.source == k] *= np.outer(factors, factors)
    return replace(rows, r=r)


def minimise_by_nelder_mead_and_count_calls(
    cost: Callable[[FloatArray], float], start: FloatArray, *, step: float = 0.5, tolerance: float = 1e-3,
    max_evaluations: int = 1500,
) -> tuple[FloatArray, float, int]:  # fmt: skip
    """Minimise a cost by Nelder and Mead with one restart: the best point, its cost and the number of calls."""
    n, calls = len(start), 0
    best, best_cost = np.asarray(start, float), math.inf
    for size in (step, 0.5 * step):
        points = np.vstack([best, best + size * np.eye(n)])
        costs = np.array([cost(p) for p in points])
        calls += n + 1
        while calls < max_evaluations:
            order = np.argsort(costs, kind="stable")
            points, costs = points[order], costs[order]
            if costs[-1] - costs[0] < tolerance and np.abs(points - points[0]).max() < 10.0 * tolerance:
                break
            centre = points[:-1].mean(axis=0)
            reflected = 2.0 * centre - points[-1]
            value = cost(reflected)
            calls += 1
            if value < costs[0]:
                further = 3.0 * centre - 2.0 * points[-1]
                further_value = cost(further)
                calls += 1
                if further_value < value:
                    reflected, value = further, further_value
            elif value >= costs[-2]:
                nearer = 0.5 * (centre + (reflected if value < costs[-1] else points[-1]))
                nearer_value = cost(nearer)
                calls += 1
                if nearer_value >= min(value, costs[-1]):
                    points[1:] = 0.5 * (points[1:] + points[0])
                    costs[1:] = [cost(p) for p in points[1:]]
                    calls += n
                    continue
                reflected, value = nearer, nearer_value
            points[-1], costs[-1] = reflected, value
        k = int(np.argmin(costs))
        best, best_cost = points[k], float(costs[k])
    return best, best_cost, calls


def _select_longest_targets(targets: Sequence[DetectionRows]) -> list[DetectionRows]:
    """Select the longest targets, with `MAX_TUNING_ROWS` rows in all."""
    out, left = [], MAX_TUNING_ROWS
    for target in sorted(targets, key=len, reverse=True):
        if left <= 0:
            break
        out.append(target.select_rows(slice(0, left)))
        left -= len(out[-1])
    return out


def tune_noise(targets: Sequence[DetectionRows], config: FilterConfig) -> TunedFilter:
    """Find the process noise of `config` and the sigma factors of each source that make the rows most likely.

    The rows are not gated: outliers are not known before the noise is.

    Args:
        targets: The rows of each target, in the order of time. They share `sources`.
        config: The filter; its noises are the start of the search.
    """
    targets = _select_longest_targets(targets)
    sources = targets[0].sources if targets else ()
    present = [k for k in range(len(sources)) if any((t.source == k).any() for t in targets)]
    widths = []
    for k in present:
        kinds = max(int(t.kind[t.source == k].max(initial=-1)) for t in targets)
        widths.append(1 if kinds == 0 else kinds + 1)
    motion = config.motion_model
    noise = motion.noise if config.noise is None else config.noise
    turn = motion.turn_noise if config.turn_noise is None else config.turn_noise
    n_process = 2 if motion.turn_noise > 0.0 else 1

    def config_and_scales_of_parameters(theta: FloatArray) -> tuple[FilterConfig, dict[str, tuple[float, ...]]]:
        factors = np.exp(theta)
        tuned = replace(config, noise=noise * float(factors[0]))
        if n_process == 2:
            tuned = replace(tuned, turn_noise=turn * float(factors[1]))
        scale, at = {}, n_process
        for k, width in zip(present, widths, strict=True):
            values = factors[at : at + width].tolist()
            scale[sources[k]] = tuple(values if width != 2 else [*values, 1.0])
            at += width
        return tuned, scale

    def negative_log_likelihood(theta: FloatArray) -> float:
        if np.abs(theta).max() > math.log(MAX_TUNED_NOISE_FACTOR):
            return 1e300
        tuned, scale = config_and_scales_of_parameters(theta)
        return -sum(log_likelihood_of_rows(scale_sigmas(t, scale), tuned) for t in targets)

    start = np.zeros(n_process + sum(widths))
    before = -negative_log_likelihood(start)
    if not any(len(t) > 10 for t in targets):
        return TunedFilter(config, {}, before, before, 1)
    theta, value, calls = minimise_by_nelder_mead_and_count_calls(negative_log_likelihood, start)
    tuned, scale = config_and_scales_of_parameters(theta)
    return TunedFilter(replace(tuned, tune=False), scale, before, -value, calls + 1)
