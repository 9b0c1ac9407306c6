"""Rounding numbers to a stated number of binary digits.

What is published is known to centimetres at best, while a double has digits down to picometres: noise that no
compressor makes smaller. A number that ends in zeros is still a double, with the same name, unit and field.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.signals.columns import FloatArray

MIN_MAGNITUDE_LEFT_UNROUNDED = 2.0**38
"""The magnitude from which numbers are not rounded, because a double has no digit to spare there."""


def round_to_binary_step(values: FloatArray, bits: int | npt.NDArray[np.intp]) -> FloatArray:
    """Return the nearest multiples of 2^-bits, with one number of bits or one per value; non-finite values stay."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.where(np.abs(values) < MIN_MAGNITUDE_LEFT_UNROUNDED, np.rint(values * 2.0**bits) * 2.0**-bits, values)


def round_to_binary_digits(values: FloatArray, bits: int) -> FloatArray:
    """Return the nearest numbers with so many binary digits: off by a share of 2^-bits at most."""
    share, exponent = np.frexp(values)
    return np.ldexp(np.rint(share * 2.0**bits) * 2.0**-bits, exponent)


def round_plane_covariance(covariance: FloatArray, bits: int) -> FloatArray:
    """Round plane covariances (..., 3), xx xy yy, to so many binary digits: variances up, the mixed term towards zero.

    So xx yy > xy^2 stays true, and no ellipse becomes smaller. A variance grows by a share of 2^(1 - bits) at most.
    """
    share, exponent = np.frexp(covariance)
    scaled = share * 2.0**bits
    rounded = np.stack([np.ceil(scaled[..., 0]), np.trunc(scaled[..., 1]), np.ceil(scaled[..., 2])], axis=-1)
    return np.ldexp(rounded * 2.0**-bits, exponent)
