"""Each source's latency against the reference source, found from the log.

A latency is a constant state of the filter: to first order a late source measures h(x(t - tau)) = h(x) - tau dh/dt, so
a filter with tau among its states finds it together with the sensors' biases, with its one sigma. After each pass the
stamps are moved by what was found and the pass repeated (Gauss-Newton), beginning at the coarse guess.

Every source is compared with the reference alone. Together they would be more precise, but real receivers delay
and smooth each quantity in its own way, and then one source's misfit pulls at the others' latencies.
The motion model is kept loose where the reference is an IMU: the acceleration then is what the accelerometer
reads, and a driver who is quicker than the model does not look like a latency.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cwcli.estimation.coarse_latency import coarse_latency
from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.measurements import RATES, Kind
from cwcli.estimation.model import ModelParameters
from cwcli.estimation.noise import MIN_ROWS_FOR_NOISE, noise_factor
from cwcli.estimation.passes import Series, run_pass
from cwcli.estimation.prepare import thinned
from cwcli.estimation.start import start_with_parameters
from cwcli.metrics.chi_square import chi_square_quantile
from cwcli.signals.columns import FloatArray

PRIOR_S = 0.2  # one sigma about the coarse guess
MIN_GUESS_S = 0.15  # nearer to zero the filter gets there by itself
TRUST_S = 0.5  # farther from the guess the filter's linearisation is not believed
OBSERVABLE_S = 0.05  # a latency known worse than this is not corrected
THINNED_HZ = 25.0
WINDOW_S = 300.0
GATE = 1.0 - 1e-5
MAX_PASSES = 6
LEAD_IN_S = 2.5  # the reference before the target: the longest latency of the coarse search, and a little
FAR_M = 100.0
LOOSE_JERK_MPS3 = 20.0
LOOSE_YAW_ACCEL_RADPS2 = 4.0
SIDE_SLIP_M = 0.03  # less than the filter's own: a latency needs the position's long memory


@dataclass(frozen=True)
class Latency:
    """One source's latency: seconds (positive = late), one sigma, and how it was come by (see `SourceReport`)."""

    seconds: float
    sigma_s: float
    status: str


def latency_roles(series: Sequence[Series], config: EstimatorConfig) -> list[Latency]:
    """Decide which series is the reference, which latency is given and which is to be estimated ("estimated")."""
    nan = float("nan")
    if config.latency == "none":
        return [Latency(0.0, nan, "off") for _ in series]
    given: Mapping[str, float] = {} if isinstance(config.latency, str) else config.latency
    source, kinds = _reference(series)
    roles = []
    for s in series:
        named = given.get(f"{s.source}:{s.kind.name.lower()}", given.get(s.source))
        if named is not None:
            roles.append(Latency(float(named), nan, "given"))
        elif s.source == source and s.kind in kinds:
            roles.append(Latency(0.0, nan, "reference"))
        elif len(s) < MIN_ROWS_FOR_NOISE:
            roles.append(Latency(0.0, nan, "not observable"))
        else:
            roles.append(Latency(0.0, nan, "estimated"))
    return roles


def _reference(series: Sequence[Series]) -> tuple[str, tuple[Kind, ...]]:
    """The IMU if there is one, else the speed (with a yaw rate of the same source), else the position."""
    for s in series:
        if s.bias_state >= 0 and len(s):
            return s.source, RATES
    for s in series:
        if s.kind is Kind.SPEED and len(s):
            return s.source, (Kind.SPEED, *RATES)
    for s in series:
        if s.kind in RATES and len(s):
            return s.source, RATES
    for s in series:
        if s.kind is Kind.POSITION and len(s):
            return s.source, (Kind.POSITION,)
    return "", ()


def find_latencies(
    series: Sequence[Series],
    roles: Sequence[Latency],
    parameters: ModelParameters,
    walk: FloatArray,
    prior: FloatArray,
) -> list[Latency]:
    """Replace every role "estimated" by what the log says: "estimated" or "not observable".

    Args:
        series: All series, bias states set.
        roles: Parallel to `series`, see `latency_roles`.
        parameters: Motion model.
        walk, prior: Shape (n,): random walk and prior variances of the parameter states.
    """
    reference = [replace(s, latency_s=r.seconds) for s, r in zip(series, roles, strict=True) if r.status == "reference"]
    begin, end = _window(series, reference)
    reference = [_cut(_thin(s), begin, end) for s in reference]
    if any(s.bias_state >= 0 for s in reference):
        parameters = replace(
            parameters,
            jerk_sigma_mps3=LOOSE_JERK_MPS3,
            yaw_accel_sigma_radps2=LOOSE_YAW_ACCEL_RADPS2,
            side_slip_m=SIDE_SLIP_M,
        )
    found = []
    for s, role in zip(series, roles, strict=True):
        if role.status == "estimated":
            target = _cut(_thin(s), begin, end)
            # What the reference says long before the target's first row only adds a start that is badly known.
            first = float(target.time_s[0]) - LEAD_IN_S if len(target) else begin
            found.append(_find(target, [_cut(r, first, end) for r in reference], parameters, walk, prior))
        else:
            found.append(role)
    return found


def _find(
    target: Series,
    reference: Sequence[Series],
    parameters: ModelParameters,
    walk: FloatArray,
    prior: FloatArray,
) -> Latency:
    """Estimate one source's latency against the reference."""
    if len(target) < MIN_ROWS_FOR_NOISE or not any(len(s) for s in reference):
        return Latency(0.0, float("nan"), "not observable")
    coarse = coarse_latency(target, reference)
    guesses = (0.0, coarse) if abs(coarse) > MIN_GUESS_S else (0.0,)
    found = [_refine(target, reference, guess, parameters, walk, prior) for guess in guesses]
    return max(found, key=lambda pair: pair[1])[0]


def _refine(
    target: Series,
    reference: Sequence[Series],
    guess: float,
    parameters: ModelParameters,
    walk: FloatArray,
    prior: FloatArray,
) -> tuple[Latency, float]:
    """Run the filter with the latency among its states until the stamps stay; returns it with the log-likelihood."""
    n = len(walk)
    now = replace(target, latency_s=guess, latency_state=n, gate=chi_square_quantile(GATE, target.width))
    others = [replace(s, gate=chi_square_quantile(GATE, s.width)) for s in reference]
    walks, priors = np.append(walk, 0.0), np.append(prior, PRIOR_S**2)
    sigma, likelihood = float("inf"), -float("inf")
    for _ in range(MAX_PASSES):
        start = start_with_parameters([now, *others], priors, causal=False)
        # The prior stays about the guess while the stamps move.
        start.state[n] = guess - now.latency_s
        # The first position must not count twice: at constant speed a shift in time is a shift in place.
        start.covariance[0, 0] = start.covariance[1, 1] = FAR_M**2
        result = run_pass([now, *others], start, parameters.motion(walks), np.zeros(0), smooth=False, reset_after=50)
        likelihood = result.log_likelihood
        if not np.isfinite(result.last_state).all():
            return Latency(0.0, float("nan"), "not observable"), -float("inf")
        move = float(np.clip(result.last_state[n], -TRUST_S, TRUST_S))
        sigma = float(np.sqrt(result.last_covariance[n, n]))
        factor = noise_factor(now, result.nis[0])
        latency = float(np.clip(now.latency_s + move, guess - TRUST_S, guess + TRUST_S))
        moved, now = abs(latency - now.latency_s), replace(now.scaled(factor), latency_s=latency)
        if moved < max(5e-4, 0.1 * sigma) and abs(factor - 1.0) < 0.1:
            break
    if not sigma < OBSERVABLE_S:
        return Latency(0.0, sigma, "not observable"), likelihood
    return Latency(now.latency_s, sigma, "estimated"), likelihood


def _window(series: Sequence[Series], reference: Sequence[Series]) -> tuple[float, float]:
    """Return the span of at most WINDOW_S in which the reference is most excited."""
    rows = [s for s in reference if len(s) > 1]
    begin = min((float(s.time_s[0]) for s in series if len(s)), default=0.0)
    end = max((float(s.time_s[-1]) for s in series if len(s)), default=0.0)
    if end - begin <= WINDOW_S or not rows:
        return begin, end
    edges = np.arange(begin, end, WINDOW_S / 10)
    energy = np.zeros(len(edges))
    for s in rows:
        value = s.values[:, 0] - np.median(s.values[:, 0])
        slot = np.clip(((s.time_s - begin) / (WINDOW_S / 10)).astype(np.int64), 0, len(edges) - 1)
        power = np.bincount(slot, weights=value**2, minlength=len(edges))
        energy += power / max(float(power.sum()), 1e-12)
    best = int(np.convolve(energy, np.ones(10), mode="valid").argmax()) if len(energy) >= 10 else 0
    return float(edges[best]), float(edges[best]) + WINDOW_S


def _cut(s: Series, begin: float, end: float) -> Series:
    inside = (s.time_s >= begin) & (s.time_s <= end)
    if inside.all():
        return s
    return replace(s, time_s=s.time_s[inside], values=s.values[inside], noise=s.noise[inside])


def _thin(s: Series) -> Series:
    """Average an IMU down to about THINNED_HZ."""
    if s.kind not in RATES or len(s) < 3:
        return s
    return thinned(s, int(1.0 / (THINNED_HZ * max(float(np.median(np.diff(s.time_s))), 1e-4)) + 0.25))
