"""Which errors of the sensors a log shows: each is used only where the log is predicted better with it.

The score is the filter's log-likelihood: each row is predicted from the rows before it alone. The states' priors are in
it (it is a marginal likelihood), so that a scale or a lever arm that nothing shows gains nothing. What is fitted beside
it, sigma and time constant of a slow error, has to gain more.

All errors are put in together, because one's absence looks like another; sigma and time constant of the slow ones go
where the likelihood is largest; then each is left out again where the log does without it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cwcli.estimation.measurements import QUANTITIES, RATES, Kind
from cwcli.estimation.noise import LEAD_IN_S, MIN_ROWS_FOR_NOISE, busiest_window, noise_factor
from cwcli.estimation.parameter import ParameterStatus
from cwcli.estimation.passes import PassResult, Series, TimeOrder, run_pass
from cwcli.estimation.prepare import thinned_to
from cwcli.estimation.score import GAIN, GATE_PROBABILITY, prediction_score
from cwcli.estimation.sensor_limits import limit_of_error
from cwcli.estimation.sensor_model import AHEAD_PRIOR_M, Layout, Part, SensorModel, Slow, lay_out, pitch_rate_of
from cwcli.estimation.start import start_with_parameters
from cwcli.kernels.ekf import UpdateStatus
from cwcli.metrics.chi_square import gate_nis
from cwcli.signals.columns import FloatArray

MIN_SPAN_S = 60.0  # a slow error has to come and go a few times
WINDOW_S = 240.0
THINNED_HZ = 10.0
N_FITTED = {"slow": 2, "scale": 1, "lever": 1, "ahead": 1}
GRADE = Slow(0.2, 15.0)  # m/s^2, 1.2 degrees; a hill of a few hundred metres at town speed
POSITION_TIME_S = 10.0  # where the climb begins
TIME_LIMITS_S = {Kind.POSITION: (1.0, 300.0), Kind.ACCEL: (5.0, 300.0)}  # a slope lasts; a body's pitch does not
SIDE_SLIP_M = (
    0.03  # less than the filter's own, as for latencies: a slow error of the fixes is seen against a long memory
)
MIN_TURNS = 5.0  # time constants in a log
STEPS = (3.0, 3.0**0.5)  # of the time constant, or of sigma^2
RIDGE = (1.0 / 9.0, 1.0 / 3.0, 3.0, 9.0)
MIN_TURN_RAD = 0.5  # in a log without a turn nothing tells where a sensor stands
WAY_S = 2.0  # between two fixes whose distance is a way and not noise
CLEAR_SIGMAS = 3.0
MAX_CLIMB = 9  # trials in the climb of one slow error
SETTLED = 1.1
MAX_MATCHINGS = 3
NARROWED = 0.5  # a parameter whose sigma is more than this part of its prior was not observed


@dataclass(frozen=True)
class FoundModel:
    """What the log shows.

    Attributes:
        model: The sensor model to use.
        status: What was made of each error that was looked for.
        ahead_m: Place ahead and its sigma, of the series that have one.
        beyond: What was found of the errors that lie beyond what such a sensor can have, and are not used.
    """

    model: SensorModel = field(default_factory=SensorModel)
    status: Mapping[Part, ParameterStatus] = field(default_factory=dict)
    ahead_m: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    beyond: Mapping[Part, float] = field(default_factory=dict)

    def without_ahead(self, series: Sequence[int]) -> FoundModel:
        """The same, but where some series stand can't be told."""
        parts: list[Part] = [(i, "ahead") for i in series]
        model = replace(self.model, ahead=self.model.ahead - set(series))
        return replace(
            self, model=model, status={**self.status, **dict.fromkeys(parts, ParameterStatus.NOT_OBSERVABLE)}
        )


def find_sensor_model(
    base: Layout, before: FoundModel | None = None, left_s: Sequence[float] | None = None
) -> FoundModel:
    """Find which errors the log shows, and sigma and time constant of the slow ones.

    Args:
        base: Series with latencies and noise settled, and their biases as the only parameter states.
        before: What was found with other latencies: the climb begins there, and what was of no use is tried again.
        left_s: Parallel to the series: one sigma of what the stamps are still late by; None: nothing. A car that turns
            while its fixes are late by tau looks like one whose antenna stands by v tau behind.
    """
    first, last = _window(base.series)
    slack_m = _slack_m(base.series, [0.0] * len(base.series) if left_s is None else left_s)
    whole = _whole_model(base.series, SensorModel() if before is None else before.model, slack_m)
    if last - first < MIN_SPAN_S or not whole.parts:
        return FoundModel()
    trials = _Trials(base, slack_m)
    trial = trials.try_model(whole)
    for i in whole.slow:
        trial = trials.climbed(trial, i)
    if whole.follows:
        still = trials.try_model(replace(trial.model, follows=frozenset()), trial)
        trial = max(trial, still, key=lambda t: t.score)
    found = _reduced(trials, trial)
    known = {} if before is None else before.status
    return found.without_ahead([i for i, name in known if name == "ahead" and (i, name) not in found.status])


def _whole_model(series: Sequence[Series], known: SensorModel, slack_m: Sequence[float]) -> SensorModel:
    """All errors that the sources can have; the slow ones as far as known."""
    slow: dict[int, Slow] = {}
    follows, scaled, levered, ahead = set(), set(), set(), set()
    has_ground = any(s.kind in (Kind.POSITION, Kind.VELOCITY) and len(s) >= MIN_ROWS_FOR_NOISE for s in series)
    # Of positions alone a slow error can't be told from the way.
    has_motion = any(s.kind in (Kind.ACCEL, Kind.SPEED, Kind.VELOCITY) and len(s) >= MIN_ROWS_FOR_NOISE for s in series)
    has_pitch = pitch_rate_of(series) is not None
    has_turns = _turned_rad(series) > MIN_TURN_RAD
    for i, s in enumerate(series):
        if len(s) < MIN_ROWS_FOR_NOISE or s.is_exact:
            continue
        may_stand = has_turns and has_ground and s.place_m is None and slack_m[i] < NARROWED * AHEAD_PRIOR_M
        if may_stand and s.kind in (Kind.POSITION, Kind.VELOCITY, Kind.ACCEL):
            ahead.add(i)
        if s.kind is Kind.ACCEL and s.bias_state >= 0 and has_ground:
            slow[i] = known.slow.get(i, GRADE)
            if has_pitch:
                follows.add(i)
        elif s.kind is Kind.POSITION and has_motion:
            slow[i] = known.slow.get(i, Slow(max(_sigma(s), QUANTITIES[s.kind].floor_sigma), POSITION_TIME_S))
        elif s.kind is Kind.SPEED:
            if has_ground:
                scaled.add(i)
            if has_pitch:
                levered.add(i)
    return SensorModel(slow, frozenset(follows), frozenset(scaled), frozenset(levered), frozenset(ahead))


def _slack_m(series: Sequence[Series], left_s: Sequence[float]) -> list[float]:
    """How far each source's place ahead may seem to be off by what its stamps are late, one sigma."""
    fixes = max((s for s in series if s.kind is Kind.POSITION), key=len)
    span_s = max(float(np.ptp(fixes.time_s)), WAY_S)
    few = fixes.values[:: max(1, int(WAY_S * len(fixes) / span_s))]
    speed_mps = float(np.hypot(*np.diff(few, axis=0).T).sum() / span_s)
    return [
        speed_mps * each if s.kind in (Kind.POSITION, Kind.VELOCITY) else 0.0
        for s, each in zip(series, left_s, strict=True)
    ]


def _turned_rad(series: Sequence[Series]) -> float:
    """How far the car's heading goes from one side to the other, as far as a gyroscope or a heading tells."""
    turned = 0.0
    for s in series:
        if len(s) < MIN_ROWS_FOR_NOISE:
            continue
        if s.kind is Kind.YAW_RATE:
            turned = max(turned, float(np.ptp(np.cumsum(s.values[1:, 0] * np.diff(s.time_s)))))
        elif s.kind is Kind.HEADING:
            turned = max(turned, float(np.ptp(np.unwrap(s.values[:, 0]))))
    return turned


def _sigma(s: Series) -> float:
    variance = s.noise[:, 0] if s.width == 1 else 0.5 * (s.noise[:, 0] + s.noise[:, 2])
    return float(np.sqrt(variance.mean()))


@dataclass(frozen=True)
class _Trial:
    """A model and how well it predicts.

    Attributes:
        model: The model.
        score: See `prediction_score`.
        factors: On the noise of each series, so that its innovations are as large as they should be.
        state, sigma: Each state and its sigma at the end, by its index.
        layout: Where these states are.
    """

    model: SensorModel
    score: float
    factors: tuple[float, ...]
    state: FloatArray
    sigma: FloatArray
    layout: Layout


class _Trials:
    """Passes over the same rows with different sensor models."""

    def __init__(self, base: Layout, slack_m: Sequence[float]) -> None:
        """Cut a window, thin it, and leave out what the filter rejects without a sensor model."""
        begin, end = _window(base.series)
        cut = [
            replace(thinned_to(s.at((s.time_s - s.latency_s >= begin) & (s.time_s - s.latency_s <= end)), THINNED_HZ),
                    gate_nis=gate_nis(GATE_PROBABILITY, s.width))
            for s in base.series
        ]  # fmt: skip
        self.span_s, self.slack_m = end - begin, slack_m
        self.base = replace(base, series=cut, parameters=replace(base.parameters, side_slip_m=SIDE_SLIP_M))
        self._orders: dict[float, TimeOrder] = {}
        result = self._pass(cut, self.base)
        # A spike of an inertial sensor spoils a row or two; a manoeuvre that looks like one must stay.
        kept = [
            replace(s.at((status >= UpdateStatus.USED) | (s.kind in RATES)), gate_nis=0.0)
            for s, status in zip(cut, result.status, strict=True)
        ]
        self.base = replace(self.base, series=kept)
        self._orders.clear()

    def try_model(self, model: SensorModel, near: _Trial | None = None) -> _Trial:
        """Run the filter until the noise agrees with the innovations.

        Args:
            model: The model.
            near: A trial whose noise is a good first guess.
        """
        layout = lay_out(self.base, model)
        series = layout.series
        factors = np.ones(len(series)) if near is None else np.array(near.factors)
        for _ in range(MAX_MATCHINGS):
            scaled = [s.scaled(float(f)) for s, f in zip(series, factors, strict=True)]
            result = self._pass(scaled, layout)
            change = np.array([noise_factor(s, nis) for s, nis in zip(scaled, result.nis, strict=True)])
            if (np.abs(np.log(change)) < np.log(SETTLED)).all():
                break
            factors *= change
        score = prediction_score(scaled, result)
        sigma = np.sqrt(np.maximum(np.diagonal(result.last_covariance), 0.0))
        return _Trial(model, score, tuple(factors.tolist()), result.last_state, sigma, layout)

    def climbed(self, trial: _Trial, i: int) -> _Trial:
        """Move sigma and time constant of one slow error to where the log is predicted best.

        What rows close to each other show is sigma^2 / time constant alone, so one kind of step keeps that. Along it
        the likelihood is flat: its mean is taken, not its top, which would as often be far too sure as too careful.
        """
        left = MAX_CLIMB
        for step in STEPS:
            moved = True
            while moved and left > 0:
                moved = False
                for wider, longer in ((step**0.5, step), (step**-0.5, 1.0 / step), (step**0.5, 1.0), (step**-0.5, 1.0)):
                    slow = self._moved(self.base.series[i].kind, trial.model.slow[i], wider, longer)
                    if slow is None or left <= 0:
                        continue
                    left -= 1
                    other = self.try_model(replace(trial.model, slow={**trial.model.slow, i: slow}), trial)
                    if other.score > trial.score:
                        trial, moved = other, True
                        break
        return self._averaged(trial, i)

    def _averaged(self, trial: _Trial, i: int) -> _Trial:
        """The mean of sigma^2, by likelihood, along the same sigma^2 / time constant: the mean of the covariances."""
        top = trial.model.slow[i]
        slows = [self._moved(self.base.series[i].kind, top, factor**0.5, factor) for factor in RIDGE]
        known = [top, *(slow for slow in slows if slow is not None)]
        models = [replace(trial.model, slow={**trial.model.slow, i: slow}) for slow in known]
        score = np.array([trial.score, *(self.try_model(model, trial).score for model in models[1:])])
        weight = np.exp(score - score.max())
        longer = float(weight @ [slow.time_s / top.time_s for slow in known] / weight.sum())
        said = self.base.series[i]
        if said.noise_origin == "message":  # of the whole error: what the innovations show is a part of it
            longer = max(longer, (_sigma(said) / top.sigma) ** 2)
        mean = Slow(top.sigma * longer**0.5, top.time_s * longer)
        return self.try_model(replace(trial.model, slow={**trial.model.slow, i: mean}), trial)

    def _moved(self, kind: Kind, slow: Slow, wider: float, longer: float) -> Slow | None:
        """Another slow error; None where its time constant is too short or too long for the log."""
        shortest, longest = TIME_LIMITS_S[kind]
        moved = Slow(slow.sigma * wider, slow.time_s * longer)
        return moved if shortest <= moved.time_s <= min(longest, self.span_s / MIN_TURNS) else None

    def _pass(self, series: Sequence[Series], layout: Layout) -> PassResult:
        start = start_with_parameters(series, layout.prior, causal=False)
        motion = layout.parameters.motion(layout.walk)
        return run_pass(series, start, motion, np.zeros(0), smooth=False, reset_after=50, orders=self._orders)


def if_better(found: FoundModel, plain: Layout, modelled: Layout) -> FoundModel:
    """What was found, if it predicts the whole log, outliers and all, better than without; else nothing.

    Args:
        found: The model and what was made of each error.
        plain, modelled: The log without and with it, noise settled.
    """
    scores = []
    for layout in (plain, modelled):
        thin = [thinned_to(s, THINNED_HZ) for s in layout.series]
        series = [replace(s, gate_nis=gate_nis(GATE_PROBABILITY, s.width)) for s in thin]
        start = start_with_parameters(series, layout.prior, causal=False)
        motion = replace(layout.parameters, side_slip_m=SIDE_SLIP_M).motion(layout.walk)
        scores.append(
            prediction_score(series, run_pass(series, start, motion, np.zeros(0), smooth=False, reset_after=20))
        )
    if scores[1] > scores[0]:
        return found
    status = {
        part: ParameterStatus.NOT_BETTER if part in found.model.parts else was for part, was in found.status.items()
    }
    return FoundModel(SensorModel(), status, beyond=found.beyond)


def _reduced(trials: _Trials, trial: _Trial) -> FoundModel:
    """Leave out, one after the other, what the log is predicted as well without; begin with what matters least."""
    status = {part: _observed(trial, part) for part in trial.model.parts}
    for part, verdict in status.items():
        if verdict is ParameterStatus.NOT_OBSERVABLE:
            trial = trials.try_model(trial.model.without(part), trial)
    while parts := trial.model.parts:
        others = [trials.try_model(trial.model.without(part), trial) for part in parts]
        loss = [trial.score - other.score - GAIN * N_FITTED[part[1]] for part, other in zip(parts, others, strict=True)]
        least = int(np.argmin(loss))
        if loss[least] > 0.0:
            unclear = [parts.index((i, "ahead")) for i in _unclear(_ahead_m(trial), trials.slack_m)]
            if not unclear:
                break
            least = unclear[0]
        status[parts[least]], trial = ParameterStatus.NOT_BETTER, others[least]
    trial, beyond = _without_beyond(trials, trial)
    status.update(dict.fromkeys(beyond, ParameterStatus.CONTRADICTS))
    return FoundModel(trial.model, status, _ahead_m(trial), beyond)


def _without_beyond(trials: _Trials, trial: _Trial) -> tuple[_Trial, dict[Part, float]]:
    """Leave out every error that is beyond what such a sensor can have, until none is; returns what they were."""
    beyond: dict[Part, float] = {}
    while found := {
        part: value
        for part in trial.model.parts
        if not limit_of_error(part[1], trial.layout.series[part[0]].kind).holds(value := _value(trial, part))
    }:
        beyond.update(found)
        model = trial.model
        for part in found:
            model = model.without(part)
        trial = trials.try_model(model, trial)
    return trial, beyond


def _value(trial: _Trial, part: Part) -> float:
    """Of a slow error its sigma, of another its value, as they are reported."""
    i, name = part
    if name == "slow":
        return trial.model.slow[i].sigma
    s = trial.layout.series[i]
    state = {"scale": s.scale_state, "lever": s.lever_state, "ahead": s.ahead_state}[name]
    return float(trial.state[state]) + (name == "scale") if state >= 0 else float("nan")


def _observed(trial: _Trial, part: Part) -> ParameterStatus:
    """Has the log narrowed a constant's prior?"""
    i, name = part
    s = trial.layout.series[i]
    state = {"scale": s.scale_state, "lever": s.lever_state, "ahead": s.ahead_state}.get(name, -1)
    if name == "slow":
        return ParameterStatus.USED
    if state < 0 or trial.sigma[state] > NARROWED * trial.layout.prior[state] ** 0.5:
        return ParameterStatus.NOT_OBSERVABLE
    return ParameterStatus.USED


def _ahead_m(trial: _Trial) -> dict[int, tuple[float, float]]:
    states = {i: trial.layout.series[i].ahead_state for i in sorted(trial.model.ahead)}
    return {i: (float(trial.state[k]), float(trial.sigma[k])) for i, k in states.items()}


def _unclear(ahead_m: Mapping[int, tuple[float, float]], slack_m: Sequence[float]) -> list[int]:
    """The series whose place is no more than its own error and what is left of the latencies can make of it."""
    return [i for i, (value, sigma) in ahead_m.items() if not abs(value) > CLEAR_SIGMAS * np.hypot(sigma, slack_m[i])]


def unclear_places(found: FoundModel, series: Sequence[Series], left_s: Sequence[float]) -> list[int]:
    """The series whose place ahead may as well be a latency; for `left_s` see `find_sensor_model`."""
    return _unclear({i: at for i, at in found.ahead_m.items() if i in found.model.ahead}, _slack_m(series, left_s))


def _window(series: Sequence[Series]) -> tuple[float, float]:
    """Where to look: from the first position on; of long logs the WINDOW_S in which the car goes farthest."""
    positions = [s for s in series if s.kind is Kind.POSITION and len(s)]
    begin = min((float(s.time_s[0] - s.latency_s) for s in positions), default=0.0) - LEAD_IN_S
    end = max((float(s.time_s[-1] - s.latency_s) for s in series if len(s)), default=0.0)
    if end - begin <= WINDOW_S:
        return begin, end
    begin = busiest_window(series, begin, end, WINDOW_S)
    return begin, begin + WINDOW_S
