"""The error of stamps: fixes that are stamped when they were received, and were under way for now longer, now shorter.

A fix at p(t) that is stamped t + e lies v e behind, so that errors e with sigma_t add sigma_t^2 v v' to its noise:
along the way alone, the more the faster the car goes, nothing where it stands. White noise acts in all directions at
all speeds, and what the driver does shows in the fixes that follow, so the three part where the car moves. As every
other error it is used only where the log is predicted better.

Most logs have none, so it is looked for only where the innovations along the way are larger, against those across it,
than they should be (a score test).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cwcli.estimation.measurements import Kind
from cwcli.estimation.model import ModelParameters
from cwcli.estimation.parameter import EXACT_STAMPS, Parameter, ParameterStatus
from cwcli.estimation.passes import PassResult, Series
from cwcli.estimation.score import CLEAR_SIGMAS, GAIN, GATE_PROBABILITY, clearly_better, prediction_score, row_scores
from cwcli.estimation.sensor_limits import STAMP_SIGMA
from cwcli.metrics.chi_square import gate_nis
from cwcli.signals.columns import FloatArray

FIRST_S = 0.005
OCTAVE = 4  # steps of the grid, of sigma_t, of the white noise's sigma and of the motion's
LOWEST, HIGHEST = -2 * OCTAVE, 7 * OCTAVE  # of sigma_t: 1.3 ms and 0.64 s
STRIDES = (OCTAVE, OCTAVE // 2)
MOST_TRIALS = 150
TRIED = (0, 2 * OCTAVE)  # 5 and 20 ms: where neither helps nothing is looked for
WHITE_STEP = 2.0  # of the variance
MOST_WHITE_STEPS = 16
MIN_ROWS = 50
WAY_S = 2.0  # between two fixes whose distance is a way and not noise

Point = tuple[int | None, int, int, int]
"""A place on the grid: the stamps' error (None: none), noise with what that adds, jerk and yaw acceleration."""


@dataclass(frozen=True)
class NoiseFit:
    """Series with their noise, and the motion model.

    Attributes:
        series: With their noise.
        factors: What the noise of each was multiplied by so far.
        parameters: The motion model.
    """

    series: tuple[Series, ...]
    factors: tuple[float, ...]
    parameters: ModelParameters


Run = Callable[[Sequence[Series], ModelParameters], PassResult]


def may_err(s: Series, nis: FloatArray) -> bool:
    """Whether a position's innovations look as if its stamps erred: see `ekf.Pass`. An outlier counts as no more."""
    if s.kind is not Kind.POSITION or s.is_exact or len(s) < MIN_ROWS or np.ptp(s.time_s) < 2.0 * WAY_S:
        return False
    limit = gate_nis(GATE_PROBABILITY, s.width)
    slope = nis[:, 4] * limit / np.maximum(nis[:, 0], limit)
    return bool(np.nansum(slope) > CLEAR_SIGMAS * np.sqrt(np.nansum(slope**2)))


def with_stamp_errors(
    fit: NoiseFit, may: Sequence[bool], run: Run, scaled: Callable[[ModelParameters, Sequence[float]], ModelParameters]
) -> NoiseFit:
    """The fit with the error of the stamps of each position that the log is predicted better with.

    With and without it white noise and motion go where the log is predicted best, so that neither is helped by them.

    Args:
        fit: Settled without.
        may: Of each series, see `may_err`.
        run: A pass.
        scaled: The motion model with its jerk and its yaw acceleration times these, within their limits.
    """
    for i in np.flatnonzero(may).tolist():
        fit = _Search(fit, i, run, scaled).found()
    return fit


class _Search:
    """Trials of one position's noise on a grid of logarithms."""

    def __init__(
        self, fit: NoiseFit, i: int, run: Run, scaled: Callable[[ModelParameters, Sequence[float]], ModelParameters]
    ) -> None:
        self._fit, self._i, self._run, self._scaled = fit, i, run, scaled
        s = fit.series[i]
        self._variance = 0.5 * float((s.noise[:, 0] + s.noise[:, 2]).mean())
        few = s.at(np.arange(len(s)) % max(1, int(WAY_S * len(s) / max(float(np.ptp(s.time_s)), WAY_S))) == 0)
        speed_mps = np.hypot(*np.diff(few.values, axis=0).T) / np.maximum(np.diff(few.time_s), 1e-3)
        self._speed2 = float(np.median(speed_mps)) ** 2
        stated = s.noise_origin.startswith("message") and s.slow_state < 0
        # What a message states is raised only, however little it states.
        self._least = 1.0 / fit.factors[i] if stated else s.floor**2 / self._variance
        self._scores: dict[Point, float] = {}

    def found(self) -> NoiseFit:
        """The fit with the error and the noise and motion beside it; the fit itself where nothing shows one."""
        plain = self._climbed((None, 0, 0, 0), (1, 2, 3), STRIDES[:1])
        if not any(self._score((step, *plain[1:])) > self._score(plain) for step in TRIED):
            return self._fit
        plain = self._climbed(plain, (1, 2, 3))
        best = self._climbed((0, *plain[1:]), (0, 1, 2, 3))
        plain = max(plain, self._climbed((None, *best[1:]), (1, 2, 3)), key=self._score)
        gains = self._score(best) > self._score(plain) + GAIN
        if not gains or not clearly_better(self._rows(best) - self._rows(plain), GAIN):
            return self._fit
        return self._known(best)

    def _known(self, best: Point) -> NoiseFit:
        """The fit at the vertex of the parabola through the best and its neighbours, by the logarithm of sigma_t.

        Its bend is the error's own sigma: white noise and motion give way at each of the three.
        """
        stride = STRIDES[-1]
        while True:
            assert best[0] is not None
            at: list[Point] = [(best[0] - stride, *best[1:]), (best[0] + stride, *best[1:])]
            if len(self._scores) >= MOST_TRIALS or not LOWEST <= best[0] - stride < best[0] + stride <= HIGHEST:
                return self._fit  # the top has not been reached: nothing is known
            sides = [self._climbed(side, (1, 2, 3)) for side in at]
            better = max(sides, key=self._score)
            if not self._score(better) > self._score(best):
                break
            best = better
        before, top, after = (self._score(point) for point in (sides[0], best, sides[1]))
        bend = 2.0 * top - before - after
        unit = math.log(2.0) * stride / OCTAVE
        move = 0.5 * (after - before) / bend if bend > 0.0 else 0.0
        value = FIRST_S * 2.0 ** (best[0] / OCTAVE) * math.exp(unit * move)
        sigma = value * unit / math.sqrt(bend) if bend > 0.0 else math.nan
        if not STAMP_SIGMA.holds(value):
            return self._refused()
        return self._with_white(best, Parameter(value, sigma, ParameterStatus.USED))

    def _refused(self) -> NoiseFit:
        """The fit without an error of the stamps, because no link has one as large as what was found."""
        series = list(self._fit.series)
        series[self._i] = replace(series[self._i], stamp_error=Parameter(0.0, status=ParameterStatus.CONTRADICTS))
        return replace(self._fit, series=tuple(series))

    def _with_white(self, best: Point, error: Parameter) -> NoiseFit:
        """The fit with the white noise that the log is predicted best with beside an error of the stamps.

        On the grid it is a difference of the whole and what the stamps add, which is coarse where that is most of it.
        """
        white = self._white(best, error)
        score = self._passed_score(best, error, white)
        for factor in (1.0 / WHITE_STEP, WHITE_STEP):
            for _ in range(MOST_WHITE_STEPS):
                other = max(white * factor, self._least)
                better = self._passed_score(best, error, other) if other != white else -math.inf
                if not better > score:
                    break
                white, score = other, better
        return self._at(best, error, white)

    def _climbed(self, point: Point, axes: Sequence[int], strides: Sequence[int] = STRIDES) -> Point:
        """The best point that is reached along the axes, one after the other."""
        for stride in strides:
            moved = True
            while moved and len(self._scores) < MOST_TRIALS:
                moved = False
                for axis in axes:
                    for step in (stride, -stride):
                        while (other := _moved(point, axis, step)) and self._score(other) > self._score(point):
                            point, moved = other, True
        return point

    def _score(self, point: Point) -> float:
        if point not in self._scores:
            self._scores[point] = prediction_score(*self._passed(point))
        return self._scores[point]

    def _rows(self, point: Point) -> FloatArray:
        series, result = self._passed(point)
        return row_scores(series[self._i], result.nis[self._i])

    def _passed_score(self, point: Point, error: Parameter, white: float) -> float:
        return prediction_score(*self._passed_with(self._at(point, error, white)))

    def _passed(self, point: Point) -> tuple[list[Series], PassResult]:
        error = EXACT_STAMPS if point[0] is None else Parameter(FIRST_S * 2.0 ** (point[0] / OCTAVE))
        return self._passed_with(self._at(point, error, self._white(point, error)))

    def _passed_with(self, fit: NoiseFit) -> tuple[list[Series], PassResult]:
        gated = [replace(s, gate_nis=gate_nis(GATE_PROBABILITY, s.width)) for s in fit.series]
        return gated, self._run(gated, fit.parameters)

    def _white(self, point: Point, error: Parameter) -> float:
        """What the noise is multiplied by at a point."""
        # What the stamps add is taken off, in the mean over the axes: a step of theirs keeps the whole.
        white = 4.0 ** (point[1] / OCTAVE) - 0.5 * error.value**2 * self._speed2 / self._variance
        return max(float(white), self._least)

    def _at(self, point: Point, error: Parameter, white: float) -> NoiseFit:
        series, factors = list(self._fit.series), list(self._fit.factors)
        series[self._i] = replace(series[self._i].scaled(white), stamp_error=error)
        factors[self._i] *= white
        motion = [2.0 ** (step / OCTAVE) for step in point[2:]]
        return NoiseFit(tuple(series), tuple(factors), self._scaled(self._fit.parameters, motion))


def _moved(point: Point, axis: int, step: int) -> Point | None:
    """The point that lies a step away along an axis; None where the stamps would err by too little or too much."""
    here = list(point)
    at = here[axis]
    assert at is not None
    here[axis] = at + step
    if axis == 0 and not LOWEST <= at + step <= HIGHEST:
        return None
    return here[0], *here[1:]  # type: ignore[return-value]
