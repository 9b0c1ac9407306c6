"""Evidence for a latency, with its uncertainty, from each row of a log.

A row's negative log-likelihood, after all rows before it, is known for each latency. Passes with the stamps moved a
little less, just so and a little more give a parabola for each row. The vertex of their sum is the latency, its bend
the information. Their scatter over blocks of the log tells how far that can be believed: on real drives parts of one
log disagree by many of the sigmas that a model of white noise promises.
"""

from __future__ import annotations

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray

SCATTER_BLOCK_LENGTH_S = 10.0
"""Length of the blocks whose scatter gives the sigma, s. Chosen longer than a manoeuvre."""
N_BLOCKS_OF_SHORT_LOG = 8
"""Number of blocks of a short log, which are then shorter. Chosen by hand; not fitted."""
MIN_LOG_LIKELIHOOD_GAIN_OF_DRIFT = 4.5
"""Least gain of log-likelihood of a drift: three sigma."""
MIN_SCATTER_BLOCKS = 3
"""Least number of blocks whose scatter gives a sigma. Chosen: two have only one degree of freedom."""
MIN_EFFECTIVE_BLOCKS_FOR_SIGMA = 2.0
"""Least effective number of blocks for a sigma by scatter. Chosen by hand; not fitted."""
FEW_BLOCKS_SIGMA_FACTOR = 3.0
"""Least ratio of the sigma to the formal one with fewer effective blocks. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class LatencyEvidence:
    """The negative log-likelihood of each of k rows as a parabola in the latency tau:

    level + slope (tau - centre) + bend (tau - centre)^2 / 2.

    Attributes:
        time_s: Shape (k,), increasing: when the rows were measured, corrected by the centre.
        centre_s: Latency about which the parabolas are.
        level, slope, bend: Shape (k,), 1, 1/s and 1/s^2.
    """

    time_s: FloatArray
    centre_s: float
    level: FloatArray
    slope: FloatArray
    bend: FloatArray

    @classmethod
    def from_three_passes(
        cls,
        time_s: FloatArray,
        centre_s: float,
        probe_s: float,
        nll_at_earlier: FloatArray,
        nll_at_centre: FloatArray,
        nll_at_later: FloatArray,
    ) -> LatencyEvidence:
        """Lay the parabolas through three passes; rows that are not finite in one of them are left out.

        Args:
            time_s, centre_s: See `LatencyEvidence`, in any order.
            probe_s: How much less and more the stamps were moved.
            nll_at_earlier, nll_at_centre, nll_at_later: Shape (k,): negative log-likelihoods with the latencies centre
                - probe, centre and centre + probe.
        """
        slope, bend = (
            (nll_at_later - nll_at_earlier) / (2.0 * probe_s),
            (nll_at_later - 2.0 * nll_at_centre + nll_at_earlier) / probe_s**2,
        )
        order = np.argsort(time_s, kind="stable")
        order = order[np.isfinite(bend[order])]
        return cls(time_s[order], centre_s, nll_at_centre[order], slope[order], bend[order])

    @property
    def likeliest_latency_s(self) -> float:
        """The vertex of the sum; NaN where it has none."""
        return _parabola_vertex_s(self.centre_s, float(self.slope.sum()), float(self.bend.sum()))

    @property
    def formal_sigma_s(self) -> float:
        """One sigma by the bend alone: true where the model is; infinity where the sum has no vertex."""
        information = float(self.bend.sum())
        return information**-0.5 if information > 0.0 else float("inf")

    @property
    def block_scatter_sigma_s(self) -> float:
        """A quarter of the 95 % interval, by the scatter of the slopes at the vertex over blocks.

        The largest one of the scatters over blocks of `SCATTER_BLOCK_LENGTH_S` (of short logs:
        `N_BLOCKS_OF_SHORT_LOG`), over blocks twice as long, because errors that last for longer than a block err alike
        in neighbours, and, where these are still shorter than that, over as few as `MIN_SCATTER_BLOCKS`. Never less
        than `formal_sigma_s`: a small scatter of a few blocks is luck.
        """
        if not np.isfinite(self.formal_sigma_s):
            return self.formal_sigma_s
        n_whole = int((self.time_s[-1] - self.time_s[0]) / SCATTER_BLOCK_LENGTH_S)
        n_blocks = max(n_whole, N_BLOCKS_OF_SHORT_LOG)
        lengths = {n_blocks, n_blocks // 2, min(n_blocks // 2, max(n_whole, MIN_SCATTER_BLOCKS))}
        return max(self.formal_sigma_s, *(self._sigma_from_block_scatter_s(n) for n in sorted(lengths)))

    def _sigma_from_block_scatter_s(self, n_blocks: int) -> float:
        """The sigma by the scatter over so many blocks of equal length, for as few degrees of freedom as they have."""
        span_s = float(self.time_s[-1] - self.time_s[0])
        block = np.minimum(((self.time_s - self.time_s[0]) * (n_blocks / span_s)).astype(np.int64), n_blocks - 1)
        bend = np.bincount(block, self.bend, n_blocks)
        weight = np.maximum(bend, 0.0)
        n_effective = float(weight.sum()) ** 2 / float(weight @ weight)
        n_used = max(n_effective, MIN_EFFECTIVE_BLOCKS_FOR_SIGMA)
        slope = np.bincount(block, self.slope, n_blocks) + bend * (self.likeliest_latency_s - self.centre_s)
        # The slopes add up to zero; of blocks that scatter as their bends say, the mean of the sum of their squares is
        # the whole bend times 1 - 1 / n_used.
        scatter_s = float(np.sqrt(slope @ slope / (1.0 - 1.0 / n_used))) * self.formal_sigma_s**2
        least_s = FEW_BLOCKS_SIGMA_FACTOR * self.formal_sigma_s if n_effective < MIN_EFFECTIVE_BLOCKS_FOR_SIGMA else 0.0
        return max(_student_to_normal_ratio_at_97_5_pct(n_used - 1.0) * scatter_s, least_s)

    def find_drift_rate_and_middle_s(self) -> tuple[float, float] | None:
        """How much the latency grows in a second, and the time about which it does; None where it may be constant.

        A line is found in two blocks of `SCATTER_BLOCK_LENGTH_S` of four and judged in the others, and the other way
        round. It must predict these better than a constant found like it, by `MIN_LOG_LIKELIHOOD_GAIN_OF_DRIFT`.
        """
        span_s = float(self.time_s[-1] - self.time_s[0])
        n_blocks = int(span_s / SCATTER_BLOCK_LENGTH_S)
        if n_blocks < N_BLOCKS_OF_SHORT_LOG or not np.isfinite(self.formal_sigma_s):
            return None
        block = np.minimum(((self.time_s - self.time_s[0]) * (n_blocks / span_s)).astype(np.int64), n_blocks - 1)
        bend = np.bincount(block, self.bend, n_blocks)
        slope = np.bincount(block, self.slope, n_blocks) + bend * (self.likeliest_latency_s - self.centre_s)
        weight = np.asarray(np.maximum(bend, 0.0))
        middle_s = self.time_s[0] + (np.arange(n_blocks) + 0.5) * (span_s / n_blocks)
        about_s = float(weight @ middle_s / weight.sum())
        away_s = middle_s - about_s
        gain, first = 0.0, np.arange(n_blocks) // 2 % 2 == 0
        for found, is_judged in ((first, ~first), (~first, first)):
            offset_s, rate = _fit_drift_offset_and_rate(away_s[found], slope[found], weight[found])
            constant_s = _parabola_vertex_s(0.0, float(slope[found].sum()), float(weight[found].sum()))
            gain += _sum_of_parabolas(constant_s, slope[is_judged], weight[is_judged])
            gain -= _sum_of_parabolas(offset_s + rate * away_s[is_judged], slope[is_judged], weight[is_judged])
        return (
            (_fit_drift_offset_and_rate(away_s, slope, weight)[1], about_s)
            if gain > MIN_LOG_LIKELIHOOD_GAIN_OF_DRIFT
            else None
        )

    def cross_validated_neg_log_likelihood(self) -> float:
        """The negative log-likelihood of all rows, each half's with the latency that the other half says.

        The halves have equal parts of the information. NaN where one of them says nothing.
        """
        cumulative_bend = np.cumsum(self.bend)
        n = int(np.abs(cumulative_bend - 0.5 * cumulative_bend[-1]).argmin()) + 1
        first, second = (
            (float(self.level[rows].sum()), float(self.slope[rows].sum()), float(self.bend[rows].sum()))
            for rows in (slice(0, n), slice(n, None))
        )
        total = 0.0
        for (level, slope, bend), (_, other_slope, other_bend) in ((first, second), (second, first)):
            move_s = _parabola_vertex_s(0.0, other_slope, other_bend)
            total += level + slope * move_s + 0.5 * bend * move_s**2
        return total


def _student_to_normal_ratio_at_97_5_pct(dof: float) -> float:
    """Student's 97.5 % quantile over the normal distribution's (Abramowitz and Stegun 26.7.5); dof >= 1."""
    return 1.0 + (1.210 + (1.440 + 1.304 / dof) / dof) / dof


def _fit_drift_offset_and_rate(away_s: FloatArray, slope: FloatArray, bend: FloatArray) -> tuple[float, float]:
    """Offset and rate of the likeliest line through blocks with these slopes and bends; NaN where there is none."""
    total, first, second = float(bend.sum()), float(bend @ away_s), float(bend @ away_s**2)
    determinant = total * second - first**2
    if not determinant > 0.0:
        return float("nan"), float("nan")
    at_zero, by_rate = float(slope.sum()), float(slope @ away_s)
    return (first * by_rate - second * at_zero) / determinant, (first * at_zero - total * by_rate) / determinant


def _sum_of_parabolas(move_s: FloatArray | float, slope: FloatArray, bend: FloatArray) -> float:
    return float((slope * move_s + 0.5 * bend * np.square(move_s)).sum())


def _parabola_vertex_s(centre_s: float, slope: float, bend: float) -> float:
    return centre_s - slope / bend if bend > 0.0 else float("nan")
