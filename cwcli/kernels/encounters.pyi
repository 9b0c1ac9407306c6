import numpy as np
import numpy.typing as npt

_F = npt.NDArray[np.float64]
_Size = tuple[float, float]

def accelerated_contact_time(centre: _F, speed: _F, reach: _F, bend: _F) -> _F:
    """Seconds until two rectangles touch at constant acceleration, (m,): infinity if never.

    Args:
        centre, speed, bend: (4, m): where the other's centre is from the host's on the four edge directions, and its
            first and second derivative.
        reach: (4, m): up to which distance the projections overlap.
    """

def overlap_time_along_arcs(
    place: _F,
    direction: _F,
    chord: _F,
    turn: _F,
    close_m: _F,
    host_size: _Size,
    other_size: _Size,
    *,
    n_steps: int,
    step_s: float,
) -> _F:
    """Seconds until two rectangles overlap along arcs, (m,), linear between steps; NaN if they do not.

    Args:
        place, direction: (m, 2): the other's centre and direction in the host's axes.
        chord: (2, m, 2): how far the host and the other come in a step, in their own axes.
        turn: (2, m, 2): cosine and sine of the turn of each in a step.
        close_m: (m,): outlines are compared up to this distance of the centres.
        host_size, other_size: Length and width.
    """

def rows_of_least_lag(poses: _F, host_size: _Size, other_size: _Size, reach_m: float, n_lags: int) -> tuple[int, int]:
    """Rows of the host and of the other that are the fewest steps apart and overlap; (-1, -1) if none do.

    Of as many the other's later ones come first, and of those the first.

    Args:
        poses: (8, g): x, y, cosine and sine of the heading of the host and of the other on a common grid of time.
        host_size, other_size: Length and width.
        reach_m: Centres farther apart than this do not overlap.
        n_lags: How many steps apart are tried, with none.
    """
