"""One sentence on an estimate, from its numbers: consistent, or what is not and what to do."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cwcli.estimation.contradiction import Contradiction
from cwcli.estimation.measurements import RATES
from cwcli.estimation.result import SourceReport

FACTOR = 2.0
"""Of a variance: what lies within it, outside its bounds or not, hardly changes what may be made of a state."""
MANY_GATED = 0.05
MANY_BRIDGED = 0.2
MOST_TOLD = 2


@dataclass(frozen=True)
class Nees:
    """How the errors of a quantity compare with what the covariance says of them.

    Attributes:
        name: The quantity.
        per_dof: Mean of the normalised error squared by its degrees of freedom; 1 is expected.
        bounds: 95 % bounds of it, for as many independent errors as their autocorrelation leaves.
    """

    name: str
    per_dof: float
    bounds: tuple[float, float]

    @property
    def is_inside(self) -> bool | None:
        """Whether it lies in its bounds; None where nothing is known."""
        return None if math.isnan(self.per_dof) else self.bounds[0] <= self.per_dof <= self.bounds[1]


def verdict(
    sources: Sequence[SourceReport],
    *,
    n_states: int,
    n_flagged: Mapping[str, int],
    nees: Sequence[Nees] = (),
    contradictions: Sequence[Contradiction] = (),
) -> str:
    """Whether the estimate is as good as it says.

    The worst comes first: sources of which one must be wrong, states that err by more than they say, sources that
    contradict the others, states that hang in the air, sources that are noisier than taken for, and what is better than
    it says.

    Args:
        sources: Of one vehicle.
        n_states: Of its track.
        n_flagged: How many of them have each flag, by its name.
        nees: Where there is a truth.
        contradictions: Sources that can't both be right.
    """
    if not n_states:
        return "nothing was estimated"
    surer = [
        f"the {each.name} errs by {math.sqrt(each.per_dof):.1f} times its sigma: take its covariance times "
        f"{each.per_dof:.2g}"
        for each in nees
        if each.is_inside is False and each.per_dof > FACTOR
    ]
    wrong = [f"{each.sentence} ({each.consequence})" for each in contradictions]
    faults = [*wrong, *surer, *_contradictions(sources), *_bridged(n_states, n_flagged), *_noisier(sources)]
    if faults:
        more = f", and {len(faults) - MOST_TOLD} more" if len(faults) > MOST_TOLD else ""
        return f"not consistent: {'; '.join(faults[:MOST_TOLD])}{more}"
    careful = [
        *(f"{each.name} error" for each in nees if each.is_inside is False and each.per_dof < 1.0 / FACTOR),
        *(_name(s) for s in sources if s.nis_inside is False and _nis(s) < 1.0 / FACTOR),
    ]
    if careful:
        return f"consistent, and more careful than need be: less of {_listed(careful)} than the covariance says"
    outside = [_name(s) for s in sources if s.nis_inside is False]
    outside += [f"NEES of the {each.name}" for each in nees if each.is_inside is False]
    if outside:
        return f"consistent within a factor of {FACTOR:g} in variance: {_listed(outside)} outside the 95 % bounds"
    if any(s.nis_inside is not None for s in sources):
        return "consistent"
    return "too little was measured to tell whether the estimate is consistent"


def _contradictions(sources: Sequence[SourceReport]) -> list[str]:
    found = []
    for s in sources:
        n = s.n_used + s.n_gated
        if n and s.n_gated > MANY_GATED * n:
            found.append(
                f"{100 * s.n_gated / n:.0f} % of {_name(s)} contradict the rest: check its stamps and its mounting"
            )
        elif s.n_resets and s.kind not in RATES:
            found.append(f"{_name(s)} jumped {s.n_resets} x: leave out the states flagged after_reset")
    return found


def _bridged(n_states: int, n_flagged: Mapping[str, int]) -> list[str]:
    share = n_flagged.get("bridged", 0) / n_states
    return [f"{100 * share:.0f} % of the states bridge gaps: leave out those flagged bridged"] * (share > MANY_BRIDGED)


def _noisier(sources: Sequence[SourceReport]) -> list[str]:
    return [
        f"{_name(s)} scatters by {math.sqrt(_nis(s)):.1f} times its sigma: "
        f"{'its messages understate its noise' if s.noise_origin.startswith('message') else 'its errors last'}, "
        "so trust the states less than their covariance"
        for s in sources
        if s.nis_inside is False and _nis(s) > FACTOR
    ]


def _nis(s: SourceReport) -> float:
    return s.nis_mean / s.nis_dof


def _name(s: SourceReport) -> str:
    return f"{s.source} {s.kind.name.lower().replace('_', ' ')}"


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
