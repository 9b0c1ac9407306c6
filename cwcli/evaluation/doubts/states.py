"""Doubts about the estimated states: what nothing measured, and what their covariance does not say."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cwcli.estimation.tolerances import MAX_BRIDGED_STATE_SHARE, TOLERATED_VARIANCE_FACTOR
from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence
from cwcli.evaluation.doubts.silences import bridged_by_silent_positions_mask
from cwcli.pipeline.records import parse_json_entry_or_empty, read_finite_number_or_nan, to_float_or_nan
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import EGO_ID, SPEED, StateFlag
from cwcli.text import format_duration, format_number, shorten_and_escape

TRUTH_RULES_RECORD_KEY = "truth_rules"
"""Entry of the record of `estimate` that says by what rule the truth differs from the track, as JSON
(`cwcli.evaluation.truth_rules`)."""


def find_understated_errors(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield each quantity whose NEES is outside its bounds and too large."""
    rows = evidence.estimate_summary.rows_of_table_columns_or_empty(
        "nees", "quantity", "NEES/dof", "NEES/dof within bounds"
    )
    found = [
        (to_float_or_nan(nees), str(name))
        for name, nees, inside in rows
        if isinstance(nees, int | float) and not isinstance(nees, bool) and inside != "in"
    ]
    recorded = parse_json_entry_or_empty(evidence.records.get("estimate", {}), TRUTH_RULES_RECORD_KEY, dict)
    rules = {
        name: rule for name, rule in recorded.items() if isinstance(rule, dict) and isinstance(rule.get("text"), str)
    }
    reported: set[str] = set()
    for nees, name in sorted(found, reverse=True):
        rule = rules.get(name)
        if not TOLERATED_VARIANCE_FACTOR < nees < math.inf:
            continue
        if rule is not None:
            if rule["text"] not in reported:
                reported.add(rule["text"])
                names = [each for each, other in rules.items() if other.get("text") == rule["text"]]
                yield _finding_that_truth_differs_systematically(names, rule, nees)
        else:
            size = _truth_error_text_or_empty(evidence, name)
            yield Finding(
                nees,
                f"Compared with the true motion in the log, the {shorten_and_escape(name, 40)} is off by {size}"
                f"{math.sqrt(nees):.1f} times its own uncertainty.",
                f"Multiply the covariance of the {shorten_and_escape(name, 40)} by {nees:.2g}.",
            )


def _finding_that_truth_differs_systematically(names: Sequence[str], rule: Mapping[str, Any], nees: float) -> Finding:
    """Return the finding that a truth differs from the track by one rule, which is no fault of the covariance."""
    left = math.sqrt(max(read_finite_number_or_nan(rule, "nees_per_dof"), 0.0))
    return Finding(
        nees,
        f"The truth ({shorten_and_escape(', '.join(names), 60)}) {shorten_and_escape(rule['text'], 300)}; without that "
        f"difference the track is off by {left:.1f} times its own uncertainty.",
        shorten_and_escape(str(rule.get("advice", "")), 200),
    )


def _truth_error_text_or_empty(evidence: DoubtEvidence, quantity: str) -> str:
    """Format `0.52 deg, `, the error of a quantity against the truth; "" where the record does not say it."""
    for name, unit, sigma in evidence.estimate_summary.rows_of_table_columns_or_empty(
        "errors", "quantity", "unit", "RMS error of estimates"
    ):
        if str(name).split(" ", 1)[0] == quantity and isinstance(sigma, float) and math.isfinite(sigma):
            return f"{format_number(sigma, 2)} {shorten_and_escape(str(unit), 20)}, "
    return ""


UNDERSTATED_ERRORS_RULE = DoubtRule(
    summary="errors against the truth that exceed their covariance (NEES per degree of freedom, outside its bounds)",
    short_name="errors beyond their sigma",
    threshold=TOLERATED_VARIANCE_FACTOR,
    unit="",
    source="chosen: as in the verdict of `estimate`",
    advice="Multiply the covariance.",
    find=find_understated_errors,
    is_of_whole_log=True,
)


MAX_UNDOUBTED_STANDSTILL_WITHOUT_HEADING_SENSOR_S = 5.0
"""Greatest total time of standstill in a log, s, up to which a missing sensor of the heading is not doubted. Chosen by
hand: one or two stops at a sign take less."""
MAX_STANDSTILL_SPEED_MPS = 0.3
"""Speed in m/s below which a car stands. Chosen: fixes that scatter by 0.1 m look as fast."""
MAX_STATE_STEP_COUNTED_AS_STANDING_S = 1.0
"""Longest step between two states, s, that counts as standing. Chosen by hand; not fitted."""
HEADING_QUANTITIES = frozenset({"heading", "yaw_rate"})
"""Quantities that tell the heading, or keep it, at standstill."""


def find_unobserved_heading(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield the time for which the car stands and nothing measures its heading."""
    quantities = {str(source.get("quantity")) for source in evidence.ego_sources}
    if evidence.ego is None or not quantities or quantities & HEADING_QUANTITIES:
        return
    ego = evidence.ego.sort_by_stamp_without_repeats()
    step_s = np.diff(ego.stamp_ns) / NS_PER_S
    counted = step_s <= MAX_STATE_STEP_COUNTED_AS_STANDING_S
    is_standing = np.abs(ego.state[:-1, SPEED]) < MAX_STANDSTILL_SPEED_MPS
    standing_s, all_s = float(step_s[is_standing & counted].sum()), float(step_s[counted].sum())
    if standing_s > MAX_UNDOUBTED_STANDSTILL_WITHOUT_HEADING_SENSOR_S:
        yield Finding(
            standing_s,
            f"No sensor measures which way the car points while it stands ({format_duration(standing_s)}, "
            f"{100 * standing_s / all_s:.0f} % of the track).",
        )


UNOBSERVED_HEADING_RULE = DoubtRule(
    summary="a standstill without a sensor of heading or yaw rate",
    short_name="heading at standstill",
    threshold=MAX_UNDOUBTED_STANDSTILL_WITHOUT_HEADING_SENSOR_S,
    unit="s",
    source="chosen: a stop at a sign is shorter",
    advice="Do not use headings and predicted paths while the car stands.",
    find=find_unobserved_heading,
)


def find_large_share_of_bridged_states(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield the share of the ego's states that no position is near, but for silences that are told as such."""
    if evidence.ego is None:
        return
    is_told = bridged_by_silent_positions_mask(evidence, evidence.ego.stamp_ns)
    share = float(np.mean((evidence.ego.flags & np.uint8(StateFlag.BRIDGED) != 0) & ~is_told))
    if share > MAX_BRIDGED_STATE_SHARE:
        yield Finding(
            share,
            f"In {100 * share:.0f} % of the track no position was measured, so it is estimated from the other sensors.",
        )


BRIDGED_STATES_RULE = DoubtRule(
    summary="states that bridge gaps without a position",
    short_name="gaps without a position",
    threshold=MAX_BRIDGED_STATE_SHARE,
    unit="share",
    source="chosen: as in the verdict of `estimate`",
    advice="Do not use the states flagged bridged.",
    find=find_large_share_of_bridged_states,
)


SEVERAL_TRUTHS_NOTE_WORDS = "hold the truth"
"""Words in the note of `estimate` that several channels could be the truth, so that none was used."""
_TRUTH_OPTION_PATTERN = re.compile(r"--topic truth=[^\s,)]+")
"""An option in that note that chooses one of them."""


def find_estimate_without_truth(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield a remark if the ego was estimated and nothing tells its errors."""
    if evidence.ego is not None and not evidence.estimate_summary.rows_of_table_columns_or_empty("nees", "quantity"):
        choice = next((note for note in evidence.estimate_summary.notes if SEVERAL_TRUTHS_NOTE_WORDS in note), "")
        reason = (
            "The log has several channels of true positions"
            if choice
            else "The log has no true positions to compare with"
        )
        options = " or ".join(dict.fromkeys(_TRUTH_OPTION_PATTERN.findall(choice)))
        hint = f"; choose one with {shorten_and_escape(options)}" if options else ""
        yield Finding(0.0, f"{reason}, so the size of the errors is not known{hint}.{_own_error_text(evidence)}")


def _own_error_text(evidence: DoubtEvidence) -> str:
    """Format what the estimate itself says of its errors, as a sentence; "" where the record does not say it."""
    rows = evidence.estimate_summary.rows_of_table_columns_or_empty(
        "vehicles", "vehicle", "median position sigma per axis [m]"
    )
    sigma_m = next((value for vehicle, value in rows if vehicle == EGO_ID), None)
    if not isinstance(sigma_m, float) or not math.isfinite(sigma_m):
        return ""
    return f" cwcli itself reckons with typical errors of {format_number(sigma_m, 2)} m (position on one axis)."


NO_TRUTH_RULE = DoubtRule(
    summary="no truth of the car (a remark, not counted as a doubt)",
    threshold=1,
    unit="",
    source="one truth is enough",
    advice="Name one with --topic truth=TOPIC if it has.",
    find=find_estimate_without_truth,
    is_remark=True,
)
