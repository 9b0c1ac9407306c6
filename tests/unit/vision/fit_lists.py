"""Lane fits as the columns that the stage records."""

from __future__ import annotations

from cwcli.vision.fit_columns import FitCollector, FitColumns
from cwcli.vision.method import LaneFit


def columns_of(fits: list[LaneFit]) -> FitColumns:
    """The given fits as columns."""
    recorder = FitCollector()
    for fit in fits:
        recorder.append_fit(fit)
    return recorder.to_columns()
