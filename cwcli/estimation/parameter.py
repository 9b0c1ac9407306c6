"""What the estimator finds of a source beside its bias: a scale, a lever arm, slow errors; and what is made of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class ParameterStatus(StrEnum):
    """What was made of a parameter of a sensor.

    Attributes:
        OFF: Not looked for: the source, or the log, has nothing that could have it.
        NOT_OBSERVABLE: The log has too little in it to tell.
        NOT_BETTER: Tried; the log is not predicted better with it, so it is left out.
        USED: Found and used.
        GIVEN: Used as the user, or a calibration, said.
        CONTRADICTS: Found beyond what such a sensor can be (`sensor_limits`): not used, but for a bias, whose state
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
        status: What was made of it.
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
        status: What was made of it.
    """

    sigma: float = float("nan")
    time_s: float = float("nan")
    status: ParameterStatus = ParameterStatus.OFF


NO_PARAMETER = Parameter()
EXACT_STAMPS = Parameter(0.0)
NO_SLOW_ERROR = SlowError()
