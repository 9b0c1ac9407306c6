"""Consistency of an estimate: count of independent values, NEES, and errors in the form of song2016's table 1."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.angles import wrap_angle
from cwcli.signals.columns import FloatArray


def effective_sample_count(correlated_values: FloatArray, max_lag: int = 200) -> float:
    """Return how many independent values a correlated series is worth: n / (1 + 2 sum of its autocorrelations).

    The sum stops at the first autocorrelation below 0 (Geyer's initial positive sequence, simplified).
    """
    n = len(correlated_values)
    centred = correlated_values - correlated_values.mean() if n else correlated_values
    power = float(np.einsum("i,i", centred, centred))  # a BLAS product of long columns waits for threads
    if n < 3 or power <= 0.0:
        return float(n)
    total = 0.0
    for lag in range(1, min(max_lag, n - 1)):
        rho = float(np.einsum("i,i", centred[:-lag], centred[lag:])) / power
        if rho < 0.0:
            break
        total += rho
    return n / (1.0 + 2.0 * total)


def effective_count_of_squared_errors(error: FloatArray, covariance: FloatArray) -> float:
    """Return how many independent squared errors a correlated series of errors is worth.

    The squares of Gaussian errors of autocorrelation r have the autocorrelation r^2. It is taken about zero, which
    is the mean of the errors of a consistent estimate: an error that lasts for the whole series is one error.

    Args:
        error: Shape (n, d), angles wrapped.
        covariance: Shape (n, d, d).
    """
    n = len(error)
    normalised = error / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    size = 2 ** max(2 * n - 1, 1).bit_length()
    spectrum = np.abs(np.fft.rfft(normalised, size, axis=0)) ** 2
    products = np.fft.irfft(spectrum.sum(axis=1), size)[:n]
    if n < 3 or not products[0] > 0.0:
        return float(n)
    rho = products / products[0]
    n_lags = int(np.argmax(rho < 0.0)) or n
    return n / (1.0 + 2.0 * float((rho[1:n_lags] ** 2).sum()))


def nees(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the normalised estimation error squared, shape (n,); expectation = number of states.

    Args:
        error: Shape (n, d), angles wrapped.
        covariance: Shape (n, d, d). A singular one, which a log of others may hold, gives NaN.
    """
    try:
        solved = np.linalg.solve(covariance, error[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        is_regular = np.abs(np.linalg.det(covariance)) > 0.0
        solved = np.full(error.shape, np.nan)
        solved[is_regular] = np.linalg.solve(covariance[is_regular], error[is_regular, :, None])[:, :, 0]
    return np.asarray((error * solved).sum(axis=1))


@dataclass(frozen=True)
class ErrorTableRow:
    """Errors of one quantity before and after the filter: a row of song2016's table 1.

    Attributes:
        name: Quantity that is compared, e.g. "position".
        unit: Its unit.
        n: Number of samples compared.
        measured_sigma, estimated_sigma: One sigma of the error, bias included (root mean square).
        measured_bias, estimated_bias: Mean error; NaN for the position (it has no sign).
        change_percent: 100 (estimated / measured - 1).
    """

    name: str
    unit: str
    n: int
    measured_sigma: float
    measured_bias: float
    estimated_sigma: float
    estimated_bias: float
    change_percent: float


def compare_errors_with_truth(
    truth: Mapping[str, FloatArray], measured: Mapping[str, FloatArray], estimated: Mapping[str, FloatArray]
) -> list[ErrorTableRow]:
    """Compare measurements and estimates with the truth, in the form of song2016's table 1.

    Args:
        truth, measured, estimated: Quantity -> values at the same instants. Known quantities and units:
            "position" (n, 2) m; "speed" m/s; "heading" rad (reported in degrees, wrapped); "accel" m/s^2;
            "yaw_rate" rad/s (reported in deg/s); (n,) each. Rows with NaN on either side are left out.

    Returns:
        A row for each quantity of `truth` that was estimated; measured columns are NaN where it was not measured.
    """
    units = {"position": "m", "speed": "m/s", "heading": "deg", "accel": "m/s^2", "yaw_rate": "deg/s"}
    rows = []
    for name, unit in units.items():
        if name not in truth or name not in estimated:
            continue
        n, after, after_bias = _error_count_rms_and_mean(name, truth[name], estimated[name])
        before, before_bias = float("nan"), float("nan")
        if name in measured:
            _, before, before_bias = _error_count_rms_and_mean(name, truth[name], measured[name])
        change = 100.0 * (after / before - 1.0) if before > 0 else float("nan")
        rows.append(ErrorTableRow(name, unit, n, before, before_bias, after, after_bias, change))
    return rows


def _error_count_rms_and_mean(quantity: str, truth: FloatArray, estimate: FloatArray) -> tuple[int, float, float]:
    """Return count, one-sigma error and mean error; a position's sigma is per axis."""
    error = estimate - truth
    if quantity == "heading":
        error = wrap_angle(error)
    if quantity in ("heading", "yaw_rate"):
        error = np.degrees(error)
    finite = np.isfinite(error) if error.ndim == 1 else np.isfinite(error).all(axis=1)
    error = error[finite]
    if not len(error):
        return 0, float("nan"), float("nan")
    bias = float(error.mean()) if error.ndim == 1 else float("nan")
    return len(error), float(np.sqrt((error**2).mean())), bias
