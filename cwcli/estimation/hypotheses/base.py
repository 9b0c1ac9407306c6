"""What may be wrong with all rows of a source: a linear map of its values, with its name and texts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.estimation.measurements import QUANTITY_BY_KIND, Kind, Measurements
from cwcli.estimation.passes import SensorSeries
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import ValueRows


@dataclass(frozen=True)
class Hypothesis:
    """A fault of a source that a linear map of its values repairs: correct = matrix @ measured + offset.

    Attributes:
        name: Name for `--as SOURCE=NAME`.
        group: Faults of one group exclude each other, such as two units; those of different groups may come together.
        fault: End of the sentence "SOURCE ...", such as "is in km/h, not m/s".
        action: What is done about it, such as "converted".
        matrix: d rows of d numbers, with d of `QUANTITY_BY_KIND`.
        offset: d numbers.
    """

    name: str
    group: str
    fault: str
    action: str
    matrix: Sequence[Sequence[float]]
    offset: Sequence[float]

    @classmethod
    def of_scalar(
        cls, name: str, group: str, fault: str, action: str, *, factor: float = 1.0, offset: float = 0.0
    ) -> Hypothesis:
        """Return a hypothesis for a kind with one value: correct = factor * measured + offset."""
        return cls(name, group, fault, action, ((factor,),), (offset,))

    def correct_values(self, values: ValueRows) -> ValueRows:
        """Return the corrected values (n, d) of measured ones (n, d)."""
        return np.asarray(values @ np.array(self.matrix, float).T + np.array(self.offset, float))

    def correct_measurements(self, m: Measurements) -> Measurements:
        """Return the measurements with corrected values and covariances."""
        matrix = np.array(self.matrix, float)
        covariance = None if m.covariance is None else matrix @ m.covariance @ matrix.T
        return replace(m, values=self.correct_values(m.values), covariance=covariance)

    def correct_series(self, s: SensorSeries) -> SensorSeries:
        """Return a series with corrected values; its noise is left as it is."""
        width = QUANTITY_BY_KIND[s.kind].width
        values = np.zeros_like(s.values)
        values[:, :width] = self.correct_values(s.values[:, :width])
        return replace(s, values=values)

    def combine_after(self, first: Hypothesis) -> Hypothesis:
        """Return one hypothesis for two faults: `first` is repaired first, then this one."""
        own, earlier = np.array(self.matrix, float), np.array(first.matrix, float)
        offset = own @ np.array(first.offset, float) + np.array(self.offset, float)
        return Hypothesis(
            f"{first.name}+{self.name}",
            f"{first.group}+{self.group}",
            f"{first.fault} and {self.fault}",
            first.action if first.action == self.action else f"{first.action} and {self.action}",
            tuple(map(tuple, (own @ earlier).tolist())),
            tuple(offset.tolist()),
        )


def with_pairwise_combinations(hypotheses: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    """Return the hypotheses and each pair of two of different groups, a unit before a sign or a convention."""
    pairs = [
        second.combine_after(first)
        for i, first in enumerate(hypotheses)
        for second in hypotheses[i + 1 :]
        if first.group != second.group
    ]
    return (*hypotheses, *pairs)


def compose_hypothesis_by_name(kind: Kind, hypotheses: Sequence[Hypothesis], name: str) -> Hypothesis | None:
    """Return the hypothesis with a name, or of several names joined by "+".

    They are repaired in the order of `hypotheses`, a unit before a convention, however they are named.

    Returns:
        None if a name is not known, or if two of them exclude each other, such as two units.
    """
    parts = name.split("+")
    own = [each for each in hypotheses if each.name in parts]
    if len(own) < len(parts) or len({each.group for each in own}) < len(own):
        return None
    found = own[0]
    for each in own[1:]:
        found = each.combine_after(found)
    return found
