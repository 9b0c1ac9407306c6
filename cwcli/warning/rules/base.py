"""The interface of a warning rule: it returns masks over the evaluations of one pair."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields

import numpy as np

from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import BoolArray, FloatArray
from cwcli.warning.measures import Measures
from cwcli.warning.types import WarningConfig


@dataclass(frozen=True)
class Decision:
    """A rule's decision on m evaluations. Where it raises, it is armed and held too.

    Attributes:
        armed: Shape (m,): the condition whose persistence counts.
        raised: Shape (m,): the condition for the warning itself.
        at_once: Shape (m,): raises without persistence; None: nothing does.
        held: Shape (m,): the weaker condition that keeps a warning active.
        time_to_event_s, predicted_distance_m: Shape (m,): numbers that the warning states.
        probability: Shape (m,): probability of a collision within the horizon that the warning states; None: that of
            the mean paths.
        alert_probability: Shape (m,): the probability that the rule compares with its threshold; None: it has none.
    """

    armed: BoolArray
    raised: BoolArray
    held: BoolArray
    time_to_event_s: FloatArray
    predicted_distance_m: FloatArray
    at_once: BoolArray | None = None
    probability: FloatArray | None = None
    alert_probability: FloatArray | None = None


@dataclass(frozen=True)
class Rule:
    """A warning rule.

    Attributes:
        summary: One line for `--help`.
        persistence_s: How long `armed` must have held before a warning, unless the user says otherwise.
        decide: Measures, those under the onset hypothesis (or None), options, persistence -> `Decision`.
        words: Text of the warning, with `{other}` for the other's id.
        measures: Names of pointwise measures of docs/measures.md; `Measures.by_name` then has them.
        uses_states: Whether it uses the two states themselves; `Measures.states` then has them.
        uses_onset: Whether it uses the onset hypothesis.
        uses_braking: Whether it uses the probability of contact under braking.
        uses_braking_horizon: Whether it uses the measures to the horizon that braking needs (`Measures.farther`).
        is_symmetric: Whether its decision is the same whichever of the two is the host.
        is_of_collisions: Whether it warns of every collision, and not of some other danger.
        leaves_out_kinds: Whether it does not warn of followers from behind, of vehicles beside the lane and while the
            host stands, unless the options ask for these (`warning.kinds`).
    """

    summary: str
    persistence_s: float
    decide: Callable[[Measures, Measures | None, WarningConfig, float], Decision]
    words: str = "collision with {other}"
    measures: tuple[str, ...] = ()
    uses_states: bool = False
    uses_onset: bool = False
    uses_braking: bool = False
    uses_braking_horizon: bool = False
    is_symmetric: bool = True
    is_of_collisions: bool = True
    leaves_out_kinds: bool = False


def leave_out_raised_warnings(decision: Decision, rows: BoolArray) -> Decision:
    """The decision with no warning raised in the masked rows (m,); it is confirmed there, and may be raised behind."""
    at_once = None if decision.at_once is None else decision.at_once & ~rows
    return replace(decision, raised=decision.raised & ~rows, at_once=at_once)


def withhold_warnings(decision: Decision, rows: BoolArray) -> Decision:
    """The decision with no warning raised or confirmed in the masked rows (m,); active warnings may go on there."""
    if not rows.any():
        return decision
    at_once = None if decision.at_once is None else decision.at_once & ~rows
    return replace(decision, armed=decision.armed & ~rows, raised=decision.raised & ~rows, at_once=at_once)


def check_decision(decision: Decision, measures: Measures, *others: object) -> Decision:
    """Check a plug-in's decision against the evaluations that it is about, and return it.

    Raises:
        TypeError: It is no `Decision`.
        ValueError: One of its arrays has another shape, or a mask is not boolean.
    """
    if not isinstance(decision, Decision):
        raise TypeError(f"a {type(decision).__name__}, no Decision")
    shape = measures.distance_m.shape
    for name in (entry.name for entry in fields(Decision)):
        values = getattr(decision, name)
        if values is None and name in ("at_once", "probability", "alert_probability"):
            continue
        kind = np.bool_ if name in ("armed", "raised", "held", "at_once") else np.float64
        if np.shape(values) != shape or np.asarray(values).dtype != kind:
            found = np.asarray(values)
            raise ValueError(f"{name} is {found.dtype} of shape {found.shape}, not {kind.__name__} of shape {shape}")
    return decision
