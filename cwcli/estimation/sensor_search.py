"""Search for errors of the sensors in a log: each is used only where the log is predicted better with it.

The score is the filter's log-likelihood: each row is predicted from the rows before it alone. The states' priors are in
it (it is a marginal likelihood), so that a scale or a lever arm that nothing shows gains nothing. What is fitted beside
it, sigma and time constant of a slow error, has to gain more.

All errors are put in together, because one's absence looks like another; sigma and time constant of the slow ones go
where the likelihood is largest; then each is left out again where the log does without it.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import field

import numpy as np

from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO, QUANTITY_BY_KIND, Kind
from cwcli.estimation.noise import LEAD_IN_BEFORE_FIRST_POSITION_S, longest_driven_window_start_s
from cwcli.estimation.noise_matching import MIN_ROWS_FOR_NOISE, noise_variance_factor
from cwcli.estimation.parameter import ParameterStatus
from cwcli.estimation.passes import SensorSeries, run_filter_pass
from cwcli.estimation.prepare import average_rows_to_rate
from cwcli.estimation.score import MIN_LIKELIHOOD_GAIN_PER_PARAMETER, bounded_log_likelihood_without_inertial_sensors
from cwcli.estimation.sensor_limits import range_of_sensor_error
from cwcli.estimation.sensor_model import (
    LEVER_ARM_AHEAD_PRIOR_SIGMA_M,
    GaussMarkovError,
    SensorModel,
    SeriesIndexAndErrorName,
    StateLayout,
    add_sensor_error_states,
    find_pitch_rate,
)
from cwcli.estimation.start import find_full_filter_start
from cwcli.estimation.tolerances import MIN_LOG_SPAN_FOR_SLOW_ERRORS_S
from cwcli.estimation.trial import (
    MAX_NOISE_FACTOR_AT_CONVERGENCE,
    MAX_NOISE_MATCHINGS,
    FilterTrials,
    cut_to_window,
    with_outlier_gate,
)
from cwcli.kernels.ekf import UpdateStatus
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import FloatArray

MAX_SEARCHED_LOG_SPAN_S = 240.0
"""Longest span that is searched, s. Chosen for speed; not fitted."""
SEARCH_AVERAGING_HZ = 10.0
"""Rate to which inertial series and speeds are averaged, Hz. Chosen for speed; not fitted."""
N_FITTED_PARAMETERS_BY_ERROR = {"slow": 2, "scale": 1, "lever": 1, "ahead": 1}
"""Name of an error of the sensor model -> number of its fitted parameters."""
INITIAL_GRADE_ERROR = GaussMarkovError(0.2, 15.0)
"""Initial error of an accelerometer by the grade (m/s^2, s). Chosen: 1.2 degrees, a hill of a few hundred metres."""
INITIAL_POSITION_TIME_CONSTANT_S = 10.0
"""Time constant at which the search for a slow error of positions begins, s. Chosen by hand; not fitted."""
SLOW_ERROR_TIME_CONSTANT_LIMITS_S = {Kind.POSITION: (1.0, 300.0), Kind.ACCEL: (5.0, 300.0)}
"""Least and greatest time constant of a slow error, s. Chosen: a slope lasts longer than the pitch of a body."""
SEARCH_POSITION_NOISE_M_PER_ROOT_S = 0.03
"""Position noise during the search, m per root s. Chosen below the filter's own: slow errors need a long memory."""
MIN_TIME_CONSTANTS_IN_LOG = 5.0
"""Least number of time constants in a log. Chosen by hand; not fitted."""
SEARCH_STEP_FACTORS_ON_VARIANCE_AND_TIME_CONSTANT = ((3.0, 1.0), (3.0**0.5, 1.0), (3.0, 3.0), (3.0**0.5, 1.0))
"""Step factors of the climb, on sigma^2 and on the time constant. Chosen by hand; not fitted."""
TIME_CONSTANT_FACTORS_TO_AVERAGE_SLOW_ERROR_OVER = (1.0 / 9.0, 1.0 / 3.0, 3.0, 9.0)
"""Factors on the time constant over which a slow error is averaged. Chosen by hand; not fitted."""
MIN_HEADING_RANGE_FOR_LEVER_ARM_RAD = 0.5
"""Least range of the heading from which a lever arm is searched, rad. Chosen: without a turn nothing shows one."""
FIX_INTERVAL_FOR_SPEED_S = 2.0
"""Time between two fixes from which a speed is taken, s. Chosen so that their distance exceeds the noise."""
MIN_LEVER_ARM_AHEAD_SIGMAS = 3.0
"""Least lever arm ahead in sigmas, including those of the latency. Chosen as for other significance tests."""
MAX_TRIALS_PER_SLOW_ERROR_SEARCH = 9
"""Greatest number of trials in the climb of one slow error. Chosen for speed; not fitted."""
MAX_OBSERVED_SIGMA_TO_PRIOR = 0.5
"""Greatest sigma of an observable parameter, as a share of its prior's. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class FoundSensorModel:
    """Sensor model that was found in a log.

    Attributes:
        model: The sensor model to use.
        status: Status of each error that was searched.
        ahead_m: Lever arm ahead and its sigma, of the series that have one.
        beyond: What was found of the errors that lie beyond what such a sensor can have, and are not used.
    """

    model: SensorModel = field(default_factory=SensorModel)
    status: Mapping[SeriesIndexAndErrorName, ParameterStatus] = field(default_factory=dict)
    ahead_m: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    beyond: Mapping[SeriesIndexAndErrorName, float] = field(default_factory=dict)

    def mark_forward_arms_unobservable(self, series: Sequence[int]) -> FoundSensorModel:
        """Return the result with the lever arms ahead of some series marked as not observable."""
        parts: list[SeriesIndexAndErrorName] = [(i, "ahead") for i in series]
        model = replace(self.model, ahead=self.model.ahead - set(series))
        return replace(
            self, model=model, status={**self.status, **dict.fromkeys(parts, ParameterStatus.NOT_OBSERVABLE)}
        )


def find_sensor_errors(
    layout_with_settled_latencies: StateLayout,
    previous: FoundSensorModel | None = None,
    remaining_latency_sigma_s: Sequence[float] | None = None,
) -> FoundSensorModel:
    """Find which errors the log shows, and sigma and time constant of the slow ones.

    Args:
        layout_with_settled_latencies: Series with latencies and noise settled, and their biases as the only parameter
            states.
        previous: What was found with other latencies: the climb begins there, and what was of no use is tried again.
        remaining_latency_sigma_s: Parallel to the series: one sigma of what the stamps may still be late by; None: 0.
            A car that turns while its fixes are late by tau looks like one whose antenna stands by v tau behind.
    """
    slack_m = _forward_arm_sigma_from_latency_m(
        layout_with_settled_latencies.series,
        [0.0] * len(layout_with_settled_latencies.series)
        if remaining_latency_sigma_s is None
        else remaining_latency_sigma_s,
    )
    whole = _model_with_all_possible_errors(
        layout_with_settled_latencies.series, SensorModel() if previous is None else previous.model, slack_m
    )
    if not may_show_sensor_errors(layout_with_settled_latencies.series) or not whole.modelled_errors:
        return FoundSensorModel()
    trials = _SensorModelTrials(layout_with_settled_latencies, slack_m)
    trial = trials.run_model_trial(whole)
    for i in whole.slow:
        trial = trials.climb_to_likeliest_slow_error(trial, i)
    if whole.pitch_compensated:
        still = trials.run_model_trial(replace(trial.model, pitch_compensated=frozenset()), trial)
        trial = max(trial, still, key=lambda t: t.score)
    found = _drop_useless_modelled_errors(trials, trial)
    known = {} if previous is None else previous.status
    return found.mark_forward_arms_unobservable(
        [i for i, name in known if name == "ahead" and (i, name) not in found.status]
    )


def may_show_sensor_errors(series: Sequence[SensorSeries]) -> bool:
    """Whether a log is long enough for a search of sensor errors; its noise need not be known yet."""
    first, last = _begin_and_end_of_searched_span_s(series)
    return last - first >= MIN_LOG_SPAN_FOR_SLOW_ERRORS_S


def _model_with_all_possible_errors(
    series: Sequence[SensorSeries], known_model: SensorModel, slack_m: Sequence[float]
) -> SensorModel:
    """Return a model with all errors that the sources can have; slow errors begin at the known ones."""
    slow: dict[int, GaussMarkovError] = {}
    follows, scaled, levered, ahead = set(), set(), set(), set()
    has_ground = any(s.kind in (Kind.POSITION, Kind.VELOCITY) and len(s) >= MIN_ROWS_FOR_NOISE for s in series)
    # Of positions alone a slow error can't be told from the way.
    has_motion = any(s.kind in (Kind.ACCEL, Kind.SPEED, Kind.VELOCITY) and len(s) >= MIN_ROWS_FOR_NOISE for s in series)
    has_pitch = find_pitch_rate(series) is not None
    has_turns = _heading_range_rad(series) > MIN_HEADING_RANGE_FOR_LEVER_ARM_RAD
    for i, s in enumerate(series):
        if len(s) < MIN_ROWS_FOR_NOISE or s.is_exact:
            continue
        may_stand = (
            has_turns
            and has_ground
            and s.place_m is None
            and slack_m[i] < MAX_OBSERVED_SIGMA_TO_PRIOR * LEVER_ARM_AHEAD_PRIOR_SIGMA_M
        )
        if may_stand and s.kind in (Kind.POSITION, Kind.VELOCITY, Kind.ACCEL):
            ahead.add(i)
        if s.kind is Kind.ACCEL and s.bias_state >= 0 and has_ground:
            slow[i] = known_model.slow.get(i, INITIAL_GRADE_ERROR)
            if has_pitch:
                follows.add(i)
        elif s.kind is Kind.POSITION and has_motion:
            slow[i] = known_model.slow.get(
                i,
                GaussMarkovError(
                    max(_root_mean_square_noise_sigma(s), QUANTITY_BY_KIND[s.kind].floor_sigma),
                    INITIAL_POSITION_TIME_CONSTANT_S,
                ),
            )
        elif s.kind is Kind.SPEED:
            if has_ground:
                scaled.add(i)
            if has_pitch:
                levered.add(i)
    return SensorModel(slow, frozenset(follows), frozenset(scaled), frozenset(levered), frozenset(ahead))


def _forward_arm_sigma_from_latency_m(
    series: Sequence[SensorSeries], remaining_latency_sigma_s: Sequence[float]
) -> list[float]:
    """Return one sigma (m) of the error of each lever arm ahead that the remaining latency may cause."""
    fixes = max((s for s in series if s.kind is Kind.POSITION), key=len)
    span_s = max(float(np.ptp(fixes.time_s)), FIX_INTERVAL_FOR_SPEED_S)
    few = fixes.values[:: max(1, int(FIX_INTERVAL_FOR_SPEED_S * len(fixes) / span_s))]
    speed_mps = float(np.hypot(*np.diff(few, axis=0).T).sum() / span_s)
    return [
        speed_mps * each if s.kind in (Kind.POSITION, Kind.VELOCITY) else 0.0
        for s, each in zip(series, remaining_latency_sigma_s, strict=True)
    ]


def _heading_range_rad(series: Sequence[SensorSeries]) -> float:
    """Return the range (rad) of the car's heading, by gyroscopes and headings."""
    turned = 0.0
    for s in series:
        if len(s) < MIN_ROWS_FOR_NOISE:
            continue
        if s.kind is Kind.YAW_RATE:
            turned = max(turned, float(np.ptp(np.cumsum(s.values[1:, 0] * np.diff(s.time_s)))))
        elif s.kind is Kind.HEADING:
            turned = max(turned, float(np.ptp(np.unwrap(s.values[:, 0]))))
    return turned


def _root_mean_square_noise_sigma(s: SensorSeries) -> float:
    variance = s.noise[:, 0] if s.n_values_per_row == 1 else 0.5 * (s.noise[:, 0] + s.noise[:, 2])
    return float(np.sqrt(variance.mean()))


@dataclass(frozen=True)
class _SensorModelTrial:
    """Trial of a sensor model with its score.

    Attributes:
        model: The model.
        score: See `bounded_log_likelihood_without_inertial_sensors`.
        factors: On the noise of each series, so that its innovations are as large as they should be.
        state, sigma: Each state and its sigma at the end, by its index.
        layout: Where these states are.
    """

    model: SensorModel
    score: float
    factors: tuple[float, ...]
    state: FloatArray
    sigma: FloatArray
    layout: StateLayout


class _SensorModelTrials:
    """Passes over the same rows with different sensor models."""

    def __init__(self, base: StateLayout, slack_m: Sequence[float]) -> None:
        """Cut and average the searched window, and drop the rows that the filter rejects without a sensor model."""
        begin, end = _begin_and_end_of_searched_span_s(base.series)
        cut = [
            with_outlier_gate(average_rows_to_rate(cut_to_window(s, begin, end), SEARCH_AVERAGING_HZ))
            for s in base.series
        ]
        self.span_s, self.slack_m = end - begin, slack_m
        self.base = replace(
            base, series=cut, parameters=replace(base.parameters, side_slip_m=SEARCH_POSITION_NOISE_M_PER_ROOT_S)
        )
        self._trials = FilterTrials()
        self._scored: dict[Hashable, _SensorModelTrial] = {}
        result = self._trials.run_filter(self.base)
        # A spike of an inertial sensor spoils a row or two; a manoeuvre that looks like one must stay.
        trials = [
            replace(
                s.select_rows((status >= UpdateStatus.USED) | (s.kind in KINDS_THAT_IMU_MEASURES_TOO)), gate_nis=0.0
            )
            for s, status in zip(cut, result.status, strict=True)
        ]
        self.base = replace(self.base, series=trials)

    def run_model_trial(self, model: SensorModel, similar: _SensorModelTrial | None = None) -> _SensorModelTrial:
        """Run the filter until the noise agrees with the innovations; a trial that was made before is returned.

        Args:
            similar: A trial whose noise is a good first guess.
        """
        key = model.lookup_key, None if similar is None else similar.factors
        if key not in self._scored:
            self._scored[key] = self._run_until_noise_settles(model, similar)
        return self._scored[key]

    def _run_until_noise_settles(self, model: SensorModel, similar: _SensorModelTrial | None) -> _SensorModelTrial:
        layout = add_sensor_error_states(self.base, model)
        series = layout.series
        factors = np.ones(len(series)) if similar is None else np.array(similar.factors)
        is_position, before = np.array([s.kind is Kind.POSITION for s in series]), np.ones(len(series))
        for _ in range(MAX_NOISE_MATCHINGS):
            scaled = [s.scale_noise_variance(float(f)) for s, f in zip(series, factors, strict=True)]
            result = self._trials.run_filter(replace(layout, series=scaled))
            change = np.array([noise_variance_factor(s, nis) for s, nis in zip(scaled, result.nis, strict=True)])
            if (np.abs(np.log(change)) < np.log(MAX_NOISE_FACTOR_AT_CONVERGENCE)).all():
                break
            # White noise of fixes takes turns with their slow errors: what turns back goes half the way, and settles.
            has_turned_back = is_position & ((change - 1.0) * (before - 1.0) < 0.0)
            factors, before = factors * np.where(has_turned_back, np.sqrt(change), change), change
        score = bounded_log_likelihood_without_inertial_sensors(scaled, result)
        sigma = np.sqrt(np.maximum(np.diagonal(result.last_covariance), 0.0))
        return _SensorModelTrial(model, score, tuple(factors.tolist()), result.last_state, sigma, layout)

    def climb_to_likeliest_slow_error(self, trial: _SensorModelTrial, i: int) -> _SensorModelTrial:
        """Move sigma and time constant of one slow error to where the log is predicted best.

        What rows close to each other show is sigma^2 / time constant alone. It comes first: too large a one is made
        up for by a time constant that is too short. Along it the likelihood is flat, so its mean is taken, not its top,
        which would as often be far too sure as too careful.
        """
        left = MAX_TRIALS_PER_SLOW_ERROR_SEARCH
        for more, longer in SEARCH_STEP_FACTORS_ON_VARIANCE_AND_TIME_CONSTANT:
            for wider, long in ((more**-0.5, 1.0 / longer), (more**0.5, longer)):
                while (slow := self._scaled_slow_error_or_none(i, trial.model.slow[i], wider, long)) and left > 0:
                    left -= 1
                    other = self.run_model_trial(replace(trial.model, slow={**trial.model.slow, i: slow}), trial)
                    if not other.score > trial.score:
                        break
                    trial = other
        return self._average_slow_error_by_likelihood(trial, i)

    def _average_slow_error_by_likelihood(self, trial: _SensorModelTrial, i: int) -> _SensorModelTrial:
        """Average sigma^2, weighted by likelihood, along constant sigma^2 / time constant."""
        top = trial.model.slow[i]
        slows = [
            self._scaled_slow_error_or_none(i, top, factor**0.5, factor)
            for factor in TIME_CONSTANT_FACTORS_TO_AVERAGE_SLOW_ERROR_OVER
        ]
        known = [top, *(slow for slow in slows if slow is not None)]
        models = [replace(trial.model, slow={**trial.model.slow, i: slow}) for slow in known]
        score = np.array([trial.score, *(self.run_model_trial(model, trial).score for model in models[1:])])
        weight = np.exp(score - score.max())
        longer = float(weight @ [slow.time_s / top.time_s for slow in known] / weight.sum())
        said = self.base.series[i]
        if said.noise_origin == "message":  # of the whole error: what the innovations show is a part of it
            longer = max(longer, (_root_mean_square_noise_sigma(said) / top.sigma) ** 2)
        mean = GaussMarkovError(top.sigma * longer**0.5, top.time_s * longer)
        return self.run_model_trial(replace(trial.model, slow={**trial.model.slow, i: mean}), trial)

    def _scaled_slow_error_or_none(
        self, i: int, slow: GaussMarkovError, wider: float, longer: float
    ) -> GaussMarkovError | None:
        """Return a slow error scaled by two factors; None where its time constant leaves its limits."""
        shortest, longest = SLOW_ERROR_TIME_CONSTANT_LIMITS_S[self.base.series[i].kind]
        scaled_error = GaussMarkovError(slow.sigma * wider, slow.time_s * longer)
        return (
            scaled_error
            if shortest <= scaled_error.time_s <= min(longest, self.span_s / MIN_TIME_CONSTANTS_IN_LOG)
            else None
        )


def keep_sensor_model_if_better(found: FoundSensorModel, plain: StateLayout, modelled: StateLayout) -> FoundSensorModel:
    """Keep the found model if it predicts the whole log, with outliers, better than none; else return an empty one."""
    scores = []
    for layout in (plain, modelled):
        series = [with_outlier_gate(average_rows_to_rate(s, SEARCH_AVERAGING_HZ)) for s in layout.series]
        start = find_full_filter_start(series, layout.prior, causal=False)
        motion = replace(layout.parameters, side_slip_m=SEARCH_POSITION_NOISE_M_PER_ROOT_S).to_process_model(
            layout.walk
        )
        scores.append(
            bounded_log_likelihood_without_inertial_sensors(
                series, run_filter_pass(series, start, motion, np.zeros(0), smooth=False, reset_after=20)
            )
        )
    if scores[1] > scores[0]:
        return found
    status = {
        part: ParameterStatus.NOT_BETTER if part in found.model.modelled_errors else was
        for part, was in found.status.items()
    }
    return FoundSensorModel(SensorModel(), status, beyond=found.beyond)


def _drop_useless_modelled_errors(trials: _SensorModelTrials, trial: _SensorModelTrial) -> FoundSensorModel:
    """Drop errors without which the log is predicted as well, one after the other, the least useful first."""
    status = {part: _observability_of_error(trial, part) for part in trial.model.modelled_errors}
    for part, verdict in status.items():
        if verdict is ParameterStatus.NOT_OBSERVABLE:
            trial = trials.run_model_trial(trial.model.without_error_of_sensor(part), trial)
    while parts := trial.model.modelled_errors:
        others = [trials.run_model_trial(trial.model.without_error_of_sensor(part), trial) for part in parts]
        loss = [
            trial.score - other.score - MIN_LIKELIHOOD_GAIN_PER_PARAMETER * N_FITTED_PARAMETERS_BY_ERROR[part[1]]
            for part, other in zip(parts, others, strict=True)
        ]
        least = int(np.argmin(loss))
        if loss[least] > 0.0:
            unclear = [
                parts.index((i, "ahead"))
                for i in _series_with_unclear_forward_arm(_forward_arm_and_sigma_by_series_m(trial), trials.slack_m)
            ]
            if not unclear:
                break
            least = unclear[0]
        status[parts[least]], trial = ParameterStatus.NOT_BETTER, others[least]
    trial, beyond = _drop_errors_beyond_limits_and_list_them(trials, trial)
    status.update(dict.fromkeys(beyond, ParameterStatus.CONTRADICTS))
    return FoundSensorModel(trial.model, status, _forward_arm_and_sigma_by_series_m(trial), beyond)


def _drop_errors_beyond_limits_and_list_them(
    trials: _SensorModelTrials, trial: _SensorModelTrial
) -> tuple[_SensorModelTrial, dict[SeriesIndexAndErrorName, float]]:
    """Leave out every error that is beyond what such a sensor can have, until none is; returns what they were."""
    beyond: dict[SeriesIndexAndErrorName, float] = {}
    while found := {
        part: value
        for part in trial.model.modelled_errors
        if not range_of_sensor_error(part[1], trial.layout.series[part[0]].kind).contains_or_is_nan(
            value := _reported_value_or_sigma_of_error(trial, part)
        )
    }:
        beyond.update(found)
        model = trial.model
        for part in found:
            model = model.without_error_of_sensor(part)
        trial = trials.run_model_trial(model, trial)
    return trial, beyond


def _reported_value_or_sigma_of_error(trial: _SensorModelTrial, error: SeriesIndexAndErrorName) -> float:
    """Of a slow error its sigma, of another its value, as they are reported."""
    i, name = error
    if name == "slow":
        return trial.model.slow[i].sigma
    s = trial.layout.series[i]
    state = {"scale": s.scale_state, "lever": s.lever_state, "ahead": s.ahead_state}[name]
    return float(trial.state[state]) + (name == "scale") if state >= 0 else float("nan")


def _observability_of_error(trial: _SensorModelTrial, error: SeriesIndexAndErrorName) -> ParameterStatus:
    """Return whether the log narrowed the prior of an error's parameter: USED or NOT_OBSERVABLE."""
    i, name = error
    s = trial.layout.series[i]
    state = {"scale": s.scale_state, "lever": s.lever_state, "ahead": s.ahead_state}.get(name, -1)
    if name == "slow":
        return ParameterStatus.USED
    if state < 0 or trial.sigma[state] > MAX_OBSERVED_SIGMA_TO_PRIOR * trial.layout.prior[state] ** 0.5:
        return ParameterStatus.NOT_OBSERVABLE
    return ParameterStatus.USED


def _forward_arm_and_sigma_by_series_m(trial: _SensorModelTrial) -> dict[int, tuple[float, float]]:
    states = {i: trial.layout.series[i].ahead_state for i in sorted(trial.model.ahead)}
    return {i: (float(trial.state[k]), float(trial.sigma[k])) for i, k in states.items()}


def _series_with_unclear_forward_arm(ahead_m: Mapping[int, tuple[float, float]], slack_m: Sequence[float]) -> list[int]:
    """Return the series whose lever arm ahead is not significant against its sigma and that of the latency."""
    return [
        i
        for i, (value, sigma) in ahead_m.items()
        if not abs(value) > MIN_LEVER_ARM_AHEAD_SIGMAS * np.hypot(sigma, slack_m[i])
    ]


def series_whose_forward_arm_may_be_latency(
    found_model: FoundSensorModel, series: Sequence[SensorSeries], remaining_latency_sigma_s: Sequence[float]
) -> list[int]:
    """Return the series whose lever arm ahead may as well be a latency.

    `remaining_latency_sigma_s` is that of `find_sensor_errors`.
    """
    return _series_with_unclear_forward_arm(
        {i: at for i, at in found_model.ahead_m.items() if i in found_model.model.ahead},
        _forward_arm_sigma_from_latency_m(series, remaining_latency_sigma_s),
    )


def _begin_and_end_of_searched_span_s(series: Sequence[SensorSeries]) -> tuple[float, float]:
    """Return the searched span, s: from the first position; at most `MAX_SEARCHED_LOG_SPAN_S` with the longest path."""
    positions = [s for s in series if s.kind is Kind.POSITION and len(s)]
    begin = min((float(s.time_s[0] - s.latency_s) for s in positions), default=0.0) - LEAD_IN_BEFORE_FIRST_POSITION_S
    end = max((float(s.time_s[-1] - s.latency_s) for s in series if len(s)), default=0.0)
    if end - begin <= MAX_SEARCHED_LOG_SPAN_S:
        return begin, end
    begin = longest_driven_window_start_s(series, begin, end, MAX_SEARCHED_LOG_SPAN_S)
    return begin, begin + MAX_SEARCHED_LOG_SPAN_S
