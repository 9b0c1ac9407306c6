import numpy as np
import numpy.typing as npt

_F = npt.NDArray[np.float64]
_I64 = npt.NDArray[np.int64]
_Index = npt.NDArray[np.intp]

def changes(age_s: _F, value: _F, first: _Index, look_back_s: _F) -> tuple[_F, _F]:
    """How much two quantities changed over the time before each row, linear between rows of the same track.

    Args:
        age_s: (n,): time since the track's first row; tracks one after the other.
        value: (2, n).
        first: (n,): the first row of each row's track.
        look_back_s: (k,): how long before; never before the first row.

    Returns:
        The changes, (n, 2, k), and over what time they are, (n, k).
    """

def gains(
    parts: _F,
    promised: _F,
    followed: _F,
    *,
    step_s: _F,
    knots_s: _F,
    track: _Index,
    known_row: _Index,
    known_ns: _I64,
    now_ns: _I64,
    by_known: _Index,
    by_now: _Index,
    prior: _F,
    error_m: _F,
    carried: _F,
    prior_outcomes: _F,
) -> _F:
    """The gain of each part of a derivative from the outcomes known at each row; see `prediction.outcome_history`.

    Args:
        parts: (n, 2, k, 3): the derivatives' shares; k is 16 at most.
        promised, followed: (n, 2, k): displacements; NaN where it is not known what followed.
        step_s: (n,): the time that each row's outcome stands for.
        knots_s: (k,).
        track: (n,): whose row it is, from 0, non-decreasing.
        known_row, known_ns: (n, k): with which row of the vehicle, and when, the outcome became known; never: n.
        now_ns: (n,): when the row's state was known.
        by_known, by_now: (k, n) and (n,): the rows in the order of these.
        prior, error_m: (2, k, 3), (2, k): the fleet's gains, and what they leave over.
        carried: (2, k, 3): what a gain at the knot before is multiplied with; NaN: the fleet's counts.
        prior_outcomes: (3,): the weight of the prior.

    Returns:
        (n, 2, k, 3).
    """
