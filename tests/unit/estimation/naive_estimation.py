"""Plain twins of `cwcli.kernels.estimation`: sorting and searching whole arrays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]


def matching_factor(
    nu2: FloatArray, prior: FloatArray, noise: FloatArray, *, most: float, n_steps: int, limit: float
) -> float:
    """The factor on the noise at which the mean of the limited, normalised innovations is 1."""
    low, high = 1.0 / most, most
    for _ in range(n_steps):
        middle = float(np.sqrt(low * high))
        if np.minimum(nu2 / (prior + middle * noise), limit).mean() > 1.0:
            low = middle
        else:
            high = middle
    return float(np.sqrt(low * high))


def steps(
    update_s: FloatArray, output_s: FloatArray, start_s: float, max_step_s: float, max_pieces: int
) -> tuple[FloatArray, IntArray, IntArray]:
    """Time, first update and output of each step."""
    times = np.concatenate((np.unique(np.append(update_s, start_s)), output_s))
    is_output = np.arange(len(times)) >= len(times) - len(output_s)
    for before, after in zip(np.unique(times)[:-1], np.unique(times)[1:], strict=True):
        pieces = int(min(np.ceil((after - before) / max_step_s - 1e-9), max_pieces))
        times = np.append(times, before + np.arange(1, pieces) * ((after - before) / max(pieces, 1)))
    is_output = np.append(is_output, np.zeros(len(times) - len(is_output), bool))
    order = np.lexsort((is_output, times))
    times, is_output = times[order], is_output[order]
    holder = np.searchsorted(times, update_s, side="left")
    first = np.searchsorted(holder, np.arange(len(times) + 1), side="left").astype(np.int32)
    return times, first, np.where(is_output, np.cumsum(is_output) - 1, -1).astype(np.int32)
