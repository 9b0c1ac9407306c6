"""A product of matrices of which each row depends on nothing but its own row, to the last bit."""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import FloatArray


def row_products(weights: FloatArray, rows: FloatArray) -> FloatArray:
    """`weights @ rows`, (n, k) times (k, m), for a small k.

    BLAS adds in another order where a matrix has another number of rows. A path would then differ in its last bit with
    what came after it in the log.
    """
    out = np.multiply(weights[:, :1], rows[0])
    for k in range(1, len(rows)):
        out += weights[:, k : k + 1] * rows[k]
    return np.asarray(out, np.float64)
