"""Gates as JUnit XML, the form that Jenkins, GitLab and GitHub's reporters read: one test case per gate and log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from cwcli.cli.text import escape_control_characters

if TYPE_CHECKING:
    from cwcli.metrics.gates import GateCheck, GateResult
    from cwcli.report.addresses import PageAddresses

ALL_LOGS_NAME = "all logs"
"""Name of a test case that is about all logs."""
MAX_TEST_CASE_DETAIL_CHARACTERS = 4000
"""Longest detail of a test case, in characters; chosen by hand."""


def format_junit_xml(
    results: Sequence[GateResult],
    addresses: PageAddresses | None = None,
    run_s_by_log: Mapping[str, float] | None = None,
) -> bytes:
    """Format gates as a JUnit document. Control and forbidden characters are escaped (`\\x1b`).

    Failures on warnings hold links into the page of the run, where its address is given.

    Args:
        run_s_by_log: Id of a log -> seconds that the run took for it. A log's test cases share them evenly, so that
            all times together are the run's.
    """
    checks = [check for result in results for check in result.checks]
    n_cases = Counter(check.log for check in checks)
    time_s = {log: (run_s_by_log or {}).get(log, 0.0) / n for log, n in n_cases.items()}
    totals = _status_counts(checks, time_s)
    del totals["skipped"]  # Jenkins' schema has it for suites only
    root = ET.Element("testsuites", {"name": "cwcli evaluate", **totals})
    for result in results:
        gate = escape_control_characters(result.gate)
        suite = ET.SubElement(root, "testsuite", {"name": gate, **_status_counts(result.checks, time_s)})
        for check in result.checks:
            _add_test_case(suite, result.gate, check, time_s[check.log], addresses)
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return text + b"\n"


def _add_test_case(
    suite: ET.Element, gate: str, check: GateCheck, time_s: float, addresses: PageAddresses | None
) -> None:
    case = ET.SubElement(
        suite,
        "testcase",
        classname=escape_control_characters(gate),
        name=escape_control_characters(check.log) or ALL_LOGS_NAME,
        time=_format_seconds(time_s),
    )
    detail = escape_control_characters(check.detail)[:MAX_TEST_CASE_DETAIL_CHARACTERS]
    if check.status.value == "failed":
        links = [] if addresses is None else addresses.warning_and_conflict_links_of_check(gate, check)
        lines = (detail, *(f"{escape_control_characters(link.words)}: {link.address}" for link in links))
        ET.SubElement(case, "failure", message=detail, type="gate").text = "\n".join(lines)
    elif check.status.value == "skipped":
        ET.SubElement(case, "skipped", message=detail)
    else:
        ET.SubElement(case, "system-out").text = detail


def _format_seconds(time_s: float) -> str:
    """Format seconds to a tenth of a millisecond, without an exponent, which Jenkins' schema does not take."""
    return f"{time_s:.4f}" if time_s else "0"


def _status_counts(checks: Sequence[GateCheck], time_s: Mapping[str, float]) -> dict[str, str]:
    statuses = [check.status.value for check in checks]
    return {
        "tests": str(len(checks)),
        "failures": str(statuses.count("failed")),
        "errors": "0",
        "skipped": str(statuses.count("skipped")),
        "time": _format_seconds(sum(time_s[check.log] for check in checks)),
    }
