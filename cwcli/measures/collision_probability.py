"""The probability that two outlines touch along two uncertain paths.

Each path's error is perfectly correlated in time: at every moment it is the symmetric root of the path's covariance
there times two standard normal numbers that are drawn once for the path. So a car that is a sigma off at first is a
sigma off later, and the covariance grows along the path because that error grows. Over a few seconds wrong speeds,
headings and accelerations grow like that; errors that were independent in time would cause more contacts.

Two paths have four such numbers. At each moment the outlines overlap in a convex set of errors: four slabs, one for
each direction of an edge (`outlines`). During a step between two points, in which the centres and their errors move
straight and the headings are those of its middle, it is these slabs, each where it reaches in the step, and a fifth one
across the way, which an error of the speed turns: it is taken at the bounds that the others leave. A line through the
errors therefore meets a step in one interval, and the union of the intervals has a probability in
closed form: the distance of two normal numbers from their mean has a Rayleigh distribution. The result is the mean over
lines.
Their directions are equally spaced in the plane of the errors at the step in which the outlines come nearest, in
sigmas; the two errors independent of that plane, by which the errors at other times differ, follow a lattice.

Steps in which the motion is nearly straight are joined: positions, headings and the roots of the covariances may differ
from the straight line by what changes the probability little, more where the outlines are far apart, in sigmas.

Limits: a step must be short against the cars' turning. `python -m tests.studies.collision_probability` compares it with
samples: of 10^6 of each of 200 random encounters it differs by 0.0031 at most, 0.0007 (RMS); with steps of 0.1 s, which
`cwcli warn` takes, by 0.0032 and 0.0008.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cwcli.kernels.contact import contact_probability
from cwcli.measures.outlines import LengthAndWidthM
from cwcli.signals.columns import FloatArray

LATTICE_GENERATORS = {72: 15, 290: 37}
"""Number of lines -> generator of Korobov's lattice of half as many points with the least worst-case error P2."""
MAX_VARIANCE_CHANGE_SHARES_FOR_FEW_LINES = (0.006,)
"""The smaller number of lines is used where the errors at other times differ by a smaller share of their variance than
this; each step counts by the density of the errors that it needs. Chosen by the module's study."""
MAX_ERROR_OF_POSSIBLE_CONTACT_SIGMAS = 3.7
"""Largest error in sigmas that a contact may need; beyond it, its probability counts as 0, because it is below 0.001.
Chosen by hand."""
MAX_DIFFERENCE_OF_JOINED_STEPS_SIGMAS = 0.005
"""Steps that differ from one straight step by less than this, in sigmas, are joined: headings may differ by twice as
much, errors by half of it. Chosen by the module's study."""
MIN_VARIANCE_M2 = 1e-6
"""Smallest variance of a position, m^2, so that the covariance of an exact position can be inverted."""


class UncertainPaths(NamedTuple):
    """Headings, uncertain positions and outline of a vehicle on m paths of q points each.

    Attributes:
        heading_rad: Shape (m, q), continuous along a path.
        covariance_m2: Shape (m, q, 3): xx, xy, yy of the positions.
        size: Length and width, metres.
    """

    heading_rad: FloatArray
    covariance_m2: FloatArray
    size: LengthAndWidthM


def collision_probability(
    x_m: FloatArray,
    y_m: FloatArray,
    host: UncertainPaths,
    other: UncertainPaths,
    *,
    ends: npt.NDArray[np.intp] | None = None,
) -> FloatArray:
    """Compute the probability that the outlines touch at any time, of m pairs of paths of q points each, q >= 2.

    Args:
        x_m, y_m: Shape (m, q): the other's centre minus the host's, map frame.
        ends: Shape (e,), increasing, at least 1: points up to which a contact counts; None: the last alone.

    Returns:
        Probabilities (m, e); NaN where a point of the row is NaN.
    """
    if ends is None:
        ends = np.array([x_m.shape[1] - 1])
    arrays = (x_m, y_m, host.heading_rad, other.heading_rad, host.covariance_m2, other.covariance_m2)
    return contact_probability(
        *(np.ascontiguousarray(each, np.float64) for each in arrays),
        host_length=host.size[0],
        host_width=host.size[1],
        other_length=other.size[0],
        other_width=other.size[1],
        lines=np.concatenate([cosine_sine_and_errors_of_lines(n) for n in LATTICE_GENERATORS]),
        n_lines=np.array([*LATTICE_GENERATORS], np.intp),
        enough_below=np.array(MAX_VARIANCE_CHANGE_SHARES_FOR_FEW_LINES),
        ends=np.ascontiguousarray(ends, np.intp),
        far_sigmas=MAX_ERROR_OF_POSSIBLE_CONTACT_SIGMAS,
        least_m2=MIN_VARIANCE_M2,
        straight_sigmas=MAX_DIFFERENCE_OF_JOINED_STEPS_SIGMAS,
    )


def is_touch_improbable(
    distance_m: FloatArray, variance_m2: FloatArray, host_size: LengthAndWidthM, other_size: LengthAndWidthM
) -> npt.NDArray[np.bool_]:
    """Whether contact would need errors beyond `MAX_ERROR_OF_POSSIBLE_CONTACT_SIGMAS`, (m,).

    Outlines that touch have centres no farther apart than the sum of their half diagonals. The relative position must
    therefore err by the rest of the distance, towards the other centre.

    Args:
        distance_m: Shape (m,): the least distance of the centres.
        variance_m2: Shape (m,): at least the variance of the relative position along any direction, at any time.
    """
    reach = 0.5 * (np.hypot(*host_size) + np.hypot(*other_size))
    return np.asarray(distance_m - reach > MAX_ERROR_OF_POSSIBLE_CONTACT_SIGMAS * np.sqrt(variance_m2))


@cache
def cosine_sine_and_errors_of_lines(n_lines: int) -> FloatArray:
    """Lines in the host's axes, (n, 4): cosine and sine of each one's direction, and the two errors independent of it.

    The second half mirrors the first, so that left and right are alike.
    """
    half = n_lines // 2
    k = np.arange(half)
    u, v = ((k * step % half + 0.5) / half for step in (LATTICE_GENERATORS[n_lines], LATTICE_GENERATORS[n_lines] ** 2))
    angle = np.pi * (k + 0.5) / n_lines
    ahead, left = np.sqrt(-2.0 * np.log(u)) * np.array([np.cos(2.0 * np.pi * v), np.sin(2.0 * np.pi * v)])
    ahead = (ahead - ahead.mean()) / ahead.std()  # their covariance is one, as it is of what they stand for
    left = left / np.sqrt(np.mean(left**2))
    one, other = ([sign * np.cos(angle), np.sin(angle), ahead, sign * left] for sign in (1.0, -1.0))
    return np.concatenate([np.column_stack(one), np.column_stack(other)])
