import numpy as np
import numpy.typing as npt

_F = npt.NDArray[np.float64]
_I = npt.NDArray[np.int32]

def matching_factor(nu2: _F, prior: _F, noise: _F, *, most: float, n_steps: int, limit: float) -> float:
    """The factor on the noise at which the innovations are as large as they should be, by bisection of its log.

    Args:
        nu2, prior: (n,): squared innovation and its variance without the measurement's own noise.
        noise: (n,): the measurement's variance.
        most: The factor lies in [1 / most, most].
        n_steps: Of the bisection.
        limit: No squared, normalised innovation counts more than this.
    """

def fading_integral(time_s: _F, rate: _F, *, decay_s: float, max_gap_s: float) -> _F:
    """(n,): u at times (n,), increasing, of u' = -u / decay_s + rate from u = 0 on; in longer gaps the rate is 0."""

def lay_steps(update_s: _F, output_s: _F, *, start_s: float, max_step_s: float, max_pieces: int) -> tuple[_F, _I, _I]:
    """Lay a pass's steps: the start, each time of an update, and each output behind the updates of the same time.

    Gaps are crossed in equal pieces.

    Args:
        update_s, output_s: (n,), (m,): non-decreasing, none before the start.
        start_s: Where the pass begins.
        max_step_s, max_pieces: A gap is divided so that no piece is longer, but into no more pieces than that.

    Returns:
        Time of each of the T steps, (T,); (T + 1,): the updates of step k are those from first[k] to first[k + 1] - 1;
        (T,): the output that each step is, or -1.
    """
