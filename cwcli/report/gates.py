"""Gates over the run's headline metrics, as `cwcli evaluate` judges them, in words for the page."""

from __future__ import annotations

from collections.abc import Sequence

from cwcli.digest.story import Badge
from cwcli.metrics.gates import CheckStatus, GateResult
from cwcli.report.page import GateView
from cwcli.text import format_count

MAX_LISTED_CHECKS = 5
"""The greatest number of compared values that are listed for a gate. Chosen by hand; not fitted."""
BADGE_BY_STATUS = {
    CheckStatus.PASSED: Badge("passed", "good"),
    CheckStatus.FAILED: Badge("failed", "bad"),
    CheckStatus.SKIPPED: Badge("not judged", "plain"),
}
"""The badge of each gate status."""


def build_gate_views(results: Sequence[GateResult]) -> list[GateView]:
    """Build the gates' rows for the page, failed gates first."""
    ordered = sorted(results, key=lambda result: result.status is not CheckStatus.FAILED)
    return [GateView(result.gate, BADGE_BY_STATUS[result.status], _format_check_details(result)) for result in ordered]


def gate_badges_of_log(results: Sequence[GateResult], log: str) -> list[Badge]:
    """Return the badge of the gates' verdict on one log; [] if no gate is about it."""
    checks = [check for result in results for check in result.checks if check.log == log]
    failed = sum(check.status is CheckStatus.FAILED for check in checks)
    if failed:
        return [Badge(f"{format_count(failed, 'gate')} failed", "bad")]
    return [Badge("gates passed", "good")] if any(check.status is CheckStatus.PASSED for check in checks) else []


def gate_badge_of_run(results: Sequence[GateResult]) -> Badge:
    """Return the badge of the gates' verdict on the run."""
    failed = sum(result.status is CheckStatus.FAILED for result in results)
    if failed:
        return Badge(f"{failed} of {format_count(len(results), 'gate')} failed", "bad")
    if not results:
        return Badge("no gates set", "plain")
    passed = sum(result.status is CheckStatus.PASSED for result in results)
    return Badge(f"{passed} of {format_count(len(results), 'gate')} passed", "good")


def _format_check_details(result: GateResult) -> str:
    """Format the values that were compared, of the failed checks if there are any."""
    failed = result.failed_checks
    texts = [f"{check.log}: {check.detail}" if check.log else check.detail for check in failed or result.checks]
    text = "; ".join(texts[:MAX_LISTED_CHECKS])
    if len(texts) > MAX_LISTED_CHECKS:
        text += f"; and {len(texts) - MAX_LISTED_CHECKS} more"
    return (
        f"failed for {len(failed)} of {format_count(len(result.checks), 'log')}: {text}"
        if len(result.checks) > 1 and failed
        else text
    )
