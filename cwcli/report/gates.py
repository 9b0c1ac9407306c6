"""Gates over the run's headline metrics, as `cwcli evaluate` judges them, in words for the page."""

from __future__ import annotations

from collections.abc import Sequence

from cwcli.metrics.gates import GateResult, Status
from cwcli.report.page import GateView
from cwcli.report.story import Badge
from cwcli.text import count

MAX_DETAILS = 5
"""The greatest number of compared values that are listed for a gate. Chosen by hand; not fitted."""
BADGES = {
    Status.PASSED: Badge("passed", "good"),
    Status.FAILED: Badge("failed", "bad"),
    Status.SKIPPED: Badge("not judged", "plain"),
}
"""The badge of each gate status."""


def gate_views(results: Sequence[GateResult]) -> list[GateView]:
    """Build the gates' rows for the page, failed gates first."""
    ordered = sorted(results, key=lambda result: result.status is not Status.FAILED)
    return [GateView(result.gate, BADGES[result.status], _details(result)) for result in ordered]


def badges_of_log(results: Sequence[GateResult], log: str) -> list[Badge]:
    """Return the badge of the gates' verdict on one log; [] if no gate is about it."""
    checks = [check for result in results for check in result.checks if check.log == log]
    failed = sum(check.status is Status.FAILED for check in checks)
    if failed:
        return [Badge(f"{count(failed, 'gate')} failed", "bad")]
    return [Badge("gates passed", "good")] if any(check.status is Status.PASSED for check in checks) else []


def badge_of_run(results: Sequence[GateResult]) -> Badge:
    """Return the badge of the gates' verdict on the run."""
    failed = sum(result.status is Status.FAILED for result in results)
    if failed:
        return Badge(f"{failed} of {count(len(results), 'gate')} failed", "bad")
    if not results:
        return Badge("no gates set", "plain")
    passed = sum(result.status is Status.PASSED for result in results)
    return Badge(f"{passed} of {count(len(results), 'gate')} passed", "good")


def _details(result: GateResult) -> str:
    """Format the values that were compared, of the failed checks if there are any."""
    failed = result.failed
    texts = [f"{check.log}: {check.detail}" if check.log else check.detail for check in failed or result.checks]
    text = "; ".join(texts[:MAX_DETAILS])
    if len(texts) > MAX_DETAILS:
        text += f"; and {len(texts) - MAX_DETAILS} more"
    return (
        f"failed for {len(failed)} of {count(len(result.checks), 'log')}: {text}"
        if len(result.checks) > 1 and failed
        else text
    )
