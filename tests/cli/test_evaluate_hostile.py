"""Names and texts made up to harm, in what `cwcli evaluate` and `compare` print and write."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from junitparser import Error, Failure, JUnitXml
from markdown_it import MarkdownIt

from cwcli.cli.junit import format_junit_xml
from cwcli.cli.main import run_command_line
from cwcli.cli.markdown import format_code, format_markdown_table
from cwcli.metrics.gates import CheckStatus, GateCheck, GateResult
from cwcli.metrics.headline import HeadlineCollector
from cwcli.metrics.pooling import LogMetrics, metric_rows_by_name

GATE = "ego.position_rmse_m < 0.5"
HOSTILE = [
    "</testcase><testcase name='x'/>",
    "]]><script>alert(1)</script>",
    '" onload="x',
    "a|b|c",
    "`rm -rf`",
    "``` ` ```",
    "\\|\\`",
    "[x](javascript:alert(1)) ![y](http://evil.example/z.png)",
    "www.evil.example @everyone #1 <!-- -->",
    "line\nfeed\r\n| forged | row |",
    "\x1b[2J\x1b]0;title\x07",
    "\u202eevil\u2066\u200f",
    "nul\x00byte",
    "lone \ud800 \udcff surrogate",
    "\ufffe\uffff\u2028\u0085",
    "&amp;&#60;b&#62;",
    "*bold* _it_ ~~no~~ $x$",
    " ",
]


def hostile_results(text: str) -> list[GateResult]:
    checks = [
        GateCheck(text, CheckStatus.FAILED, f"it failed: {text}"),
        GateCheck("good", CheckStatus.PASSED, text),
        GateCheck("", CheckStatus.SKIPPED, text),
    ]
    return [GateResult(text, tuple(checks))]


def test_junit_has_only_what_jenkins_schema_knows() -> None:
    """Elements and attributes of junit-10.xsd of Jenkins' xunit plugin, as far as they are used here."""
    known = {
        "testsuites": {"name", "tests", "failures", "errors", "disabled", "time"},
        "testsuite": {"name", "tests", "failures", "errors", "skipped", "time", "timestamp", "hostname"},
        "testcase": {"name", "classname", "time", "assertions", "status"},
        "failure": {"message", "type"},
        "skipped": {"message", "type"},
        "system-out": set(),
    }
    for element in ET.fromstring(format_junit_xml(hostile_results("x"))).iter():
        assert set(element.attrib) <= known[element.tag], element.tag


@pytest.mark.parametrize("text", HOSTILE)
def test_junit_stays_as_it_was_meant(text: str) -> None:
    data = format_junit_xml(hostile_results(text))
    parsed = JUnitXml.fromstring(data)
    (suite,) = parsed
    cases = list(suite)
    assert (parsed.tests, parsed.failures, suite.skipped, len(cases)) == (3, 1, 1, 3)
    assert [type(result) for result in cases[0].result] == [Failure]
    assert not any(isinstance(result, Error) for case in cases for result in case.result)
    decoded = data.decode()
    assert all(char.isprintable() or char == "\n" for char in decoded)
    if text.isprintable():
        assert cases[0].name == text.strip() or cases[0].name == text


class Page(HTMLParser):
    """Collects tags, attributes and text of what a Markdown renderer made."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[str] = []
        self.cells: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [name for name, _ in attrs]
        if tag == "td":
            self.cells.append("")

    def handle_data(self, data: str) -> None:
        if self.cells:
            self.cells[-1] += data


@pytest.mark.parametrize("text", HOSTILE)
def test_markdown_stays_a_table_of_text(text: str) -> None:
    source = format_markdown_table(
        ("a", "b", "c"), [(format_code(f"- {text}"), format_code(text), 1.0), ("x", format_code(f"{text}|{text}"), 2.0)]
    )
    page = Page()
    page.feed(MarkdownIt("gfm-like", {"html": True, "linkify": False}).render(source))
    assert set(page.tags) <= {"table", "thead", "tbody", "tr", "th", "td", "code"}
    assert set(page.attributes) <= {"style"}
    assert (page.tags.count("tr"), page.tags.count("td")) == (3, 6)
    assert all(char.isprintable() or char == "\n" for char in source)
    if text.isprintable() and text.strip():
        assert page.cells[1].strip() == text.strip()


@pytest.mark.parametrize("text", HOSTILE)
def test_terminal_and_files_of_a_run_with_hostile_names(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    headline = HeadlineCollector()
    headline.add_from_sums("ego.position_rmse_m", 10.0, 10.0)
    logs = (LogMetrics(text, metric_rows_by_name(headline.to_table())), LogMetrics(f"{text}2", error=text))
    from cwcli.fleet import results

    monkeypatch.setattr(results, "read_run_metrics", lambda source, **_: results.RunMetrics(text, logs, (GATE,)))
    junit, summary = tmp_path / "j.xml", tmp_path / "s.md"
    assert (
        run_command_line(
            ["evaluate", "x", "--gate", "data.read_count > 1", "--junit", str(junit), "--markdown", str(summary)]
        )
        == 1
    )
    assert run_command_line(["compare", "x", "y", "--fail-on", "missing", "--markdown", str(tmp_path / "c.md")]) == 0
    said = capsys.readouterr()
    for words in (
        said.out,
        said.err,
        summary.read_text(encoding="utf-8"),
        (tmp_path / "c.md").read_text(encoding="utf-8"),
    ):
        assert all(char.isprintable() or char == "\n" for char in words)
    # both logs fail both gates (too large, missing, failed), and the failed one is a gate of its own
    assert JUnitXml.fromfile(str(junit)).failures == 5
    page = Page()
    page.feed(MarkdownIt("gfm-like", {"html": True, "linkify": False}).render(summary.read_text(encoding="utf-8")))
    assert set(page.tags) <= {"h3", "p", "table", "thead", "tbody", "tr", "th", "td", "code"}


@pytest.mark.parametrize("text", HOSTILE)
def test_a_hostile_gate_is_refused_in_one_line(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    if "\0" in text or not text.strip():
        return
    assert run_command_line(["evaluate", "x", "--gate", text]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) <= 3
    assert all(char.isprintable() or char == "\n" for char in said)
