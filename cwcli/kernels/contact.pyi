import numpy as np
import numpy.typing as npt

_F = npt.NDArray[np.float64]
_Index = npt.NDArray[np.intp]

def contact_probability(
    x: _F,
    y: _F,
    host_heading: _F,
    other_heading: _F,
    host_covariance: _F,
    other_covariance: _F,
    *,
    host_length: float,
    host_width: float,
    other_length: float,
    other_width: float,
    lines: _F,
    n_lines: _Index,
    enough_below: _F,
    ends: _Index,
    far_sigmas: float,
    least_m2: float,
    straight_sigmas: float,
) -> _F:
    """The probability that two outlines touch within the first steps of m pairs of paths of q points.

    Args:
        x, y: (m, q): the other's centre minus the host's.
        host_heading, other_heading: (m, q).
        host_covariance, other_covariance: (m, q, 3): xx, xy, yy of the positions.
        host_length, host_width, other_length, other_width: Outlines.
        lines: (l, 4): cosine and sine of a line's direction through the errors at the nearest step, from the host's
            heading there, and the two errors that are independent of those; several sets, one after another.
        n_lines: (t,): lines in each of them, growing.
        enough_below: (t - 1,): up to which share of the variance the errors off the nearest step's plane may be, times
            the density of the errors that a step needs, for each set but the last.
        ends: (e,), not decreasing, in [1, q - 1]: within how many steps.
        far_sigmas: Steps in which the outlines are farther apart than this are left out.
        least_m2: Added to each variance.
        straight_sigmas: Steps in which nothing is farther from straight on than this, in the least sigma, are one.

    Returns:
        (m, e); NaN where a point of the row is.
    """
