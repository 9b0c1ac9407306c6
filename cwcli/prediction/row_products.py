"""A matrix product whose rows do not depend on the number of rows, to the last bit."""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import FloatArray


def multiply_rows_reproducibly(weights: FloatArray, rows: FloatArray) -> FloatArray:
    """`weights @ rows`, (n, k) times (k, m), for a small k.

    BLAS adds in an order that depends on the number of rows. The last bit of a path would then depend on what comes
    after it in the log.
    """
    out = np.multiply(weights[:, :1], rows[0])
    for k in range(1, len(rows)):
        out += weights[:, k : k + 1] * rows[k]
    return np.asarray(out, np.float64)
