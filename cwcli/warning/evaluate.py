"""Warnings of one host against the other vehicles, at every state of the host."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.table import Table
from cwcli.signals.columns import FloatArray, sort_distinct_values
from cwcli.warning.conflict_definition import parse_conflict_definition
from cwcli.warning.kinds import WarningKind
from cwcli.warning.output import (
    evaluation_series_table,
    event_id_by_pair_and_event,
    warning_events_table,
    warning_rows_of_pairs,
)
from cwcli.warning.pair import PairEvaluation, evaluate_pairs
from cwcli.warning.rows import WarningRows
from cwcli.warning.rules import RULES
from cwcli.warning.rules.base import Rule
from cwcli.warning.types import VehicleTrack, WarningConfig

LARGEST_COLLISION_DISTANCE_OPTION_M = 1e4
"""Largest permitted collision distance, m. Chosen by hand."""
LONGEST_LOOK_BEYOND_HORIZON_S = 10.0
"""Longest look beyond the horizon, s: no prediction means anything behind it. Chosen by hand."""
LARGEST_PERSISTENCE_OPTION_S = 60.0
"""Longest permitted persistence, s. Chosen by hand."""


@dataclass(frozen=True)
class FoundWarnings:
    """Warnings of one host against all others.

    Attributes:
        host, config: The warned vehicle and the options.
        pairs: The evaluations, one for each of the others.
        event_ids: (pair, event) -> event id.
        rows: The warnings' states over time, as messages.
    """

    host: VehicleTrack
    config: WarningConfig
    pairs: tuple[PairEvaluation, ...]
    event_ids: Mapping[tuple[int, int], int]
    rows: WarningRows

    @property
    def events_table(self) -> Table:
        """The table with one row per event (warning)."""
        return warning_events_table(self.pairs, self.event_ids, rule=self.config.rule, clock=self.host)

    @property
    def evaluations_of_pairs_table(self) -> Table:
        """The table with one row per evaluation of a pair within reach."""
        return evaluation_series_table(self.pairs, host_id=self.host.id)

    @property
    def evaluation_counts_by_outcome(self) -> dict[str, int]:
        """Number of evaluations over all pairs, by what became of them."""
        return {
            "evaluated": sum(own.n_evaluated for own in self.pairs),
            "out_of_reach": sum(own.n_out_of_reach for own in self.pairs),
            "no_message_received_yet": sum(own.n_without_message for own in self.pairs),
            "stale": sum(own.n_stale for own in self.pairs),
            "beyond_the_predicted_path": sum(own.n_beyond_path for own in self.pairs),
            "not_finite": sum(own.n_not_finite for own in self.pairs),
            "withheld": sum(int(own.is_withheld.sum()) for own in self.pairs),
        }

    @property
    def n_withheld(self) -> int:
        """Number of warnings that were not raised because a state was starting, after a reset or in a gap."""
        return sum(own.n_withheld for own in self.pairs)

    @property
    def n_left_out(self) -> dict[WarningKind, int]:
        """Number of warnings over all pairs that were not given, by the kinds that are off; {} for most rules."""
        if not RULES[self.config.rule].leaves_out_kinds:
            return {}
        off = [kind for own in self.pairs for kind in own.n_left_out]
        return {kind: sum(own.n_left_out.get(kind, 0) for own in self.pairs) for kind in dict.fromkeys(off)}


def find_warnings(
    host: VehicleTrack, others: Sequence[VehicleTrack], config: WarningConfig | None = None
) -> FoundWarnings:
    """Evaluate a rule at every stamp of the host, and find the events.

    At each stamp the newest remote state that the host may know is brought forward along its predicted path by
    its age (`warning.remote_alignment`); the rule then judges the two paths from the same moment on.

    Args:
        others: The remote vehicles and targets. Their paths should reach `horizon_s + max_age_s`.

    Raises:
        UsageError: Unknown rule, a threshold out of range, or host paths shorter than the horizon.
    """
    config = config or WarningConfig()
    rule = _require_rule_and_horizon(host, config)
    time_s = _times_along_predicted_paths_s(host, config, rule)
    others_with_states = [other for other in others if len(other.stamp_ns) and len(host.stamp_ns)]
    pairs = evaluate_pairs(host, others_with_states, rule, config, time_s)
    ids = event_id_by_pair_and_event(pairs)
    return FoundWarnings(
        host, config, pairs, ids, warning_rows_of_pairs(pairs, ids, rule=config.rule, clock=host, words=rule.words)
    )


def check_warning_config(config: WarningConfig) -> None:
    """Check the options as far as that needs no log.

    Raises:
        UsageError: An unknown rule, or a value out of its range.
    """
    RULES.require(config.rule)
    positive = {"horizon": config.horizon_s, "distance": config.distance_m, "max age": config.max_age_s}
    for name, value in positive.items():
        if not (np.isfinite(value) and value > 0.0):
            raise UsageError(f"a {name} of {value:g} is not positive")
    if not 0.0 <= config.max_horizon_s <= LONGEST_LOOK_BEYOND_HORIZON_S:
        raise UsageError(
            f"a max horizon of {config.max_horizon_s:g} s is not between 0 and {LONGEST_LOOK_BEYOND_HORIZON_S:g} s"
        )
    if config.distance_m > LARGEST_COLLISION_DISTANCE_OPTION_M:
        raise UsageError(f"a distance of {config.distance_m:g} m is above {LARGEST_COLLISION_DISTANCE_OPTION_M:g} m")
    if not 0.0 <= config.probability <= 1.0:
        raise UsageError(f"a probability of {config.probability:g} is not between 0 and 1")
    if not (np.isfinite(config.min_deceleration_mps2) and config.min_deceleration_mps2 >= 0.0):
        raise UsageError(f"a min deceleration of {config.min_deceleration_mps2:g} m/s^2 is negative")
    for name, value in {"hold-off": config.hold_off_s, "persistence": config.persistence_s or 0.0}.items():
        if not (np.isfinite(value) and value >= 0.0):
            raise UsageError(f"a {name} of {value:g} s is negative")
    if (config.persistence_s or 0.0) > LARGEST_PERSISTENCE_OPTION_S:
        raise UsageError(f"a persistence of {config.persistence_s:g} s is above {LARGEST_PERSISTENCE_OPTION_S:g} s")
    if not (np.isfinite(config.max_lead_s) and config.max_lead_s >= 0.0):
        raise UsageError(f"a max lead of {config.max_lead_s:g} is negative")
    parse_conflict_definition(config.conflict, distance_m=config.distance_m)


def _require_rule_and_horizon(host: VehicleTrack, config: WarningConfig) -> Rule:
    """The rule of the options, which are checked; a `UsageError` if the host's paths are shorter than the horizon."""
    check_warning_config(config)
    reach = float(host.paths.time_s[-1])
    if reach < config.horizon_s - 1e-9:
        raise UsageError(
            f"the host's paths reach {reach:g} s, the rule looks {config.horizon_s:g} s ahead",
            hint=f"predict again with `--horizon {config.horizon_s:g}`",
        )
    return RULES[config.rule]


def _times_along_predicted_paths_s(host: VehicleTrack, config: WarningConfig, rule: Rule) -> FloatArray:
    """The times along the paths, (q,): the host's steps to the horizon plus the persistence time, and both ends."""
    persistence_s = rule.persistence_s if config.persistence_s is None else config.persistence_s
    step_s = float(host.paths.time_s[1])
    end_s = config.horizon_s + persistence_s
    grid = np.arange(int(end_s / step_s + 1e-6) + 1) * step_s
    grid = np.concatenate([grid, [config.horizon_s, end_s]])
    return sort_distinct_values(np.round(grid, 9))
