"""A track that lies beside the fixes that it was made from, by more than its covariance allows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence, source_name
from cwcli.pipeline.records import Record, parse_json_entry_or_empty, read_finite_number_or_nan

MAX_UNDOUBTED_OFFSET_SIGMAS = 4.0
"""Greatest offset, in sigmas, that is not doubted. Chosen: by chance one in 3,000 two-dimensional errors is larger."""
MIN_DOUBTED_OFFSET_M = 2.0
"""Least offset from the fixes, m, that is doubted. Chosen: a car 2 m beside its place would be in another lane."""
MIN_LASTING_OFFSET_S = 2.0
"""Least duration in s of an offset that counts. Chosen: longer than an outlier, shorter than the doubted stretches."""
FIX_OFFSETS_RECORD_KEY = "fix_offsets"
"""Entry of the record of `estimate` that holds the offsets as JSON."""


def find_track_offsets_from_fixes(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield each source of positions beside which the track lies."""
    record: Record = evidence.records.get("estimate", {})
    for each in parse_json_entry_or_empty(record, FIX_OFFSETS_RECORD_KEY, list):
        if not isinstance(each, dict):
            continue
        offset_m, sigma_m, at_ns = (read_finite_number_or_nan(each, key) for key in ("offset_m", "sigma_m", "stamp_ns"))
        if not (offset_m > MIN_DOUBTED_OFFSET_M and sigma_m > 0.0 and offset_m > MAX_UNDOUBTED_OFFSET_SIGMAS * sigma_m):
            continue
        if not evidence.may_hold_stamp(at_ns):  # the log is a part of the one that was estimated
            continue
        at = f" at {max(evidence.seconds_since_start(at_ns), 0.0):.0f} s" if np.isfinite(at_ns) else ""
        yield Finding(
            offset_m / sigma_m,
            f"The track is {offset_m:.1f} m away from the measured positions of "
            f"{source_name(each).removesuffix(' position')}{at}, {offset_m / sigma_m:.0f} times its own uncertainty.",
        )


FIX_OFFSET_RULE = DoubtRule(
    summary=(
        f"a track that is away from the fixes for {MIN_LASTING_OFFSET_S:g} s, by more than {MIN_DOUBTED_OFFSET_M:g} m"
    ),
    short_name="track away from the positions",
    threshold=MAX_UNDOUBTED_OFFSET_SIGMAS,
    unit="sigma",
    source="chosen: chance gives one in 3,000",
    advice="Check the time stamps of these positions, and the other sensors against them.",
    find=find_track_offsets_from_fixes,
)
