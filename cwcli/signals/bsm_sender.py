"""How a sender of BSMs filters its motion before sending it (SAE J2945/1), and how a receiver can undo that.

The acceleration goes through a low pass (Butterworth, second order, 1 Hz), so that it comes 0.225 s late; the heading
is latched at standstill: the last one from above 0.5556 m/s is sent until the car is faster than 0.6944 m/s.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import BoolArray, FloatArray

ACCEL_FILTER_CUTOFF_RADPS = 2.0 * np.pi
"""The cutoff frequency of the senders' acceleration filter, in rad/s: 1 Hz (SAE J2945/1)."""
ACCEL_FILTER_DELAY_S = np.sqrt(2.0) / ACCEL_FILTER_CUTOFF_RADPS
"""The time by which that filter delays slow changes, in seconds (0.225); it follows from the Butterworth form."""
HEADING_LATCH_SPEED_MPS, HEADING_RELEASE_SPEED_MPS = 0.5556, 0.6944
"""The speeds below which a sender freezes its heading and above which it releases it, in m/s (SAE J2945/1)."""
ACCEL_FILTER_STEP_S = 1e-3
"""The default sampling interval of the filter, in seconds; chosen by hand."""
MAX_MESSAGE_PAUSE_FOR_UNDOING_ACCEL_FILTER_S = 0.5
"""The longest pause between messages, in seconds, across which the filter is undone. Chosen by hand; not fitted."""


def apply_senders_acceleration_low_pass(values: FloatArray, step_s: float = ACCEL_FILTER_STEP_S) -> FloatArray:
    """Return samples (n,) after the senders' low pass (bilinear transform), which starts settled at the first
    sample."""
    k = 2.0 / step_s
    w2 = ACCEL_FILTER_CUTOFF_RADPS**2
    scale = k**2 + np.sqrt(2.0) * ACCEL_FILTER_CUTOFF_RADPS * k + w2
    a1, a2 = 2.0 * (w2 - k**2) / scale, (k**2 - np.sqrt(2.0) * ACCEL_FILTER_CUTOFF_RADPS * k + w2) / scale
    b = w2 / scale
    out = np.empty(len(values))
    x1 = x2 = y1 = y2 = float(values[0]) if len(values) else 0.0
    for i, x in enumerate(values.tolist()):
        y = b * (x + 2.0 * x1 + x2) - a1 * y1 - a2 * y2
        x1, x2, y1, y2 = x, x1, y, y1
        out[i] = y
    return out


def freeze_heading_at_standstill(heading_rad: FloatArray, speed_mps: FloatArray) -> FloatArray:
    """Return headings (n,) in rad as senders report them at these speeds (n,): frozen at standstill."""
    out = heading_rad.copy()
    is_latched = False
    for i, speed in enumerate(np.abs(speed_mps).tolist()):
        is_latched = speed < HEADING_LATCH_SPEED_MPS or (is_latched and speed <= HEADING_RELEASE_SPEED_MPS)
        if is_latched and i:
            out[i] = out[i - 1]
    return out


def repeated_heading_at_standstill_mask(heading_rad: FloatArray, speed_mps: FloatArray) -> BoolArray:
    """Return where a heading (n,) only repeats the one before because it is frozen at standstill: it is no new
    measurement."""
    same = np.diff(heading_rad, prepend=np.nan) == 0.0
    return np.asarray(same & (np.abs(speed_mps) <= HEADING_RELEASE_SPEED_MPS))


def undo_low_pass_filter_and_noise_gain(time_s: FloatArray, accel_mps2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Undo the senders' low pass on an acceleration, from earlier and present messages only.

    The filter's inverse is a + sqrt(2)/w a' + a''/w^2. Both derivatives are taken from the last three values: so a ramp
    is found again without a delay.

    Args:
        time_s: Shape (n,), increasing.
        accel_mps2: Shape (n,), as sent; NaN where there is none.

    Returns:
        The acceleration (n,), and by how much its noise is greater than that of what was sent (n,).
    """
    n = len(time_s)
    out, gain = accel_mps2.copy(), np.ones(n)
    if n < 3:
        return out, gain
    one, two = np.diff(time_s)[1:], np.diff(time_s)[:-1]  # the newest pause, and the one before
    y0, y1, y2 = accel_mps2[2:], accel_mps2[1:-1], accel_mps2[:-2]
    with np.errstate(divide="ignore", invalid="ignore"):
        # Newton's divided differences: the parabola through the three, at the newest
        c0 = ACCEL_FILTER_DELAY_S * (2.0 * one + two) / (one * (one + two)) + 2.0 / (
            ACCEL_FILTER_CUTOFF_RADPS**2 * one * (one + two)
        )
        c1 = -ACCEL_FILTER_DELAY_S * (one + two) / (one * two) - 2.0 / (ACCEL_FILTER_CUTOFF_RADPS**2 * one * two)
        c2 = ACCEL_FILTER_DELAY_S * one / (two * (one + two)) + 2.0 / (ACCEL_FILTER_CUTOFF_RADPS**2 * two * (one + two))
        found = y0 + c0 * y0 + c1 * y1 + c2 * y2
        noise = np.sqrt((1.0 + c0) ** 2 + c1**2 + c2**2)
    usable = (
        np.isfinite(found)
        & (one <= MAX_MESSAGE_PAUSE_FOR_UNDOING_ACCEL_FILTER_S)
        & (two <= MAX_MESSAGE_PAUSE_FOR_UNDOING_ACCEL_FILTER_S)
        & (one > 0.0)
        & (two > 0.0)
    )
    out[2:] = np.where(usable, found, y0)
    gain[2:] = np.where(usable, noise, 1.0)
    return out, gain
