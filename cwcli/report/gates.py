"""Gates over the run's headline metrics, as `cwcli evaluate` judges them, in words for the page."""

from __future__ import annotations

from collections.abc import Sequence

from cwcli.metrics.gates import GateResult, Status
from cwcli.report.page import GateView
from cwcli.report.story import Badge
from cwcli.text import count

MAX_DETAILS = 5
BADGES = {
    Status.PASSED: Badge("passed", "good"),
    Status.FAILED: Badge("failed", "bad"),
    Status.SKIPPED: Badge("not judged", "plain"),
}


def gate_views(results: Sequence[GateResult]) -> list[GateView]:
    """The gates for the page, the failed ones first."""
    ordered = sorted(results, key=lambda result: result.status is not Status.FAILED)
    return [GateView(result.gate, BADGES[result.status], _details(result)) for result in ordered]


def badges_of_log(results: Sequence[GateResult], log: str) -> list[Badge]:
    """The gates' verdict on one log; gates on the run as a whole count for none."""
    checks = [check for result in results for check in result.checks if check.log == log]
    failed = sum(check.status is Status.FAILED for check in checks)
    if failed:
        return [Badge(f"{count(failed, 'gate')} failed", "bad")]
    return [Badge("gates passed", "good")] if any(check.status is Status.PASSED for check in checks) else []


def badge_of_run(results: Sequence[GateResult]) -> Badge:
    """The gates' verdict on the run."""
    failed = sum(result.status is Status.FAILED for result in results)
    if failed:
        return Badge(f"{failed} of {count(len(results), 'gate')} failed", "bad")
    if not results:
        return Badge("no gates set", "plain")
    passed = sum(result.status is Status.PASSED for result in results)
    return Badge(f"{passed} of {count(len(results), 'gate')} passed", "good")


def _details(result: GateResult) -> str:
    """The values that were compared: of the failed checks, or of a few."""
    failed = result.failed
    told = [f"{check.log}: {check.detail}" if check.log else check.detail for check in failed or result.checks]
    text = "; ".join(told[:MAX_DETAILS])
    if len(told) > MAX_DETAILS:
        text += f"; and {len(told) - MAX_DETAILS} more"
    return (
        f"failed for {len(failed)} of {count(len(result.checks), 'log')}: {text}"
        if len(result.checks) > 1 and failed
        else text
    )
