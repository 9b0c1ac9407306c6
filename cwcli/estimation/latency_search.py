"""Each source's latency against the reference source, found from the log.

A latency is a constant state of the filter: to first order a late source measures h(x(t - tau)) = h(x) - tau dh/dt, so
a filter with tau among its states finds it together with the sensors' biases. After each pass the stamps are moved by
what was found and the pass repeated (Gauss-Newton), beginning at the coarse guess. Where that comes to, the evidence is
weighed with passes of fixed latencies (`latency_evidence`).

Every source is compared with the reference alone. Together they would be more precise, but real receivers delay
and smooth each quantity in its own way, and then one source's misfit pulls at the others' latencies.
The motion model is kept loose where the reference is an IMU: the acceleration then is what the accelerometer
reads, and a driver who is quicker than the model does not look like a latency.

The errors of fixes are slow. Where the log is likelier with a slow error of the positions (Gauss-Markov), the search
goes on with one; the bound on the latency's sigma then is that with coloured noise.

What was found is applied only where it is clearly there: more than three sigma from zero, with the sigma of the scatter
over the blocks of the log, and better than zero at predicting rows from which it was not found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cwcli.estimation.coarse_latency import coarse_latency
from cwcli.estimation.latency import SIGNIFICANT_SIGMAS, Latency, LatencyStatus, references
from cwcli.estimation.latency_evidence import Evidence
from cwcli.estimation.measurements import RATES, Kind
from cwcli.estimation.model import ModelParameters
from cwcli.estimation.noise import MIN_ROWS_FOR_NOISE, noise_factor
from cwcli.estimation.passes import PassResult, Series, Start, run_pass
from cwcli.estimation.prepare import thinned
from cwcli.estimation.start import start_with_parameters
from cwcli.kernels.ekf import UpdateStatus
from cwcli.metrics.chi_square import gate_nis
from cwcli.signals.columns import FloatArray

PRIOR_S = 0.2  # one sigma about the coarse guess
MIN_GUESS_S = 0.15  # nearer to zero the filter gets there by itself
TRUST_S = 0.5  # farther from the guess the filter's linearisation is not believed
OBSERVABLE_S = 0.05  # a latency whose bound is larger is told only where it is clearly there
TOLD_S = 0.1  # and with a larger one not at all
THINNED_HZ = 25.0
WINDOW_S = 300.0
GATE_PROBABILITY = 1.0 - 1e-5
NEAR_S = 0.02  # near enough for the evidence to be weighed
SMALL = 1.1  # noise whose variance has to grow by more than this made the gate reject good rows
LARGE = 0.25  # noise whose variance has to shrink below this part hid too much
SETTLED = 2.0
MAX_STATES = 24  # of the kernel; the slow error takes two and the latency one
SLOW_SIGMAS_M = (0.3, 1.0, 3.0)
SLOW_TIMES_S = (1.0, 3.0, 10.0)
SLOW_GAIN = 9.0  # in the log-likelihood, for two more numbers
MAX_PASSES = 6
MAX_WEIGHINGS = 4
LEAD_IN_S = 2.5  # the reference before the target: the longest latency of the coarse search, and a little
FAR_M = 100.0
LOOSE_JERK_MPS3 = 20.0
LOOSE_YAW_ACCEL_RADPS2 = 4.0
SIDE_SLIP_M = 0.03  # less than the filter's own: a latency needs the position's long memory


def find_latencies(
    series: Sequence[Series],
    roles: Sequence[Latency | None],
    parameters: ModelParameters,
    walk: FloatArray,
    prior: FloatArray,
) -> list[Latency]:
    """Replace every None of the roles by what the log says.

    Args:
        series: All series, bias states set.
        roles: Parallel to `series`, see `latency_roles`.
        parameters: Motion model.
        walk, prior: Shape (n,): random walk and prior variances of the parameter states.
    """
    decided = [role for role in roles if role is not None]
    if len(decided) == len(roles):
        return decided
    reference = [
        replace(s, time_s=s.time_s - role.applied_s)
        for s, role, is_reference in zip(series, roles, references(series), strict=True)
        if is_reference and role is not None
    ]
    begin, end = _window(series, reference)
    reference = [
        replace(cut, gate_nis=gate_nis(GATE_PROBABILITY, cut.width))
        for cut in (_thin(_cut(s, begin, end)) for s in reference)
    ]
    if any(s.bias_state >= 0 for s in reference):
        parameters = replace(
            parameters,
            jerk_sigma_mps3=LOOSE_JERK_MPS3,
            yaw_accel_sigma_radps2=LOOSE_YAW_ACCEL_RADPS2,
            side_slip_m=SIDE_SLIP_M,
        )
    found = []
    for s, role in zip(series, roles, strict=True):
        if role is not None:
            found.append(role)
            continue
        target = _thin(_cut(s, begin, end))
        # What the reference says long before the target's first row only adds a start that is badly known.
        first = float(target.time_s[0]) - LEAD_IN_S if len(target) else begin
        search = _Search(target, [_cut(r, first, end) for r in reference], parameters, walk, prior)
        found.append(search.latency())
    return found


@dataclass(frozen=True)
class _Found:
    """Where the filter came to from one guess, its latency a state.

    Attributes:
        target: The source with this latency and the noise that goes with it.
        sigma_s: What the filter says of the latency; rather too little, see `_Search._weighed`.
        result: The last pass.
    """

    target: Series
    sigma_s: float
    result: PassResult


@dataclass(frozen=True)
class _Weighed:
    """The evidence about a latency, and the passes that it comes from.

    Attributes:
        target, reference: The rows that were used where the latency was found; here they are never gated.
        evidence: About the latency.
    """

    target: Series
    reference: Sequence[Series]
    evidence: Evidence


@dataclass(frozen=True)
class _Search:
    """The search for one source's latency against the reference.

    Attributes:
        target: The source.
        reference: The reference's series.
        parameters, walk, prior: See `find_latencies`.
    """

    target: Series
    reference: Sequence[Series]
    parameters: ModelParameters
    walk: FloatArray
    prior: FloatArray

    def latency(self) -> Latency:
        """Find the latency and decide what is made of it."""
        if len(self.target) < MIN_ROWS_FOR_NOISE or not any(len(s) for s in self.reference):
            return Latency(LatencyStatus.NOT_OBSERVABLE)
        coarse = coarse_latency(self.target, self.reference)
        guesses = (0.0, coarse) if abs(coarse) > MIN_GUESS_S else (0.0,)
        reached = [found for guess in guesses if (found := self._approached(guess)) is not None]
        if not reached:
            return Latency(LatencyStatus.NOT_OBSERVABLE)
        found = max(reached, key=lambda f: f.result.log_likelihood)
        slow = self._with_slow_error(found)
        if slow is not None:
            return slow._decided(slow._approached(found.target.latency_s))
        return self._decided(found)

    def _decided(self, found: _Found | None) -> Latency:
        """What is made of the latency that the filter came to."""
        if found is None:
            return Latency(LatencyStatus.NOT_OBSERVABLE)
        weighed = self._weighed(found) if found.sigma_s < TOLD_S else None
        if weighed is None:
            return Latency(LatencyStatus.NOT_OBSERVABLE, bound_s=found.sigma_s)
        found_s, sigma_s, bound_s = weighed.evidence.latency_s, weighed.evidence.sigma_s, weighed.evidence.formal_s
        if bound_s < TOLD_S and abs(found_s) > SIGNIFICANT_SIGMAS * sigma_s and self._predicts(weighed):
            return Latency(LatencyStatus.APPLIED, found_s, sigma_s, bound_s)
        if not bound_s < OBSERVABLE_S:
            return Latency(LatencyStatus.NOT_OBSERVABLE, bound_s=bound_s)
        return Latency(LatencyStatus.NOT_SIGNIFICANT, found_s, sigma_s, bound_s)

    def _with_slow_error(self, found: _Found) -> _Search | None:
        """The same search with a slow error of the positions, where the log is clearly likelier with one.

        Errors of fixes last for seconds. Taken for white noise they make the filter follow them, and the latency is as
        sure as it is wrong. Of a few sizes and time constants the likeliest counts.
        """
        if self.target.kind is not Kind.POSITION or len(self.walk) + 3 > MAX_STATES:
            return None
        white = replace(found.target, latency_state=-1, gate_nis=gate_nis(GATE_PROBABILITY, self.target.width))
        likeliest, search = self._likelihood(white), None
        least = likeliest + SLOW_GAIN
        for time_s in SLOW_TIMES_S:
            for sigma_m in SLOW_SIGMAS_M:
                trial = self._slower(white, sigma_m, time_s)
                likelihood = trial._likelihood(trial.target)
                if likelihood > max(likeliest, least):
                    likeliest, search = likelihood, trial
        return search

    def _slower(self, target: Series, sigma_m: float, time_s: float) -> _Search:
        """With a slow error of this sigma on each axis and this time constant, and the noise that then is left."""
        n = len(self.walk)
        slower = replace(
            self,
            target=replace(target, slow_state=n),
            parameters=replace(
                self.parameters, time_constant_s={**self.parameters.time_constant_s, n: time_s, n + 1: time_s}
            ),
            walk=np.append(self.walk, [2.0 * sigma_m**2 / time_s] * 2),
            prior=np.append(self.prior, [sigma_m**2] * 2),
        )
        series = [slower.target, *self.reference]
        result = slower._pass(series, slower._start(series, slower.prior), slower.walk)
        return replace(slower, target=slower.target.scaled(noise_factor(slower.target, result.nis[0])))

    def _likelihood(self, target: Series) -> float:
        """The log-likelihood with the latency and the noise as they are."""
        series = [target, *self.reference]
        return self._pass(series, self._start(series, self.prior), self.walk).log_likelihood

    def _approached(self, guess: float) -> _Found | None:
        """Run the filter with the latency among its states until the stamps stay; None where it breaks down."""
        n = len(self.walk)
        now = replace(
            self.target, latency_s=guess, latency_state=n, gate_nis=gate_nis(GATE_PROBABILITY, self.target.width)
        )
        walks, priors = np.append(self.walk, 0.0), np.append(self.prior, PRIOR_S**2)
        for damping in (1.0, *[0.5] * (MAX_PASSES - 1)):
            start = self._start([now, *self.reference], priors)
            # The prior stays about the guess while the stamps move.
            start.state[n] = guess - now.latency_s
            result = self._pass([now, *self.reference], start, walks)
            if not np.isfinite(result.last_state).all():
                return None
            move = float(np.clip(result.last_state[n], -TRUST_S, TRUST_S))
            # The innovations' own variance follows the noise: the whole way again and again would swing about the goal.
            factor = noise_factor(now, result.nis[0]) ** damping
            latency = float(np.clip(now.latency_s + move, guess - TRUST_S, guess + TRUST_S))
            moved, now = abs(latency - now.latency_s), replace(now.scaled(factor), latency_s=latency)
            if moved < NEAR_S and LARGE < factor < SMALL:
                break
        return _Found(now, float(np.sqrt(result.last_covariance[n, n])), result)

    def _weighed(self, found: _Found) -> _Weighed | None:
        """Weigh the evidence about the latency that the filter came to, until it and the noise stay, else None.

        A latency as a state can mislead: it is multiplied with a speed or a rate that is itself uncertain. Here it is
        fixed in each pass, and all passes have the same rows: those that were used in the last pass before.
        """
        target, *reference = (
            replace(s.at(status >= UpdateStatus.USED), gate_nis=0.0, latency_state=-1)
            for s, status in zip([found.target, *self.reference], found.result.status, strict=True)
        )
        if len(target) < MIN_ROWS_FOR_NOISE:
            return None
        for _ in range(MAX_WEIGHINGS):
            centre_s = target.latency_s
            less, just, more = (
                self._nis(replace(target, latency_s=latency_s), reference)
                for latency_s in (centre_s - OBSERVABLE_S, centre_s, centre_s + OBSERVABLE_S)
            )
            surprise = (less[:, 0], just[:, 0], more[:, 0])
            evidence = Evidence.of(target.time_s - centre_s, centre_s, OBSERVABLE_S, *surprise)
            factor = noise_factor(target, just)
            move_s = evidence.latency_s - centre_s
            if not np.isfinite(move_s):
                return None
            if abs(move_s) < OBSERVABLE_S and 1.0 / SETTLED < factor < SETTLED:
                return _Weighed(target, reference, evidence)
            move_s = float(np.clip(move_s, -PRIOR_S, PRIOR_S))
            target = replace(target.scaled(factor**0.5), latency_s=centre_s + move_s)
        return None

    def _predicts(self, weighed: _Weighed) -> bool:
        """Are the rows of each half predicted better with the latency that the other half says than with zero?

        Better by SIGNIFICANT_SIGMAS, and zero is tried, not read off the parabolas, which hold near the latency alone.
        Both halves together: a latency that drifts may be wrong for one of them and still be far better than none.
        """
        with_zero = self._nis(replace(weighed.target, latency_s=0.0), weighed.reference)[:, 0].sum()
        return bool(with_zero - weighed.evidence.crossed() > SIGNIFICANT_SIGMAS**2)

    def _nis(self, target: Series, reference: Sequence[Series]) -> FloatArray:
        """The target's `nis` of a pass whose latencies are fixed; an outlier counts, but no more than as one."""
        series = [target, *reference]
        nis = self._pass(series, self._start(series, self.prior), self.walk).nis[0]
        np.minimum(nis[:, 0], gate_nis(GATE_PROBABILITY, target.width), out=nis[:, 0])
        return nis

    def _start(self, series: Sequence[Series], prior: FloatArray) -> Start:
        """Where a pass begins."""
        start = start_with_parameters(series, prior, causal=False)
        # The first position must not count twice: at constant speed a shift in time is a shift in place.
        start.covariance[0, 0] = start.covariance[1, 1] = FAR_M**2
        return start

    def _pass(self, series: Sequence[Series], start: Start, walk: FloatArray) -> PassResult:
        """One pass of the filter."""
        return run_pass(series, start, self.parameters.motion(walk), np.zeros(0), smooth=False, reset_after=50)


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
