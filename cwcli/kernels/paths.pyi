import numpy as np
import numpy.typing as npt

_F = npt.NDArray[np.float64]
_B = npt.NDArray[np.bool_]
_I64 = npt.NDArray[np.int64]
_Index = npt.NDArray[np.intp]

def quadrature(
    state: _F,
    *,
    weight: _F,
    responses: tuple[_F, _F, _F, _F],
    uses: tuple[bool, bool, bool, bool],
    points: _Index,
    acting_slopes: tuple[_F, _F] | None = None,
) -> _F:
    """Integrate along the paths of m starts over s steps of q nodes each.

    Args:
        state: (m, 8).
        weight: (1 or m, q, s): of the nodes.
        responses: (1 or m, q, s) each: A, J, W, D of `prediction.models.base`.
        uses: Which of acceleration, jerk, yaw rate, yaw acceleration the model uses.
        points: (p,), increasing, in [0, s]: at the end of how many steps the integrals are wanted.
        acting_slopes: (m, k) each: A and W are the products of these with (k, q, s), which then stand in `responses`.

    Returns:
        (2, m, p, 8): the derivatives of x and of y to the state.
    """

def position_covariance(
    jacobian: _F,
    heading: _F,
    *,
    covariance: _F | None,
    trust: _F,
    variance: _F,
    sigma: _F,
    out: _F,
) -> None:
    """Covariances of the positions along m paths of p points: what the driver adds, and what grows from the start.

    Args:
        jacobian: (2, m, p, 8).
        heading: (m, p), rad.
        covariance: (m, 8, 8), of the starts; None: they are known.
        trust: (m, 4): in acceleration, jerk, yaw rate and yaw acceleration; their variances are scaled by it.
        variance: (4, 1 or m, p), s^4: two along the heading, two across it, per unit variance of acceleration.
        sigma: (m, 4), m/s^2: what each is scaled with.
        out: (m, p, 3): gets xx, xy, yy in m^2.
    """

def adapt_scale(
    log_excess: _F, is_known: _B, n_known: _Index, step_s: _F, *, rate_1ps: float, bound: float, miss_share: float
) -> _F:
    """The log of the variance's scale at each start, (sets, n), for several sets of paths from the same n starts.

    Args:
        log_excess: (sets, n): log of how many times too far outside its unscaled 90 % ellipse an outcome fell.
        is_known: (sets, n): the outcome is known at all.
        n_known: (n,): of how many starts the outcomes have happened by each start.
        step_s: (n,): time since the start before, as far as it counts.
        rate_1ps, bound: See `prediction.calibrate.Calibration`; the bound is on the log.
        miss_share: The part of the time that is to be spent outside.
    """

def stream_quantiles(
    cell: _Index, weight: _F, track: _Index, n_known: _Index, asking: _Index, prior: _F, levels: _F
) -> _F:
    """Quantiles of what was known of the others at some moments: a histogram of weights that begins with a prior.

    Args:
        cell, weight, track: Shape (e,): the outcomes in the order in which they became known: which cell of the
            histogram, how much they count, whose they are.
        n_known: Shape (m,), non-decreasing: how many outcomes were known at each moment.
        asking: Shape (m,): whose outcomes do not count there.
        prior: Shape (cells,): mass that is there without any outcome.
        levels: Shape (l,), increasing.

    Returns:
        Shape (m, l): in cells from the first one's lower edge, linear within a cell.
    """

def on_track(at_ns: _I64, stamp_ns: _I64, xy: _F, max_gap_ns: float) -> tuple[_F, _B]:
    """Where a track is at given times, linear between its points.

    Args:
        at_ns: (n, h).
        stamp_ns, xy: (m,) strictly increasing, and (m, 2); m is 2 at least.
        max_gap_ns: Between points farther apart nothing is interpolated.

    Returns:
        The positions, (n, h, 2), NaN where unknown; and where they are known, (n, h).
    """
