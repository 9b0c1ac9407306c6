"""What the log itself tells: each source's latency, the noise of sources that do not state it, the sensors' biases.

A latency is a constant state of the filter: to first order a late source measures h(x(t - tau)) = h(x) - tau dh/dt, so
a filter with tau among its states finds it together with the biases and everything else, with its one sigma, from all
measurements at once. After each pass the stamps are moved by what was found and the pass repeated (Gauss-Newton). One
source is the reference and has none. The passes run without smoother on a thinned IMU.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cwcli.estimation.coarse_latency import coarse_latency
from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.consistency import chi_square_quantile
from cwcli.estimation.measurements import Kind
from cwcli.estimation.model import ModelParameters
from cwcli.estimation.passes import N_MOTION, Series, Start, run_pass
from cwcli.estimation.prepare import Prepared, thinned
from cwcli.estimation.start import find_start
from cwcli.signals.columns import FloatArray

LATENCY_PRIOR_S = 0.3  # one sigma about the coarse guess
OBSERVABLE_S = 0.1  # a latency known worse than this is not corrected
MAX_LATENCY_S = 3.0
ACCEL_BIAS_PRIOR = 3.0  # m/s^2: gravity through 18 degrees of pitch
YAW_RATE_BIAS_PRIOR = 0.02  # rad/s
TUNING_GATE = 1.0 - 1e-6
TUNING_RATE_HZ = 25.0
MAX_PASSES = 6
NOISE_FLOOR: dict[Kind, float] = {
    Kind.POSITION: 0.05,
    Kind.VELOCITY: 0.02,
    Kind.SPEED: 0.02,
    Kind.HEADING: 2e-3,
    Kind.ACCEL: 5e-3,
    Kind.YAW_RATE: 1e-4,
}
"""Sigma below which noise found from the log is not believed (resolution of the usual messages)."""
MIN_ROWS_FOR_NOISE = 50


@dataclass(frozen=True)
class Latency:
    """One source's latency: seconds (positive = late), one sigma, and how it was come by (see `SourceReport`)."""

    seconds: float
    sigma_s: float
    status: str


@dataclass(frozen=True)
class Tuned:
    """Series with latency, noise, bias states and gates settled; `latencies` is parallel to `series`."""

    series: tuple[Series, ...]
    latencies: tuple[Latency, ...]
    n_states: int
    walk: FloatArray
    prior: FloatArray
    notes: tuple[str, ...]


def tune(prepared: Sequence[Prepared], config: EstimatorConfig, parameters: ModelParameters) -> Tuned:
    """Find latencies and noise, and lay out the parameter states.

    Args:
        prepared: All series; at least one POSITION with a row.
        config: Settings.
        parameters: Motion model.
    """
    series, walk, prior = _with_bias_states(prepared, parameters)
    statuses = _latency_roles(series, config)
    series = [
        replace(s, latency_s=role.seconds, gate=chi_square_quantile(TUNING_GATE, s.width))
        for s, role in zip(series, statuses, strict=True)
    ]
    small = [_thin(s) for s in series]
    wanted = [i for i, role in enumerate(statuses) if role.status == "estimated"]
    for i in wanted:
        small[i] = replace(small[i], latency_s=coarse_latency(series[i], _marked(series, wanted)))
    sigma = np.full(len(series), np.nan)
    for _ in range(MAX_PASSES):
        if not wanted and not _wants_noise(small):
            break
        small, sigma, step, noise_step = _pass(small, wanted, walk, prior, parameters, config)
        if max(step, 0.02 * noise_step) < 1e-3:
            break
    latencies, notes = [], []
    result = []
    probability = config.gate_probability
    for i, (s, role) in enumerate(zip(series, statuses, strict=True)):
        latency = role
        if i in wanted:
            if sigma[i] < OBSERVABLE_S:
                latency = Latency(small[i].latency_s, float(sigma[i]), "estimated")
            else:
                latency = Latency(0.0, float(sigma[i]), "not observable")
                notes.append(f"{s.source}: latency of {s.kind.name.lower()} not observable, not corrected")
        latencies.append(latency)
        ratio = _noise_ratio(s, small[i])
        gate = 0.0 if probability >= 1.0 else chi_square_quantile(probability, s.width)
        result.append(
            replace(s, latency_s=latency.seconds, noise=s.noise * ratio, noise_origin=small[i].noise_origin, gate=gate)
        )
    return Tuned(tuple(result), tuple(latencies), len(walk), walk, prior, tuple(notes))


def start_with_parameters(series: Sequence[Series], prior: FloatArray, *, causal: bool) -> Start:
    """Return `find_start` with the prior variances of the parameter states, shape (n,), put in."""
    start = find_start(series, len(prior), causal=causal)
    covariance = start.covariance.copy()
    index = np.arange(N_MOTION, len(prior))
    covariance[index, index] = prior[index]
    return Start(start.time_s, start.state, covariance)


def _with_bias_states(
    prepared: Sequence[Prepared], parameters: ModelParameters
) -> tuple[list[Series], FloatArray, FloatArray]:
    """Give every IMU series a bias state. Returns series, random walk variances and prior variances, both (n,)."""
    series, walk, prior = [], [0.0] * N_MOTION, [0.0] * N_MOTION
    for p in prepared:
        if p.biased and len(p.series):
            series.append(replace(p.series, bias_state=len(walk)))
            accel = p.series.kind is Kind.ACCEL
            walk.append((parameters.accel_bias_walk if accel else parameters.yaw_rate_bias_walk) ** 2)
            prior.append((ACCEL_BIAS_PRIOR if accel else YAW_RATE_BIAS_PRIOR) ** 2)
        else:
            series.append(p.series)
    return series, np.array(walk), np.array(prior)


def _latency_roles(series: Sequence[Series], config: EstimatorConfig) -> list[Latency]:
    """Decide which series is the reference, which latency is given and which is to be estimated."""
    option = config.latency
    if option == "none":
        return [Latency(0.0, float("nan"), "off") for _ in series]
    given: Mapping[str, float] = {} if isinstance(option, str) else option
    reference = _reference_source(series)
    roles = []
    for s in series:
        named = given.get(f"{s.source}:{s.kind.name.lower()}", given.get(s.source))
        if named is not None:
            roles.append(Latency(float(named), float("nan"), "given"))
        elif s.source == reference[0] and s.kind in reference[1]:
            roles.append(Latency(0.0, float("nan"), "reference"))
        elif len(s) < MIN_ROWS_FOR_NOISE:
            roles.append(Latency(0.0, float("nan"), "not observable"))
        else:
            roles.append(Latency(0.0, float("nan"), "estimated"))
    return roles


def _reference_source(series: Sequence[Series]) -> tuple[str, tuple[Kind, ...]]:
    """The IMU if there is one, else the speed (with a yaw rate of the same source), else the position."""
    rates = (Kind.ACCEL, Kind.YAW_RATE)
    for s in series:
        if s.bias_state >= 0 and len(s):
            return s.source, rates
    for s in series:
        if s.kind is Kind.SPEED and len(s):
            return s.source, (Kind.SPEED, *rates)
    for s in series:
        if s.kind in rates and len(s):
            return s.source, rates
    for s in series:
        if s.kind is Kind.POSITION and len(s):
            return s.source, (Kind.POSITION,)
    return "", ()


def _marked(series: Sequence[Series], wanted: Sequence[int]) -> list[Series]:
    """Mark the series with a latency of their own, so that none of them serves as reference."""
    return [replace(s, latency_state=0) if i in wanted else s for i, s in enumerate(series)]


def _thin(s: Series) -> Series:
    """Average an IMU down to about TUNING_RATE_HZ."""
    if s.kind not in (Kind.ACCEL, Kind.YAW_RATE) or len(s) < 3:
        return s
    return thinned(s, int(1.0 / (TUNING_RATE_HZ * max(float(np.median(np.diff(s.time_s))), 1e-4)) + 0.25))


def _wants_noise(series: Sequence[Series]) -> bool:
    return any(s.noise_origin != "message" and len(s) >= MIN_ROWS_FOR_NOISE for s in series)


def _pass(
    series: list[Series],
    wanted: Sequence[int],
    walk: FloatArray,
    prior: FloatArray,
    parameters: ModelParameters,
    config: EstimatorConfig,
) -> tuple[list[Series], FloatArray, float, float]:
    """Run one filter pass with latency states and take over what it found.

    Returns:
        The series with moved latencies and rematched noise; the latencies' sigmas (NaN elsewhere); the largest change
        of a latency in seconds; the largest relative change of a noise variance.
    """
    n = len(walk)
    now = list(series)
    for k, i in enumerate(wanted):
        now[i] = replace(now[i], latency_state=n + k)
    full_walk = np.concatenate((walk, np.zeros(len(wanted))))
    full_prior = np.concatenate((prior, np.full(len(wanted), LATENCY_PRIOR_S**2)))
    start = start_with_parameters(now, full_prior, causal=False)
    found = run_pass(now, start, parameters, full_walk, np.zeros(0), smooth=False, reset_after=config.reset_after)
    sigma = np.full(len(series), np.nan)
    largest = 0.0
    for k, i in enumerate(wanted):
        move = float(np.clip(found.last_state[n + k], -0.5, 0.5))
        sigma[i] = float(np.sqrt(found.last_covariance[n + k, n + k]))
        limit = MAX_LATENCY_S
        now[i] = replace(now[i], latency_state=-1, latency_s=float(np.clip(now[i].latency_s + move, -limit, limit)))
        largest = max(largest, abs(move))
    noise_step = 0.0
    for i, s in enumerate(now):
        factor = noise_factor(s, found.nis[i], found.status[i])
        if factor != 1.0:
            now[i] = replace(s, noise=s.noise * factor, noise_origin=_renamed(s.noise_origin))
            noise_step = max(noise_step, abs(factor - 1.0))
    return now, sigma, largest, noise_step


def _renamed(origin: str) -> str:
    return "message, scaled" if origin.startswith("message") else "log"


def noise_factor(s: Series, nis: FloatArray, status: np.typing.NDArray[np.int8]) -> float:
    """Return the factor on the noise variance that brings the mean innovation into agreement (innovation matching).

    The equation is mean(nu^2 / (h P h' + factor r)) = 1 over the rows that passed the gate. A message's own covariance
    is only ever raised: errors that are slow look small from one innovation to the next, and are there all the same.

    Args:
        s: The series with its present noise.
        nis: Shape (n, 3): normalised innovation squared, mean nu^2 over axes, mean h P h' over axes.
        status: Shape (n,): 0 = gated.
    """
    used = status > 0
    if used.sum() < MIN_ROWS_FOR_NOISE:
        return 1.0
    nu2, prior = nis[used, 1], nis[used, 2]
    r = s.noise[used, 0] if s.width == 1 else 0.5 * (s.noise[used, 0] + s.noise[used, 2])
    low, high = 1e-4, 1e4
    for _ in range(40):
        middle = float(np.sqrt(low * high))
        if float((nu2 / (prior + middle * r)).mean()) > 1.0:
            low = middle
        else:
            high = middle
    factor = float(np.sqrt(low * high))
    mean_r = float(r.mean())
    if s.noise_origin.startswith("message"):
        if s.noise_origin == "message" and factor < 1.1:
            return 1.0
        return max(factor, 0.5)
    return max(factor, NOISE_FLOOR[s.kind] ** 2 / mean_r)


def _noise_ratio(full: Series, thin: Series) -> float:
    """Factor that tuning put on the noise of the thinned series, for the full one."""
    if not len(full) or not len(thin):
        return 1.0
    blocks = len(full) / max(len(thin), 1)
    thinning = max(1.0, round(blocks))
    return float(thin.noise[:, 0].mean() * thinning / full.noise[:, 0].mean())
