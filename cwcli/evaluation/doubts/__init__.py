"""The doubts: reasons not to believe the results on a log, one file each or each family, and one line each here.

The table is in order of weight: the first kind spoils most, and what cwcli has repaired comes last. Other packages add
theirs in the group `cwcli.doubts`.
The digest, the page, the table of a fleet and the metric `doubts.count` take them from here.
"""

from __future__ import annotations

from collections.abc import Iterable

from cwcli.evaluation.doubts.base import Doubt, DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence, read_evidence
from cwcli.logs.read.reader import Log
from cwcli.registry import Registry, accept_dataclass_of


def _check_findings(found: Iterable[Finding], evidence: DoubtEvidence) -> list[Finding]:
    """Check what a plug-in's rule found, and return it.

    Raises:
        TypeError: It is not an iterable of `Finding`s.
    """
    findings = list(found)
    for each in findings:
        if not isinstance(each, Finding):
            raise TypeError(f"a {type(each).__name__}, no Finding")
    return findings


DOUBT_RULES: Registry[DoubtRule] = Registry(
    "doubt",
    "cwcli.doubts",
    {
        "contradiction": "cwcli.evaluation.doubts.sources:CONTRADICTION_RULE",
        "speed": "cwcli.evaluation.doubts.implausible:SPEED_RULE",
        "acceleration": "cwcli.evaluation.doubts.implausible:ACCELERATION_RULE",
        "lateral-acceleration": "cwcli.evaluation.doubts.implausible:LATERAL_ACCELERATION_RULE",
        "fixes": "cwcli.evaluation.doubts.fixes:FIX_OFFSET_RULE",
        "errors": "cwcli.evaluation.doubts.states:UNDERSTATED_ERRORS_RULE",
        "gated": "cwcli.evaluation.doubts.sources:GATED_SOURCES_RULE",
        "heading": "cwcli.evaluation.doubts.states:UNOBSERVED_HEADING_RULE",
        "noise": "cwcli.evaluation.doubts.sources:UNDERSTATED_NOISE_RULE",
        "resets": "cwcli.evaluation.doubts.sources:RESETS_RULE",
        "camera": "cwcli.evaluation.doubts.camera:ASSUMED_CAMERA_RULE",
        "times": "cwcli.evaluation.doubts.recording:LOG_TIME_HOLES_RULE",
        "silence": "cwcli.evaluation.doubts.silences:SILENCE_RULE",
        "gaps": "cwcli.evaluation.doubts.states:BRIDGED_STATES_RULE",
        "late": "cwcli.evaluation.doubts.recording:LATE_STATES_RULE",
        "rejected": "cwcli.evaluation.doubts.recording:REJECTED_MESSAGES_RULE",
        "damaged": "cwcli.evaluation.doubts.recording:DAMAGED_FILE_RULE",
        "correction": "cwcli.evaluation.doubts.sources:CORRECTION_RULE",
        "no-truth": "cwcli.evaluation.doubts.states:NO_TRUTH_RULE",
    },
    accept_dataclass_of(DoubtRule, {"find": _check_findings}),
)


def find_doubts(log: Log) -> tuple[Doubt, ...]:
    """Find the doubts about the results on a log, on disk or in memory; the worst comes first.

    Raises:
        InputError: The log is damaged.
        DataError: The ego's states were written by another version.
    """
    return find_doubts_in_evidence(read_evidence(log))


def find_doubts_in_evidence(evidence: DoubtEvidence) -> tuple[Doubt, ...]:
    """Find the doubts in what is known of a log; the worst comes first."""
    return _find_doubts_or_remarks_by_rules(evidence, remarks=False)


def find_remarks_in_evidence(evidence: DoubtEvidence) -> tuple[Doubt, ...]:
    """Find what limits the knowledge of the results without making them doubtful, such as a missing truth."""
    return _find_doubts_or_remarks_by_rules(evidence, remarks=True)


def _find_doubts_or_remarks_by_rules(evidence: DoubtEvidence, *, remarks: bool) -> tuple[Doubt, ...]:
    """Apply the rules that find remarks, or the others."""
    found = [
        doubt
        for name, rule in DOUBT_RULES.items()
        if rule.is_remark is remarks
        for doubt in rule.find_doubts(name, evidence)
    ]
    return tuple(sorted(found, key=lambda doubt: doubt.is_repaired))
