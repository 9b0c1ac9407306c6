"""Time to react: how long the driver may wait and still avoid the contact by any manoeuvre."""

from __future__ import annotations

import numpy as np

from cwcli.measures.base import Measure
from cwcli.measures.pair import Pair
from cwcli.measures.ttb import MEASURE as TTB
from cwcli.measures.ttk import MEASURE as TTK
from cwcli.measures.tts import MEASURE as TTS
from cwcli.signals.columns import FloatArray


def time_to_react(pair: Pair) -> FloatArray:
    """Time (s) left to avoid contact by any manoeuvre, at each stamp, (n,)."""
    return np.fmax(np.fmax(pair.evaluate_measure(TTB), pair.evaluate_measure(TTK)), pair.evaluate_measure(TTS))


MEASURE = Measure(
    summary="time left to avoid contact somehow",
    symbol="TTR",
    column="ttr_s",
    critical="low",
    formula="max(TTB, TTK, TTS)",
    source="Hillenbrand, Spieker and Kroschel 2006; Tamke, Dang and Breuel 2011",
    compute=time_to_react,
    is_symmetric=False,
    threshold=0.5,
    threshold_source="cwcli: below it hardly anybody reacts",
    undefined="the two are not on a collision course, or nothing helps any more",
    misleads="as for its parts",
    is_pointwise=True,
    is_stepped=True,
)
