"""The default rule: contact of the outlines that is probable, serious and persistent.

Three conditions, each against one kind of false warning:

1. The probability that the outlines touch within the horizon, along both curved paths under both covariances, reaches
   the threshold (`measures.collision_probability`). Two cars side by side, an oncoming car in its own lane and a turn
   past a standing car bring the centres near, and do not touch; a path that only just scrapes does not warn either.
2. It is serious: were the host to brake gently from now on (`min_deceleration_mps2`, 2 m/s^2), contact would still be
   possible, with a probability of `MAX_PROBABILITY_OF_AVOIDED_CONTACT` at least. A lead that needs only 1 m/s^2 is no
   conflict. At a great closing speed that is too late, so there the rule looks farther: contact within the time that a
   driver needs to react and brake with 4 m/s^2 is serious, too (`warning.braking_horizon`).
3. Condition 1 has held for the persistence time. To cost no lead it may look farther ahead by just that time while it
   is being confirmed; the warning itself comes when contact is within the horizon.

The mean path comes late where the other driver has only just begun to brake hard or to turn in: on average such an
onset does not last, so a good predictor does not follow it far. A warning must. Where the other's path under the
hypothesis that the onset goes on (`VehicleTrack.onset_paths`) fulfils 1 and 2, and brings the cars clearly nearer at
the horizon than the mean path does, the rule warns at once: the hypothesis asks for a derivative that stands out of the
filter's noise, which is a persistence of its own.

It does not warn of a follower from behind or while the host stands, since the host cannot avoid either, or of a vehicle
that drives parallel in a lane of its own, unless `--from-behind`, `--while-standing` or `--beside-lane` asks for it
(`warning.kinds`).

A warning stays up until contact is less than half as probable as the threshold.
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.columns import BoolArray, FloatArray
from cwcli.warning.measures import MEASURE_ARRAY_NAMES, Measures
from cwcli.warning.rules.base import Decision, Rule
from cwcli.warning.types import WarningConfig

RELEASE_SHARE_OF_PROBABILITY_THRESHOLD = 0.5
"""Share of the probability threshold below which a warning ends. Chosen by hand; not fitted."""
MAX_PROBABILITY_OF_AVOIDED_CONTACT = 0.01
"""Probability of contact below which it counts as avoided. Chosen by hand; not fitted."""


def decide_by_contact_probability(
    measures: Measures, onset: Measures | None, config: WarningConfig, persistence_s: float
) -> Decision:
    """Decide by the probability of contact: it must be probable, serious and persistent."""
    armed = _is_contact_probable(measures.late_probability, config)
    raised = armed & _is_probable_despite_gentle_braking(measures, config)
    is_held = measures.late_probability > RELEASE_SHARE_OF_PROBABILITY_THRESHOLD * config.probability
    shown, at_once = measures, None
    if measures.farther is not None:
        farther = measures.farther
        needs_braking = _is_contact_probable(farther.probability, config)
        shown = _select_by_row(needs_braking & ~raised, farther, measures)
        armed |= _is_contact_probable(farther.late_probability, config)
        raised |= needs_braking
        is_held |= farther.late_probability > RELEASE_SHARE_OF_PROBABILITY_THRESHOLD * config.probability
    if onset is not None:
        at_once = _is_probable_despite_gentle_braking(onset, config)
        shown = _select_by_row(at_once & ~raised, onset, shown)
        if onset.farther is not None:
            needs_braking = _is_contact_probable(onset.farther.probability, config)
            shown = _select_by_row(needs_braking & ~raised & ~at_once, onset.farther, shown)
            at_once |= needs_braking
            is_held |= onset.farther.probability > RELEASE_SHARE_OF_PROBABILITY_THRESHOLD * config.probability
        is_held |= onset.probability > RELEASE_SHARE_OF_PROBABILITY_THRESHOLD * config.probability
    return Decision(
        armed=armed,
        raised=raised,
        held=is_held,
        time_to_event_s=np.where(np.isfinite(shown.overlap_s), shown.overlap_s, shown.min_time_s),
        predicted_distance_m=shown.min_distance_m,
        at_once=at_once,
        probability=shown.probability,
        alert_probability=shown.probability,
    )


def _is_contact_probable(probability: FloatArray, config: WarningConfig) -> BoolArray:
    """Whether contact is possible and at least as probable as the threshold, (m,)."""
    return np.asarray((probability > 0.0) & (probability >= config.probability))


def _is_probable_despite_gentle_braking(measures: Measures, config: WarningConfig) -> BoolArray:
    """Whether contact within the horizon is probable, and gentle braking does not avoid it, (m,)."""
    return np.asarray(
        _is_contact_probable(measures.probability, config)
        & ~(measures.braked_probability < MAX_PROBABILITY_OF_AVOIDED_CONTACT)
    )


def _select_by_row(chosen: BoolArray, first: Measures, second: Measures) -> Measures:
    """Select the rows of one where `chosen` (m,) is true, else those of the other."""
    return Measures(
        **{name: np.where(chosen, getattr(first, name), getattr(second, name)) for name in MEASURE_ARRAY_NAMES}
    )


RULE = Rule(
    summary="contact of the outlines is probable under both covariances, gentle braking would not avoid it, and "
    "this persists",
    persistence_s=0.1,
    decide=decide_by_contact_probability,
    uses_onset=True,
    uses_braking=True,
    uses_braking_horizon=True,
    leaves_out_kinds=True,
    is_symmetric=False,  # who follows can brake, who leads can't
)
