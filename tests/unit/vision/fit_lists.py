"""Lane fits as the columns that the stage records."""

from __future__ import annotations

from cwcli.vision.fit_columns import FitColumns, FitRecorder
from cwcli.vision.method import LaneFit


def columns_of(fits: list[LaneFit]) -> FitColumns:
    """The given fits as columns."""
    recorder = FitRecorder()
    for fit in fits:
        recorder.append(fit)
    return recorder.columns()
