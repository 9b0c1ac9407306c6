"""Covariances as sigmas and correlations in single precision: 144 bytes each, where a matrix of doubles takes 512.

A sigma has 9 binary digits and a correlation is a multiple of 2^-9, so neighbours in time are alike and compress.
Where one state follows from the others but for 1/8 of its variance, rounding could matter: there the step is at most
2^-5 of the matrix's least eigenvalue, down to 2^-20. A matrix that rounding would still make indefinite has its
correlations drawn towards zero until it is definite.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.signals.precision import round_to_binary_digits, round_to_binary_step

Float32Array = npt.NDArray[np.float32]
BINARY_DIGITS_OF_PACKED_SIGMA = 9
"""The number of binary digits of a sigma: a relative step of 0.2 %. Chosen by hand."""
CORRELATION_BINARY_DIGITS = 9
"""The number of binary digits of a correlation: a step of 2^-9. Chosen by hand."""
MAX_CORRELATION_BINARY_DIGITS = 20
"""The largest number of binary digits of a correlation in a matrix that is close to singular. Chosen by hand."""
MIN_UNEXPLAINED_VARIANCE_FOR_COARSE_STEPS_SHARE = 2.0**-3
"""The share (1) of a state's variance that is not explained by the others, below which finer steps are used. Chosen by
hand."""
MAX_CORRELATION_STEP_OF_LEAST_EIGENVALUE_SHARE = 2.0**-5
"""The largest step of a correlation as a share (1) of the matrix's least eigenvalue. Chosen by hand."""
CORRELATION_SHRINK_SHARES = (2.0**-18, 2.0**-14, 2.0**-10, 2.0**-7)
"""The shares (1) by which correlations are shrunk, one after the other, until the matrix is positive definite. Chosen
by hand."""
COVARIANCES_PACKED_PER_BLOCK = 2048  # of doubles that fit the processor's cache
"""The number of covariances that are packed at once, so that their doubles fit the processor's cache."""


@lru_cache(maxsize=8)
def _upper_triangle_indices(k: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    rows, columns = np.triu_indices(k, 1)
    return rows.astype(np.intp), columns.astype(np.intp)


@dataclass(frozen=True)
class PackedCovariances:
    """n covariances of k states, which read like an array of shape (n, k, k): any index gives doubles.

    Attributes:
        sigma: Shape (n, k), float32. NaN: the covariance is not known, or was not positive definite.
        correlation: Shape (n, k (k - 1) / 2), float32: above the diagonal, row by row.
    """

    sigma: Float32Array
    correlation: Float32Array

    @classmethod
    def allocate_uninitialised(cls, n: int, k: int) -> Self:
        """Return room for n covariances of k states, to be filled later."""
        return cls(np.empty((n, k), np.float32), np.empty((n, k * (k - 1) // 2), np.float32))

    @classmethod
    def from_dense(cls, covariance: FloatArray) -> Self:
        """Pack covariances (n, k, k) to the precision above; one that is not positive definite becomes NaN."""
        n, k, _ = covariance.shape
        out = cls.allocate_uninitialised(n, k)
        for first in range(0, n, COVARIANCES_PACKED_PER_BLOCK):
            rows = slice(first, first + COVARIANCES_PACKED_PER_BLOCK)
            out.sigma[rows], out.correlation[rows] = _sigmas_and_correlations_of_block(covariance[rows])
        return out

    def fill_rows(self, rows: npt.NDArray[np.intp], packed: PackedCovariances) -> None:
        """Fill some rows with packed covariances."""
        self.sigma[rows], self.correlation[rows] = packed.sigma, packed.correlation

    def select_rows(self, rows: Any) -> PackedCovariances:
        """Return the given rows, as packed as before."""
        return PackedCovariances(self.sigma[rows], self.correlation[rows])

    @property
    def shape(self) -> tuple[int, int, int]:
        """The shape (n, k, k) of the unpacked array."""
        n, k = self.sigma.shape
        return n, k, k

    def __len__(self) -> int:
        return len(self.sigma)

    def __iter__(self) -> Iterator[FloatArray]:
        return (self[row] for row in range(len(self)))

    def __getitem__(self, key: Any) -> FloatArray:
        rows, *inside = key if isinstance(key, tuple) else (key,)
        if isinstance(rows, int | np.integer):
            dense = self.select_rows([rows]).to_dense_n_k_k()[0]
            return np.asarray(dense[tuple(inside)]) if inside else dense
        if len(inside) == 2 and all(isinstance(each, int | np.integer) for each in inside):
            return self.element_of_each_covariance(int(inside[0]), int(inside[1]))[rows]
        dense = self.select_rows(rows).to_dense_n_k_k()
        return np.asarray(dense[(slice(None), *inside)]) if inside else dense

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> FloatArray:
        return np.asarray(self.to_dense_n_k_k(), dtype)

    def element_of_each_covariance(self, row_index: int, column_index: int) -> FloatArray:
        """Return one element of each covariance, shape (n,)."""
        k = self.sigma.shape[1]
        row_index, column_index = sorted((row_index % k, column_index % k))
        product = self.sigma[:, row_index].astype(np.float64) * self.sigma[:, column_index]
        return (
            product
            if row_index == column_index
            else product
            * self.correlation[:, row_index * k - row_index * (row_index + 1) // 2 + column_index - row_index - 1]
        )

    def to_dense_n_k_k(self) -> FloatArray:
        """Return the covariances as an array (n, k, k)."""
        return _covariance_matrices(self.sigma, self.correlation)


Covariances = FloatArray | PackedCovariances
"""Covariances of n states as an array (n, k, k), or packed."""


def pack_covariances(covariance: Covariances) -> PackedCovariances:
    """Return the covariances, packed if they are not yet."""
    return covariance if isinstance(covariance, PackedCovariances) else PackedCovariances.from_dense(covariance)


def variances_of_states(covariance: Covariances, states: Sequence[int]) -> FloatArray:
    """Return the variances of some states, shape (n, states)."""
    chosen = list(states)
    if isinstance(covariance, PackedCovariances):
        return covariance.sigma[:, chosen].astype(np.float64) ** 2
    return covariance[:, chosen, chosen]


def _covariance_matrices(sigma: Float32Array | FloatArray, correlation: Float32Array | FloatArray) -> FloatArray:
    n, k = sigma.shape
    rows, columns = _upper_triangle_indices(k)
    wide = sigma.astype(np.float64)
    out = np.empty((n, k, k))
    mixed = correlation * wide[:, rows] * wide[:, columns]
    out[:, rows, columns] = out[:, columns, rows] = mixed
    diagonal = np.arange(k)
    out[:, diagonal, diagonal] = wide**2
    return out


def _sigmas_and_correlations_of_block(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return sigmas and correlations of a few covariances."""
    k = covariance.shape[1]
    above = _upper_triangle_indices(k)
    diagonal = np.arange(k)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        exact = np.sqrt(covariance[:, diagonal, diagonal])
        full = covariance[:, above[0], above[1]] / (exact[:, above[0]] * exact[:, above[1]])
    is_finite = np.isfinite(exact).all(axis=1) & (exact > 0.0).all(axis=1) & np.isfinite(full).all(axis=1)
    sigma, correlation = (
        round_to_binary_digits(exact, BINARY_DIGITS_OF_PACKED_SIGMA),
        round_to_binary_step(full, CORRELATION_BINARY_DIGITS),
    )
    close = np.flatnonzero(
        is_finite
        & ~(_min_unexplained_variance_shares(correlation, k) >= MIN_UNEXPLAINED_VARIANCE_FOR_COARSE_STEPS_SHARE)
    )
    if len(close):
        is_finite[close] &= _min_unexplained_variance_shares(full[close], k) > 0.0
        correlation[close] = round_to_binary_step(full[close], _correlation_bits(full[close], k)[:, None])
        for share in (0.0, *CORRELATION_SHRINK_SHARES):
            close = close[is_finite[close] & ~(_min_unexplained_variance_shares(correlation[close], k) > 0.0)]
            if not len(close):
                break
            correlation[close] = round_to_binary_step(full[close] * (1.0 - share), MAX_CORRELATION_BINARY_DIGITS)
    sigma[~is_finite] = correlation[~is_finite] = np.nan
    return sigma, correlation


def _correlation_bits(correlation: FloatArray, k: int) -> npt.NDArray[np.intp]:
    """Return the number of binary digits of each matrix's step, at least the usual one; all must be finite."""
    least = np.linalg.eigvalsh(_covariance_matrices(np.ones((len(correlation), k)), correlation))[:, 0]
    step = np.clip(
        MAX_CORRELATION_STEP_OF_LEAST_EIGENVALUE_SHARE * least,
        2.0**-MAX_CORRELATION_BINARY_DIGITS,
        2.0**-CORRELATION_BINARY_DIGITS,
    )
    return np.asarray(np.ceil(-np.log2(step)), np.intp)


def _min_unexplained_variance_shares(correlation: FloatArray, k: int) -> FloatArray:
    """Return the least share of a state's variance that the states before it do not explain, (n,); NaN: not
    definite."""
    matrices = _covariance_matrices(np.ones((len(correlation), k)), correlation)
    matrices[~np.isfinite(correlation).all(axis=1)] = np.eye(k)
    try:
        factors = np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        return np.array([_min_unexplained_variance_share(matrix) for matrix in matrices])
    return np.asarray(np.einsum("nkk->nk", factors).min(axis=1) ** 2)


def _min_unexplained_variance_share(matrix: FloatArray) -> float:
    try:
        return float(np.diagonal(np.linalg.cholesky(matrix)).min() ** 2)
    except np.linalg.LinAlgError:
        return float("nan")
