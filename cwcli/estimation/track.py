"""The estimator's front door: measurements in, a track with diagnostics out."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from cwcli.array_memory import bound_array_memory
from cwcli.errors import DataError
from cwcli.estimation.calibrated import bias_note, check_fits, known_alone, known_mountings
from cwcli.estimation.calibration_check import notes_on_worse_prediction
from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.consistency import effective_count
from cwcli.estimation.contradiction import Contradiction
from cwcli.estimation.gaps import restarts_after_gaps
from cwcli.estimation.latency import CORRECTED
from cwcli.estimation.lever_arms import at_antenna, placed
from cwcli.estimation.limit_check import beyond_limits
from cwcli.estimation.measurements import RATES, Kind, Measurements
from cwcli.estimation.median import median
from cwcli.estimation.model import ModelParameters
from cwcli.estimation.noise import MANOEUVRE_SIGMAS
from cwcli.estimation.parameter import Parameter, ParameterStatus, SlowError
from cwcli.estimation.passes import BEFORE_START, N_MOTION, PassResult, Series, Start, old_rows, run_pass
from cwcli.estimation.prepare import PreparedSeries, epoch_ns, prepare, prepare_blind, seconds
from cwcli.estimation.result import Gated, SourceReport, Track
from cwcli.estimation.sensor_model import Part
from cwcli.estimation.sensor_search import FoundModel
from cwcli.estimation.song2016 import estimate_song2016
from cwcli.estimation.source_vote import vote
from cwcli.estimation.start import hold_before_start, start_with_parameters, within_reach
from cwcli.estimation.trust import state_flags
from cwcli.estimation.tune import TunedSeries, tune
from cwcli.kernels.ekf import UpdateStatus
from cwcli.metrics.chi_square import gate_nis, mean_bounds
from cwcli.signals.columns import FloatArray, Int64Array, Strings
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import HEADING, SPEED

MIN_NIS_ROWS = 20
LONG_LEAD_IN_S = 3.0  # without a position
MOST_STARTS = 6
STARTS_AGREE_M = 0.5
IS_WORKER = "_CWCLI_WORKER"
"""Environment variable that is there in a worker of a run over many logs: the other processors are other workers'."""
Group = TypeVar("Group")
Result = TypeVar("Result")


def estimate_track(
    measurements: Sequence[Measurements],
    config: EstimatorConfig,
    output_stamp_ns: Int64Array | None = None,
) -> Track:
    """Estimate one vehicle's track.

    Args:
        measurements: Any mix of sources and kinds; at least one POSITION.
        config: Settings.
        output_stamp_ns: Shape (m,), increasing: where the state is wanted. None: a grid of `config.rate_hz` over
            the span of the measurements.

    Returns:
        The track at the output stamps.

    Raises:
        DataError: If no position is finite.
    """
    if config.model == "song2016":
        return estimate_song2016(measurements, config, output_stamp_ns)
    if output_stamp_ns is None:
        output_stamp_ns = _grid(measurements, config.rate_hz)
    return _tracked(_settled(measurements, config), config, output_stamp_ns)


def estimate_both(
    measurements: Sequence[Measurements],
    config: EstimatorConfig,
    output_stamp_ns: Int64Array,
    *,
    blind: bool,
    in_time: tuple[Sequence[Measurements], Int64Array] | None = None,
) -> tuple[Track, Track]:
    """What really happened, and what the vehicle could have known: the tracks in hindsight and online.

    The online one is of the filter alone. Where its parameters are those of the log they are looked for once for both.

    Args:
        measurements, config, output_stamp_ns: See `estimate_track`; with `config.causal` the first track is that of the
            filter, too.
        blind: The online track takes no parameter from the log, see `EstimatorConfig`.
        in_time: Measurements and output stamps of the online track, where those are fewer.

    Raises:
        DataError: If no position is finite.
    """
    online = replace(config, causal=True, blind=blind)
    hindsight = online if config.causal else config
    if in_time is None and not blind and config.model == "cwcli":
        settled = _settled(measurements, hindsight)
        track = _tracked(settled, online, output_stamp_ns)
        return track if config.causal else _tracked(settled, hindsight, output_stamp_ns), track
    known, known_stamp_ns = in_time or (measurements, output_stamp_ns)
    track = estimate_track(known, online, known_stamp_ns)
    if config.causal and in_time is None:
        track = _with_notes_on_calibration(track, measurements, online)
        return track, track
    found = estimate_track(measurements, hindsight, output_stamp_ns)
    return _with_notes_on_calibration(found, measurements, hindsight), track


def _with_notes_on_calibration(track: Track, measurements: Sequence[Measurements], config: EstimatorConfig) -> Track:
    """The track, with a note where its calibration predicts the log worse than what the log says of itself."""
    if config.calibration is None:
        return track
    return replace(track, notes=(*track.notes, *notes_on_worse_prediction(measurements, config)))


@dataclass(frozen=True)
class _Settled:
    """Measurements ready for the passes: the stamp of second 0, the series before and after tuning, notes.

    `contradictions` are those that the sources show before anything is estimated.
    """

    epoch_ns: int
    prepared: list[PreparedSeries]
    tuned: TunedSeries
    notes: tuple[str, ...]
    contradictions: tuple[Contradiction, ...] = ()


def _settled(measurements: Sequence[Measurements], config: EstimatorConfig) -> _Settled:
    """Clean the measurements, and find what the log shows of the sensors.

    Raises:
        DataError: If no position is finite.
    """
    if not any(m.kind is Kind.POSITION and np.isfinite(m.values).all(axis=1).any() for m in measurements):
        raise DataError("no finite position among the measurements")
    positions = [m for m in measurements if m.kind is Kind.POSITION]
    epoch = epoch_ns(positions if config.blind else measurements)  # a row that comes later may be of an earlier time
    prepared, notes = _prepared(measurements, epoch, config)
    prepared = placed(prepared, config.lever_arms)
    contradictions: tuple[Contradiction, ...] = ()
    if config.compares_sources:
        voted = vote(prepared)
        contradictions = voted.contradictions
        if config.blind or (config.causal and config.calibration is not None):
            # No state may depend on what the whole log shows: it is told, and nothing is left out.
            contradictions = tuple(each.without() for each in contradictions)
        else:
            prepared = voted.prepared
        notes = [*(f"{each.sentence}; {each.consequence}" for each in contradictions), *notes]
    return _Settled(epoch, prepared, tune(prepared, config, ModelParameters()), tuple(notes), contradictions)


def _tracked(settled: _Settled, config: EstimatorConfig, output_stamp_ns: Int64Array) -> Track:
    """Start, filter and smooth; the arguments as of `estimate_track`."""
    prepared, tuned, notes = settled.prepared, settled.tuned, list(settled.notes)
    output_s = seconds(output_stamp_ns, settled.epoch_ns)
    start = start_with_parameters(tuned.series, tuned.prior, causal=config.causal)
    start.state[N_MOTION:] = tuned.mean[N_MOTION:]
    start = within_reach(start, tuned.series, output_s)
    if not config.causal:
        start = _start_again(tuned, start, config.reset_after)
    restarts = restarts_after_gaps(tuned.series, causal=config.causal)
    result = run_pass(
        tuned.series, start, tuned.motion, output_s,
        smooth=not config.causal, reset_after=config.reset_after,
        restarts=restarts,
    )  # fmt: skip
    if config.causal:
        hold_before_start(
            result.state, result.covariance, tuned.series, start_s=start.time_s, output_s=output_s, prior=tuned.prior
        )
        notes += old_rows(tuned.series, result)
    reports = tuple(_report(p, tuned, i, result) for i, p in enumerate(prepared))
    notes += tuned.notes
    if config.calibration is not None:
        for s, report in zip(tuned.series, reports, strict=True):
            notes += bias_note(s, report.bias, report.bias_sigma, config.calibration)
    for r in reports:
        if r.n_resets and r.kind not in RATES:
            often = "once" if r.n_resets == 1 else f"{r.n_resets} times"
            notes.append(f"{r.source}: {r.kind.name.lower()} believed again after rejections, {often}")
    state, covariance = at_antenna(tuned.series, result.state, result.covariance)
    return Track(
        output_stamp_ns,
        state,
        covariance + _of_latency(state, tuned),
        state_flags(tuned.series, result.status, output_s, start=start, restarts=restarts, causal=config.causal),
        reports,
        result.log_likelihood,
        tuple(notes),
        {name: getattr(tuned.parameters, name) for name in MANOEUVRE_SIGMAS},
        _gated(tuned, result, settled.epoch_ns, config.gate_probability),
        (*settled.contradictions, *([] if config.blind else beyond_limits(reports, settled.contradictions))),
    )


def _gated(tuned: TunedSeries, result: PassResult, epoch: int, probability: float) -> Gated:
    """The rows that the gate rejected, of all series."""
    rows = [np.flatnonzero(status == UpdateStatus.GATED) for status in result.status]
    counts = [len(own) for own in rows]
    time_s = np.concatenate([s.time_s[own] for s, own in zip(tuned.series, rows, strict=True)])
    nis = np.concatenate([found[own, 0] for found, own in zip(result.nis, rows, strict=True)])
    code = np.repeat(np.arange(len(rows), dtype=np.int32), counts)
    bound = np.array([gate_nis(probability, s.width) for s in tuned.series])[code]
    order = np.argsort(time_s, kind="stable")
    return Gated(
        epoch + np.rint(time_s[order] * NS_PER_S).astype(np.int64),
        Strings(code[order], tuple(s.source for s in tuned.series)).merge_equal(),
        Strings(code[order], tuple(s.kind.name.lower() for s in tuned.series)).merge_equal(),
        nis[order],
        bound[order],
    )


def _of_latency(state: FloatArray, tuned: TunedSeries) -> FloatArray:
    """What the positions' latency adds to the covariance, (m, 8, 8): v v' sigma^2 where x and y are.

    A fix at p(t) that is stamped t + tau, corrected by tau + e, is taken for p at t - e: it lies v e ahead. All fixes
    of a source have the same e, so no filter averages it out, and the positions of the states lie v e ahead like
    them. Of several sources the one that is known best counts.
    """
    sigma_s = min(
        (
            latency.sigma_s if latency.status in CORRECTED and latency.sigma_s > 0.0 else 0.0
            for s, latency in zip(tuned.series, tuned.latencies, strict=True)
            if s.kind is Kind.POSITION and len(s)
        ),
        default=0.0,
    )
    velocity = state[:, SPEED, None] * np.column_stack([np.cos(state[:, HEADING]), np.sin(state[:, HEADING])])
    grown = np.zeros((len(state), N_MOTION, N_MOTION))
    grown[:, :2, :2] = sigma_s**2 * velocity[:, :, None] * velocity[:, None, :]
    return grown


def _prepared(
    measurements: Sequence[Measurements], epoch: int, config: EstimatorConfig
) -> tuple[list[PreparedSeries], list[str]]:
    """The series and notes, as far as the calibration goes and nothing may be looked ahead."""
    calibration = config.calibration
    if calibration is None:
        return (prepare_blind(measurements, epoch, {}), []) if config.blind else prepare(measurements, epoch)
    unknown = check_fits(calibration, measurements, causal=config.causal and not config.blind)
    mountings = known_mountings(calibration)
    if config.causal:
        return known_alone(prepare_blind(measurements, epoch, mountings), calibration), unknown
    prepared, notes = prepare(measurements, epoch, mountings)
    return prepared, [*unknown, *notes]


def _start_again(tuned: TunedSeries, start: Start, reset_after: int) -> Start:
    """Where no position comes for long after the start, begin about what the smoother finds there.

    Until the first position the state hardly has a place, a speed or a heading, and the filter's expansion about a
    guess that is far off makes it sure of what is wrong. The covariance stays that of the guess.
    """
    first_s = min(float(s.time_s[0] - s.latency_s) for s in tuned.series if s.kind is Kind.POSITION and len(s))
    if first_s - start.time_s < LONG_LEAD_IN_S:
        return start
    here = np.array([start.time_s])
    for _ in range(MOST_STARTS):
        found = run_pass(tuned.series, start, tuned.motion, here, smooth=True, reset_after=reset_after)
        state = found.state[0]
        if not np.isfinite(state).all():
            break
        moved_m = float(np.hypot(*(state[:2] - start.state[:2])))
        start = replace(start, state=state)
        if moved_m < STARTS_AGREE_M:
            break
    return start


def _grid(measurements: Sequence[Measurements], rate_hz: float) -> Int64Array:
    """Return stamps at `rate_hz` over the span of the measurements."""
    first = epoch_ns(measurements)
    last = max(int(m.stamp_ns.max()) for m in measurements if len(m))
    step = round(NS_PER_S / rate_hz)
    return np.arange(first, last + 1, step, dtype=np.int64)


def _report(p: PreparedSeries, tuned: TunedSeries, i: int, result: PassResult) -> SourceReport:
    """Sum up one series."""
    s, latency = tuned.series[i], tuned.latencies[i]
    nis, status = result.nis[i][:, 0], result.status[i]
    mean, bounds, inside = float("nan"), (float("nan"), float("nan")), None
    if int((status != BEFORE_START).sum()) >= MIN_NIS_ROWS:
        kept = (
            nis[status >= UpdateStatus.USED]
            if (status >= UpdateStatus.USED).any()
            else nis[status == UpdateStatus.GATED]
        )
        mean = float(kept.mean())
        bounds = mean_bounds(s.width, effective_count(kept))
        inside = bounds[0] <= mean <= bounds[1]
    bias, bias_sigma = float("nan"), float("nan")
    if s.bias_state >= 0 and len(result.state):
        middle = len(result.state) // 2
        bias = float(result.state[middle, s.bias_state])
        bias_sigma = float(np.sqrt(max(result.covariance[middle, s.bias_state, s.bias_state], 0.0)))
    found, slow = tuned.sensors, tuned.sensors.model.slow.get(i)
    variance = s.noise[:, 0] if s.width == 1 else 0.5 * (s.noise[:, 0] + s.noise[:, 2])
    return SourceReport(
        source=s.source,
        kind=s.kind,
        n_read=p.n_read,
        n_used=int((status >= UpdateStatus.USED).sum()),
        n_gated=int((status == UpdateStatus.GATED).sum()),
        n_not_finite=p.n_not_finite,
        n_interpolated=p.n_interpolated,
        n_held_back=p.n_held_back,
        n_resets=int((status == UpdateStatus.USED_AFTER_RESET).sum()),
        nis_mean=mean,
        nis_dof=s.width,
        nis_bounds=bounds,
        nis_inside=inside,
        sigma=float(np.sqrt(variance.mean())) if len(s) else float("nan"),
        noise_origin=s.noise_origin,
        noise_scale=_noise_scale(p.series, s),
        stamp_error=s.stamp_error,
        interval_s=median(np.diff(s.time_s)) if len(s) > 1 else float("nan"),
        latency=latency,
        compared=tuned.compared[i],
        mounting=p.mounting,
        bias=bias,
        bias_sigma=bias_sigma,
        scale=_parameter(found, (i, "scale"), s.scale_state, result, 1.0),
        lever_arm_m=_parameter(found, (i, "lever"), s.lever_state, result, 0.0),
        ahead_m=_parameter(found, (i, "ahead"), s.ahead_state, result, 0.0),
        slow_error=SlowError(
            found.beyond.get((i, "slow"), float("nan")) if slow is None else slow.sigma,
            float("nan") if slow is None else slow.time_s,
            found.status.get((i, "slow"), ParameterStatus.OFF),
        ),
        follows_pitch_rate=i in found.model.follows,
    )


def _noise_scale(stated: Series, used: Series) -> float:
    if not stated.noise_origin.startswith("message") or not len(used):
        return float("nan")
    return float(used.noise[:, 0].mean() / stated.noise[:, 0].mean())


def _parameter(found: FoundModel, part: Part, state: int, result: PassResult, offset: float) -> Parameter:
    """A constant of a source, as it is at the end; `offset` is what its state 0 stands for."""
    status = found.status.get(part, ParameterStatus.OFF)
    if state < 0:
        return Parameter(found.beyond.get(part, float("nan")), status=status)
    sigma = float(np.sqrt(max(result.last_covariance[state, state], 0.0)))
    return Parameter(offset + float(result.last_state[state]), sigma, status)


def estimate_tracks(
    groups: Sequence[tuple[Sequence[Measurements], Int64Array | None]],
    config: EstimatorConfig,
) -> list[Track]:
    """Estimate many vehicles' tracks, in threads: `estimate_track` for each (measurements, output stamps)."""
    return each_in_threads(lambda group: estimate_track(group[0], config, group[1]), groups)


def each_in_threads(estimate: Callable[[Group], Result], groups: Sequence[Group]) -> list[Result]:
    """`estimate` of each vehicle, in threads; a worker process uses one, as the other processors are other workers'."""
    if len(groups) < 2 or IS_WORKER in os.environ:
        return [estimate(group) for group in groups]
    n_threads = min(len(groups), os.cpu_count() or 1)
    with ThreadPoolExecutor(n_threads, initializer=bound_array_memory) as pool:
        return list(pool.map(estimate, groups))
