"""Each source's latency against the reference source, found from the log.

The filter runs over target and reference with the stamps of the target moved by each latency of a grid, each time with
the noise that goes with it. The log-likelihood of all rows is largest at the latency; how it falls to both sides is the
evidence, which is weighed with passes about the top (`latency_evidence`). The rows of a reference count too, because
each is predicted from what the target said before; but for an IMU's, which the motion model is too loose to predict.

Every source is compared with the reference alone. Together they would be more precise, but real receivers delay
and smooth each quantity in its own way, and then one source's misfit pulls at the others' latencies.
The motion model is kept loose where the reference is an IMU: the acceleration then is what the accelerometer
reads, and a driver who is quicker than the model does not look like a latency.

The errors of fixes are slow. Where the log is likelier with a slow error of the positions (Gauss-Markov), the search
goes on with one; the bound on the latency's sigma then is that with coloured noise.

What was found is applied only where it is clearly there: more than three sigma from zero, with the sigma of the scatter
over the blocks of the log, and better than zero at predicting rows from which it was not found. Where a line predicts
blocks from which it was not found better than a constant, the latency drifts, and is corrected along the line.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.estimation.latency import (
    MIN_SIGNIFICANT_SIGMAS,
    Latency,
    LatencyStatus,
    is_latency_reference_by_series,
    remove_latency_drift,
)
from cwcli.estimation.latency_evidence import LatencyEvidence
from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, Kind
from cwcli.estimation.noise_matching import MIN_ROWS_FOR_NOISE, noise_variance_factor
from cwcli.estimation.passes import PassResult, SensorSeries
from cwcli.estimation.prepare import average_rows_to_rate
from cwcli.estimation.score import row_log_likelihoods
from cwcli.estimation.sensor_model import StateLayout
from cwcli.estimation.trial import (
    MAX_NOISE_FACTOR_AT_CONVERGENCE,
    MAX_NOISE_MATCHINGS,
    SEARCH_PROGRESS_UNIT_NAME,
    USUAL_PASSES_PER_SEARCH,
    FilterTrials,
    cut_to_window,
    with_outlier_gate,
)
from cwcli.kernels.ekf import UpdateStatus
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import FloatArray, median_of_values
from cwcli.work_share import part_of_work

LATENCY_GRID_STEP_S = 0.25
"""Step of the grid of latencies, s. Chosen finer than the manoeuvres that show one."""
LATENCY_GRID_S = np.arange(-0.5, 2.01, LATENCY_GRID_STEP_S)
"""Grid of latencies that are tried, s; positive is late. Chosen by hand; not fitted."""
LATENCY_PROBE_OFFSETS_S = (0.05, 0.1, 0.2, 0.4)
"""Distances from the likeliest latency at which a parabola is laid, s. Chosen by hand; not fitted."""
LOG_LIKELIHOOD_FALL_AT_THREE_SIGMA = 0.5 * MIN_SIGNIFICANT_SIGMAS**2
"""Fall of the log-likelihood at three sigma from its top."""
MAX_SIGMA_OF_INSIGNIFICANT_LATENCY_S = 0.05
"""Greatest standard deviation of a latency, s, with which a latency near 0 counts as found to be insignificant; with a
greater one it counts as not observable. Chosen by hand; not fitted."""
MAX_REPORTED_LATENCY_BOUND_S = 0.1
"""Greatest bound of a latency, s, that is reported at all. Chosen by hand; not fitted."""
IMU_AVERAGING_HZ = 25.0
"""Rate to which an IMU is averaged, Hz. Chosen for speed; not fitted."""
GRID_SEARCH_AVERAGING_HZ = 10.0
"""Rate to which frequent sources are averaged for the grid, Hz. Chosen for speed; not fitted."""
MAX_SEARCHED_LOG_SPAN_S = 300.0
"""Longest span of a log that is searched, s. Chosen for speed; not fitted."""
MAX_KERNEL_STATES = 24
"""Greatest number of states of the kernel; the slow error takes two."""
SLOW_ERROR_SIGMAS_M = (0.3, 1.0, 3.0)
"""Sigmas of slow errors of positions that are tried, m. Chosen by hand; not fitted."""
SLOW_ERROR_TIME_CONSTANTS_S = (1.0, 3.0, 10.0)
"""Time constants of slow errors that are tried, s. Chosen by hand; not fitted."""
MIN_LOG_LIKELIHOOD_GAIN_OF_SLOW_ERROR = 9.0
"""Least gain of log-likelihood of a slow error: 4.5 for each of its two parameters."""
MAX_ITERATIONS_PER_PROBE_DISTANCE = 4
"""Greatest number of iterations at one probe distance. Chosen for speed; not fitted."""
REFERENCE_LEAD_IN_S = 2.5
"""Time before the target's first row from which the reference is used, s: the longest latency and a little."""
START_POSITION_SIGMA_M = 100.0
"""One sigma of the start's position, m. Chosen large, so that the first position does not count twice."""
IMU_REFERENCE_JERK_SIGMA_MPS3 = 20.0
"""Jerk sigma with an IMU as reference, m/s^3. Chosen large, so that the state follows the IMU."""
IMU_REFERENCE_YAW_ACCEL_SIGMA_RADPS2 = 4.0
"""Yaw acceleration sigma with an IMU as reference, rad/s^2. Chosen large, so that the state follows the IMU."""
SEARCH_POSITION_NOISE_M_PER_ROOT_S = 0.03
"""Position noise during the search, m per root s. Chosen below the filter's own: a latency needs a long memory."""


def find_latencies(layout: StateLayout, predetermined: Sequence[Latency | None]) -> list[Latency]:
    """Replace every None of the predetermined latencies by what the log says.

    Args:
        predetermined: Parallel to the series, see `latencies_known_without_search`.
    """
    decided = [role for role in predetermined if role is not None]
    if len(decided) == len(predetermined):
        return decided
    series, parameters = layout.series, layout.parameters
    reference = [
        replace(s, time_s=s.time_s - role.applied_s)
        for s, role, is_reference in zip(series, predetermined, is_latency_reference_by_series(series), strict=True)
        if is_reference and role is not None
    ]
    begin, end = _begin_and_end_of_most_excited_window_s(series, reference)
    reference = [with_outlier_gate(_cut_to_window_and_average_imu(s, begin, end)) for s in reference]
    if any(s.bias_state >= 0 for s in reference):
        parameters = replace(
            parameters,
            jerk_sigma_mps3=IMU_REFERENCE_JERK_SIGMA_MPS3,
            yaw_accel_sigma_radps2=IMU_REFERENCE_YAW_ACCEL_SIGMA_RADPS2,
            side_slip_m=SEARCH_POSITION_NOISE_M_PER_ROOT_S,
        )
    found = []
    n_searched, n_to_search = 0, len(predetermined) - len(decided)
    for s, role in zip(series, predetermined, strict=True):
        if role is not None:
            found.append(role)
            continue
        target = _cut_to_window_and_average_imu(s, begin, end)
        # What the reference says long before the target's first row only adds a start that is badly known.
        first = float(target.time_s[0]) - REFERENCE_LEAD_IN_S if len(target) else begin
        near = [cut_to_window(r, first, end) for r in reference]
        # The first position must not count twice: at constant speed a shift in time is a shift in place.
        trials = FilterTrials(start_position_sigma_m=START_POSITION_SIGMA_M)
        share_done, share_after = n_searched / n_to_search, (n_searched + 1) / n_to_search
        with part_of_work(share_done, share_after, SEARCH_PROGRESS_UNIT_NAME, USUAL_PASSES_PER_SEARCH):
            found.append(_LatencySearch(target, near, replace(layout, parameters=parameters), trials).find_latency())
        n_searched += 1
    return found


@dataclass(frozen=True)
class _LatencyLikelihoodProfile:
    """How likely each latency of the grid is, with the noise that goes with it.

    Attributes:
        likelihood: Shape (n,): the log-likelihood at `LATENCY_GRID_S`.
        noise: Shape (n,): factors on the noise variance of the target.
    """

    likelihood: FloatArray
    noise: FloatArray

    @property
    def likeliest_latency_and_likelihood(self) -> tuple[float, float]:
        """The likeliest latency and its log-likelihood, by a parabola through the best one and its neighbours."""
        best = int(self.likelihood.argmax())
        latency_s, most = float(LATENCY_GRID_S[best]), float(self.likelihood[best])
        if not 0 < best < len(LATENCY_GRID_S) - 1:
            return latency_s, most
        less, more = self.likelihood[best - 1], self.likelihood[best + 1]
        move = 0.5 * float(more - less) / max(float(2.0 * most - less - more), 1e-9)
        return latency_s + move * LATENCY_GRID_STEP_S, most + 0.25 * move * float(more - less)

    def sigma_covering_possible_latencies_s(self, evidence: LatencyEvidence) -> float:
        """The least sigma with which all latencies that the log does not exclude lie within three sigma.

        A parabola knows nothing of a second top. What lies `LOG_LIKELIHOOD_FALL_AT_THREE_SIGMA` below the first one is
        excluded, or more where the scatter over the blocks says that the likelihood is too sure.
        """
        away_s = np.abs(LATENCY_GRID_S - evidence.likeliest_latency_s)
        least = (
            self.likeliest_latency_and_likelihood[1]
            - LOG_LIKELIHOOD_FALL_AT_THREE_SIGMA * (evidence.block_scatter_sigma_s / evidence.formal_sigma_s) ** 2
        )
        possible = (self.likelihood > least) & (away_s > LATENCY_GRID_STEP_S)
        return float(away_s[possible].max(initial=0.0)) / MIN_SIGNIFICANT_SIGMAS


@dataclass(frozen=True)
class _LatencySearch:
    """The search for one source's latency against the reference.

    Attributes:
        target: The source.
        reference: The reference's series.
        layout: Motion model and parameter states; its series are not used.
        trials: Passes over their rows.
    """

    target: SensorSeries
    reference: Sequence[SensorSeries]
    layout: StateLayout
    trials: FilterTrials

    def find_latency(self) -> Latency:
        """Find the latency and decide what is made of it."""
        if not self._has_enough_rows:
            return Latency(LatencyStatus.NOT_OBSERVABLE)
        profile = self._scan_latency_grid()
        search = self._move_to_likeliest_latency(profile)._drop_outliers()
        if not search._has_enough_rows:
            return Latency(LatencyStatus.NOT_OBSERVABLE)
        weighed = search._refine_noise_and_latency_evidence()
        slow = None if weighed is None else replace(search, target=weighed[0])._add_slow_error_if_likelier()
        if slow is not None:
            profile = slow._scan_latency_grid()
            weighed = slow._move_to_likeliest_latency(profile)._refine_noise_and_latency_evidence()
        if weighed is None:
            return Latency(LatencyStatus.NOT_OBSERVABLE)
        return (slow or search)._decide_latency_status(*weighed, profile)

    @property
    def _has_enough_rows(self) -> bool:
        return len(self.target) >= MIN_ROWS_FOR_NOISE and any(len(s) for s in self.reference)

    def _scan_latency_grid(self) -> _LatencyLikelihoodProfile:
        """Try all latencies, with fewer rows of what comes often: enough to see where the likelihood is high."""
        coarse = replace(
            self,
            target=average_rows_to_rate(self.target, GRID_SEARCH_AVERAGING_HZ),
            reference=[average_rows_to_rate(s, GRID_SEARCH_AVERAGING_HZ) for s in self.reference],
        )
        target, likelihood, noise = coarse.target, [], []
        for latency_s in LATENCY_GRID_S.tolist():
            target = coarse._match_noise_to_innovations(replace(target, latency_s=latency_s))
            likelihood.append(coarse._log_likelihood_of_scored_rows(target))
            noise.append(float(target.noise[0, 0] / coarse.target.noise[0, 0]))
        return _LatencyLikelihoodProfile(np.array(likelihood), np.array(noise))

    def _move_to_likeliest_latency(self, profile: _LatencyLikelihoodProfile) -> _LatencySearch:
        """The same search with the likeliest latency, and the noise that goes with it."""
        target = self.target.scale_noise_variance(float(profile.noise[profile.likelihood.argmax()]))
        return replace(
            self,
            target=self._match_noise_to_innovations(
                replace(target, latency_s=profile.likeliest_latency_and_likelihood[0])
            ),
        )

    def _match_noise_to_innovations(self, target: SensorSeries) -> SensorSeries:
        """The target with the noise that its innovations show."""
        for _ in range(MAX_NOISE_MATCHINGS):
            factor = noise_variance_factor(target, self._filter_target_with_references(target).nis[0])
            target = target.scale_noise_variance(factor)
            if 1.0 / MAX_NOISE_FACTOR_AT_CONVERGENCE < factor < MAX_NOISE_FACTOR_AT_CONVERGENCE:
                break
        return target

    def _drop_outliers(self) -> _LatencySearch:
        """The same search with the rows that the filter believes."""
        gated = self._trial_layout_of_target(with_outlier_gate(self.target))
        status = self.trials.run_filter(gated).status
        if all((was == UpdateStatus.USED).all() for was in status):
            # The reference keeps its gate in both.
            self.trials.reuse_pass_of_known_trial(self._trial_layout_of_target(self.target), gated)
            return self
        series = [self.target, *self.reference]
        target_without_outliers, *reference = (
            s.select_rows(was >= UpdateStatus.USED) for s, was in zip(series, status, strict=True)
        )
        return replace(self, target=target_without_outliers, reference=reference)

    def _add_slow_error_if_likelier(self) -> _LatencySearch | None:
        """The same search with a slow error of the positions, where the log is clearly likelier with one.

        Errors of fixes last for seconds. Taken for white noise they make the filter follow them, and the latency is as
        sure as it is wrong. Of a few sizes and time constants the likeliest counts.
        """
        if self.target.kind is not Kind.POSITION or len(self.layout.walk) + 2 > MAX_KERNEL_STATES:
            return None
        search = None
        least = self._log_likelihood_of_scored_rows(self.target) + MIN_LOG_LIKELIHOOD_GAIN_OF_SLOW_ERROR
        for time_s in SLOW_ERROR_TIME_CONSTANTS_S:
            for sigma_m in SLOW_ERROR_SIGMAS_M:
                trial = self._add_slow_error(sigma_m, time_s)
                if (likelihood := trial._log_likelihood_of_scored_rows(trial.target)) > least:
                    least, search = likelihood, trial
        return search

    def _add_slow_error(self, sigma_m: float, time_s: float) -> _LatencySearch:
        """With a slow error of this sigma on each axis and this time constant, and the noise that then is left."""
        layout, n = self.layout, len(self.layout.walk)
        time_constant_s = {**layout.parameters.time_constant_s, n: time_s, n + 1: time_s}
        slower = replace(
            self,
            target=replace(self.target, slow_state=n),
            layout=replace(
                layout,
                parameters=replace(layout.parameters, time_constant_s=time_constant_s),
                walk=np.append(layout.walk, [2.0 * sigma_m**2 / time_s] * 2),
                prior=np.append(layout.prior, [sigma_m**2] * 2),
            ),
        )
        return replace(slower, target=slower._match_noise_to_innovations(slower.target))

    def _log_likelihood_of_scored_rows(self, target: SensorSeries) -> float:
        """The log-likelihood of all telling rows."""
        return -float(np.nansum(self._row_negative_log_likelihoods(target)))

    def _decide_latency_status(
        self, target: SensorSeries, evidence: LatencyEvidence, profile: _LatencyLikelihoodProfile
    ) -> Latency:
        """What is made of a latency that was weighed."""
        if (drifting := self._find_drifting_latency(target, evidence, profile)) is not None:
            return drifting
        found_s, bound_s = evidence.likeliest_latency_s, evidence.formal_sigma_s
        sigma_s = max(evidence.block_scatter_sigma_s, profile.sigma_covering_possible_latencies_s(evidence))
        unknown = Latency(LatencyStatus.NOT_OBSERVABLE, bound_s=bound_s, reach_s=float(np.hypot(found_s, sigma_s)))
        if not (bound_s < MAX_REPORTED_LATENCY_BOUND_S and LATENCY_GRID_S[0] < found_s < LATENCY_GRID_S[-1]):
            return unknown
        if abs(found_s) > MIN_SIGNIFICANT_SIGMAS * sigma_s and self._predicts_better_than_zero_latency(
            target, evidence
        ):
            return Latency(LatencyStatus.APPLIED, found_s, sigma_s, bound_s)
        if not bound_s < MAX_SIGMA_OF_INSIGNIFICANT_LATENCY_S:
            return unknown
        return Latency(LatencyStatus.NOT_SIGNIFICANT, found_s, sigma_s, bound_s)

    def _find_drifting_latency(
        self, target: SensorSeries, evidence: LatencyEvidence, profile: _LatencyLikelihoodProfile
    ) -> Latency | None:
        """The latency as one that changes along the log, where that is likelier than a constant and than none."""
        drift = evidence.find_drift_rate_and_middle_s()
        if drift is None:
            return None
        rate, about_s = drift
        line = Latency(LatencyStatus.DRIFTS, drift=rate, middle_s=about_s + evidence.likeliest_latency_s)
        weighed = replace(
            self, target=self._match_noise_to_innovations(remove_latency_drift(target, line))
        )._refine_noise_and_latency_evidence()
        if weighed is None:
            return None
        straight, found = weighed
        target_with_likeliest_latency = replace(target, noise=straight.noise, latency_s=evidence.likeliest_latency_s)
        gain = self._log_likelihood_of_scored_rows(
            replace(straight, latency_s=found.likeliest_latency_s)
        ) - self._log_likelihood_of_scored_rows(target_with_likeliest_latency)
        if not (
            gain > LOG_LIKELIHOOD_FALL_AT_THREE_SIGMA
            and found.formal_sigma_s < MAX_REPORTED_LATENCY_BOUND_S
            and self._predicts_better_than_zero_latency(target_with_likeliest_latency, found)
        ):
            return None
        sigma_s = max(found.block_scatter_sigma_s, profile.sigma_covering_possible_latencies_s(found))
        return replace(line, found_s=found.likeliest_latency_s, sigma_s=sigma_s, bound_s=found.formal_sigma_s)

    def _refine_noise_and_latency_evidence(self) -> tuple[SensorSeries, LatencyEvidence] | None:
        """Weigh the evidence about the likeliest latency until it and the noise stay; None where nothing stays.

        The probes lie as far from it as it takes to see the likelihood fall by three sigma. Nearer it is rugged, as
        rows come before others or after them, and a parabola would be sure where nothing is to be seen.
        """
        target, evidence = self.target, None
        for probe_s in LATENCY_PROBE_OFFSETS_S:
            evidence = None
            for _ in range(MAX_ITERATIONS_PER_PROBE_DISTANCE):
                centre_s = target.latency_s
                less, just, more = (
                    self._row_negative_log_likelihoods(replace(target, latency_s=latency_s))
                    for latency_s in (centre_s - probe_s, centre_s, centre_s + probe_s)
                )
                weighed = LatencyEvidence.from_three_passes(
                    self._scored_row_times_s(target), centre_s, probe_s, less, just, more
                )
                move_s = weighed.likeliest_latency_s - centre_s
                if not np.isfinite(move_s):
                    break
                if abs(move_s) < 0.5 * probe_s:
                    evidence = (target, weighed)
                    break
                moved_target = replace(target, latency_s=centre_s + float(np.clip(move_s, -probe_s, probe_s)))
                target = self._match_noise_to_innovations(moved_target)
            if evidence is not None and MIN_SIGNIFICANT_SIGMAS * evidence[1].formal_sigma_s <= probe_s:
                break
        return evidence

    def _predicts_better_than_zero_latency(self, target: SensorSeries, evidence: LatencyEvidence) -> bool:
        """Are the rows of each half predicted better with the latency that the other half says than with zero?

        Better by `MIN_SIGNIFICANT_SIGMAS`, and zero is tried, not read off the parabolas, which hold near the latency
        only. Both halves together: a latency that drifts may be wrong for one of them and still be far better than
        none.
        """
        with_zero = -self._log_likelihood_of_scored_rows(replace(target, latency_s=0.0))
        return with_zero - evidence.cross_validated_neg_log_likelihood() > LOG_LIKELIHOOD_FALL_AT_THREE_SIGMA

    def _scored_series(self, target: SensorSeries) -> list[tuple[int, SensorSeries]]:
        """Return the series whose rows score a latency: the target, and the reference as far as the motion predicts it.

        An IMU is not predicted: the motion is loose, so that the state follows it.

        Returns:
            Index in the pass, and series.
        """
        return [(0, target), *((i, s) for i, s in enumerate(self.reference, 1) if s.bias_state < 0)]

    def _scored_row_times_s(self, target: SensorSeries) -> FloatArray:
        """Return when the scored rows were measured, s since the epoch."""
        return np.concatenate([s.time_s - s.latency_s for _, s in self._scored_series(target)])

    def _row_negative_log_likelihoods(self, target: SensorSeries) -> FloatArray:
        """Return for each scored row how unlikely it is after all before it; NaN where it lies before the start.

        It is the negative log-likelihood but for a constant; an outlier counts, but no more than as one.
        """
        nis = self._filter_target_with_references(target).nis
        return np.concatenate([-row_log_likelihoods(s, nis[i]) for i, s in self._scored_series(target)])

    def _filter_target_with_references(self, target: SensorSeries) -> PassResult:
        return self.trials.run_filter(self._trial_layout_of_target(target))

    def _trial_layout_of_target(self, target: SensorSeries) -> StateLayout:
        """The trial of a target beside the reference."""
        return replace(self.layout, series=[target, *self.reference])


def _begin_and_end_of_most_excited_window_s(
    series: Sequence[SensorSeries], reference: Sequence[SensorSeries]
) -> tuple[float, float]:
    """Return the span of at most `MAX_SEARCHED_LOG_SPAN_S` in which the reference is most excited."""
    rows = [s for s in reference if len(s) > 1]
    begin = min((float(s.time_s[0]) for s in series if len(s)), default=0.0)
    end = max((float(s.time_s[-1]) for s in series if len(s)), default=0.0)
    if end - begin <= MAX_SEARCHED_LOG_SPAN_S or not rows:
        return begin, end
    edges = np.arange(begin, end, MAX_SEARCHED_LOG_SPAN_S / 10)
    energy = np.zeros(len(edges))
    for s in rows:
        value = s.values[:, 0] - median_of_values(s.values[:, 0])
        slot = np.clip(((s.time_s - begin) / (MAX_SEARCHED_LOG_SPAN_S / 10)).astype(np.int64), 0, len(edges) - 1)
        power = np.bincount(slot, weights=value**2, minlength=len(edges))
        energy += power / max(float(power.sum()), 1e-12)
    best = int(np.convolve(energy, np.ones(10), mode="valid").argmax()) if len(energy) >= 10 else 0
    return float(edges[best]), float(edges[best]) + MAX_SEARCHED_LOG_SPAN_S


def _cut_to_window_and_average_imu(s: SensorSeries, begin: float, end: float) -> SensorSeries:
    """Cut a series to a window, and average an IMU to about `IMU_AVERAGING_HZ`."""
    cut = cut_to_window(s, begin, end)
    return average_rows_to_rate(cut, IMU_AVERAGING_HZ) if s.kind in KINDS_THAT_IMU_MEASURES_TOO else cut
