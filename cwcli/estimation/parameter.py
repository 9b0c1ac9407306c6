"""Constants of a source besides its bias (scale, lever arm, slow error) with their status."""

from __future__ import annotations

from enum import StrEnum

from cwcli.lazy_dataclass import dataclass


class ParameterStatus(StrEnum):
    """How a parameter of a sensor was treated.

    Attributes:
        OFF: Not looked for: neither the source nor the log could show it.
        NOT_OBSERVABLE: The log does not suffice to determine it.
        NOT_BETTER: Tried; the log is not predicted better with it, so it is left out.
        USED: Found and used.
        GIVEN: Used as the user or a calibration gave it.
        CONTRADICTS: Found beyond what such a sensor can be (`sensor_limits`): not used, except for a bias, whose state
            the filter has in any case.
    """

    OFF = "off"
    NOT_OBSERVABLE = "not observable"
    NOT_BETTER = "not better"
    USED = "used"
    GIVEN = "given"
    CONTRADICTS = "contradicts"


@dataclass(frozen=True)
class Parameter:
    """A constant of one source.

    Attributes:
        value: NaN where nothing was found.
        sigma: One sigma of it, NaN where there is none.
        status: How it was treated.
    """

    value: float = float("nan")
    sigma: float = float("nan")
    status: ParameterStatus = ParameterStatus.OFF


@dataclass(frozen=True)
class SlowError:
    """An error of one source that stays for a while: Gauss-Markov, with the autocorrelation sigma^2 exp(-t / time_s).

    Attributes:
        sigma: Stationary sigma, in the unit of the source's kind (of a position: of each axis); NaN = none found.
        time_s: Time constant, seconds; NaN = none found.
        status: How it was treated.
        largest: Largest absolute value in the log, in the unit of sigma; NaN = none found.
        along_to_across: Of a position: how much more it changes along the way than across it; NaN = unknown.
    """

    sigma: float = float("nan")
    time_s: float = float("nan")
    status: ParameterStatus = ParameterStatus.OFF
    largest: float = float("nan")
    along_to_across: float = float("nan")


NO_PARAMETER = Parameter()
"""Parameter that was not looked for."""
NO_STAMP_ERROR = Parameter(0.0)
"""Stamp error of a source whose stamps are taken as exact."""
NO_SLOW_ERROR = SlowError()
"""Slow error that was not looked for."""
