"""Getting about in a report: names that a rerun keeps, links to them, and one moment marked in all figures."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from xml.etree import ElementTree

import pytest

from cwcli.cli.main import run_command_line
from cwcli.report import addresses
from cwcli.report.addresses import LinkTarget, PageAddresses, compare_warnings_of_runs
from cwcli.report.pairs import stable_anchor_names
from cwcli.report.source import LogEntry
from tests.cli.browser import Elements, figures, visit
from tests.cli.conftest import SAMPLES

POINT = """
<script>
(async () => {
  while (document.documentElement.dataset.plots !== "drawn") { await new Promise((done) => setTimeout(done, 50)); }
  const motion = document.querySelector(".plot.motion"), size = motion._fullLayout._size;
  const box = motion.getBoundingClientRect();
  motion.dispatchEvent(new MouseEvent("mousemove", { clientX: box.left + size.l + motion._fullLayout.xaxis.d2p(5.0) }));
  const isShown = (each) => each.style.display === "block";
  const here = [...document.querySelectorAll(".plot.map > .cursor.here")].filter(isShown);
  const map = document.querySelector(".plot.map"), shift = map._fullLayout._size;
  document.body.dataset.here = JSON.stringify(here.map((each) => [
    map._fullLayout.xaxis.p2d(parseFloat(each.style.left) - shift.l),
    map._fullLayout.yaxis.p2d(parseFloat(each.style.top) - shift.t)]));
  document.body.dataset.lines = [...document.querySelectorAll(".cursor.at")].filter(isShown).length;
})();
</script>
"""


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("annotated") / "intersection.mcap"
    assert run_command_line(["run", str(SAMPLES / "intersection.mcap"), "-o", str(target), "--quiet"]) == 0
    return target


def report(annotated: Path, target: Path) -> str:
    assert run_command_line(["report", str(annotated), "-o", str(target), "--quiet"]) == 0
    return target.read_text(encoding="utf-8")


def test_names_tell_others_rules_and_repetitions_apart_and_keep_when_more_follow() -> None:
    first = stable_anchor_names("a.mcap", "warning", [("cwcli", "17"), ("cwcli", "18"), ("cwcli", "17")])
    assert len(set(first)) == 3 and all(re.fullmatch("warning-[0-9a-f]{4,}", name) for name in first)
    assert stable_anchor_names("a.mcap", "warning", [("cwcli", "17"), ("ttc", "17")])[0] == first[0]
    assert stable_anchor_names("b.mcap", "warning", [("cwcli", "17")])[0] != first[0]
    many = stable_anchor_names("a.mcap", "warning", [("cwcli", str(n)) for n in range(2000)])  # some share four digits
    assert len(set(many)) == 2000 and max(map(len, many)) > len("warning-0000")


def test_a_warning_has_an_address_that_another_version_s_rerun_keeps(annotated: Path, tmp_path: Path) -> None:
    page = report(annotated, tmp_path / "report.html")
    (name,) = stable_anchor_names("intersection.mcap", "warning", [("cwcli", "d9583520")])
    (conflict,) = stable_anchor_names("intersection.mcap", "conflict", [("d9583520",)])
    assert [each["id"] for each in Elements(page).of("tr") if "id" in each] == [conflict]
    assert [each["id"] for each in Elements(page).of("section") if each.get("class") == "event"] == [name]
    links = [each["href"] for each in Elements(page).of("a")]
    assert f"#{name}" in links
    anchors = {attributes["id"] for _, attributes in Elements(page).found if "id" in attributes}
    assert {link.removeprefix("#") for link in links if link.startswith("#")} <= anchors
    later = tmp_path / "later/intersection.mcap"
    later.parent.mkdir()
    arguments = ["--quiet", "--estimate-latency", "none"]  # the warning comes at another moment
    assert run_command_line(["run", str(SAMPLES / "intersection.mcap"), "-o", str(later), *arguments]) == 0
    of_later = report(later, tmp_path / "later.html")
    assert f'id="{name}"' in of_later and f'id="{conflict}"' in of_later


def test_failed_gates_link_to_warnings_in_the_report_of_the_same_run(tmp_path: Path) -> None:
    """The intersection has one warning and one conflict, the straight road neither."""
    logs = [str(SAMPLES / f"{name}.mcap") for name in ("intersection", "straight")]
    assert run_command_line(["run", *logs, "-d", str(tmp_path / "out"), "--jobs", "1", "--quiet"]) == 0
    anchors = {
        each["id"] for _, each in Elements(report(tmp_path / "out", tmp_path / "report.html")).found if "id" in each
    }
    files = ["--junit", str(tmp_path / "gates.xml"), "--markdown", str(tmp_path / "gates.md")]
    gates = [
        "--gate",
        "warnings.precision < 0.5",
        "--gate",
        "pooled(warnings.recall) < 0.5",
        "--gate",
        "data.faults_count < 0",
    ]
    page = ["--report-at", "reports (new)/report.html"]
    assert (
        run_command_line(["evaluate", str(tmp_path / "out"), *gates, *files, *page, "--allow-missing", "--quiet"]) == 1
    )
    link = re.compile(r"reports%20%28new%29/report\.html#([\w-]+)")
    cases = {
        (case.get("classname"), case.get("name")): link.findall(case.findtext("failure") or "")
        for case in ElementTree.parse(tmp_path / "gates.xml").iter("testcase")
    }
    (warning,) = stable_anchor_names("intersection", "warning", [("cwcli", "d9583520")])
    assert warning in anchors
    assert cases["warnings.precision < 0.5", "intersection"] == [warning]
    assert cases["pooled(warnings.recall) < 0.5", "all logs"] == [warning]
    assert cases["data.faults_count < 0", "intersection"] == []
    told = (tmp_path / "gates.md").read_text(encoding="utf-8")
    assert link.findall(told) == [warning, warning]
    assert f"](reports%20%28new%29/report.html#{warning})" in told


def test_links_need_logs_that_can_be_read_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "metrics.parquet").write_bytes(b"")
    for source in ("-", str(tmp_path / "metrics.parquet")):
        assert run_command_line(["evaluate", source, "--report-at", "report.html"]) == 2
        assert "--report-at needs the annotated logs as files" in capsys.readouterr().err
    assert run_command_line(["evaluate", str(SAMPLES / "intersection.mcap"), "--report-at", " "]) == 2
    assert "names no page" in capsys.readouterr().err


OUT_OF_SIGHT = """
<script>
(async () => {
  while (document.documentElement.dataset.plots !== "drawn") { await new Promise((done) => setTimeout(done, 50)); }
  for (const each of document.querySelectorAll("details")) { each.open = true; }
  const cut = [...document.querySelectorAll(".scroll")].filter((each) => each.scrollWidth > each.clientWidth + 1);
  document.body.dataset.cut = cut.map((each) => each.textContent.trim().slice(0, 20)).join("|");
  document.body.dataset.wide = document.documentElement.scrollWidth - document.documentElement.clientWidth;
  const box = (each) => each.getBoundingClientRect();
  document.body.dataset.overlaps = [...document.querySelectorAll(".plot")].filter((plot) => {
    const legend = plot.querySelector(".legend"), title = plot.querySelector(".g-xtitle, .g-x2title, .g-x3title");
    return legend && title && box(legend).top < box(title).bottom - 1 && box(title).height;
  }).length;
})();
</script>
"""


@pytest.mark.parametrize("size", ["500,900", "1280,900"])
def test_no_column_is_out_of_sight_and_no_legend_on_a_title(annotated: Path, tmp_path: Path, size: str) -> None:
    """At 1280 pixels and at the least width of the browser's windows, where the page is that of a phone."""
    page = report(annotated, tmp_path / "report.html")
    policy = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')
    changed = policy.sub("", page).replace("</body>", f"{OUT_OF_SIGHT}</body>")
    (tmp_path / "measured.html").write_text(changed, encoding="utf-8")
    (body,) = Elements(visit(tmp_path / "measured.html", tmp_path, size=size).dom).of("body")
    assert (body["data-cut"], body["data-wide"], body["data-overlaps"]) == ("", "0", "0")


ARRANGE = """
<script>
(async () => {
  while (document.documentElement.dataset.plots !== "drawn") { await new Promise((done) => setTimeout(done, 50)); }
  const table = document.querySelector("table.logs"), heads = [...table.rows[0].cells];
  const shown = () => [...table.rows].slice(1).filter((row) => !row.hidden);
  const names = () => shown().map((row) => row.cells[0].textContent).join();
  const told = [names()], duration = heads.findIndex((cell) => cell.textContent.startsWith("duration"));
  heads[duration].querySelector("button").click();
  told.push(names());
  heads[duration].querySelector("button").click();
  told.push(names());
  const find = document.querySelector("input.find");
  find.value = "vehicle  D9583520";
  find.dispatchEvent(new Event("input", { bubbles: true }));
  told.push(names());
  const set = (name, value) => {
    const field = document.querySelector(".filters " + name);
    field.value = value;
    field.dispatchEvent(new Event("input", { bubbles: true }));
    return field;
  };
  set(".find", "");
  const verdict = document.querySelector(".filters .verdict");
  document.body.dataset.verdicts = [...verdict.options].map((each) => each.textContent).join(";");
  set(".verdict", [...verdict.options].find((each) => each.value.includes("no warnings computed")).value);
  told.push(names());
  set(".verdict", "");
  set(".column", String(duration));
  set(".least", "15");
  told.push(names());
  set(".most", "30");
  told.push(names());
  document.body.dataset.shown = document.querySelector(".filters output").textContent;
  document.body.dataset.told = told.join(";");
})();
</script>
"""


def test_the_table_of_all_logs_is_sorted_searched_and_filtered(tmp_path: Path) -> None:
    """Of 10, 22 and 36 s; one could not be processed, and has no duration: it comes last both ways."""
    (tmp_path / "broken.mcap").write_bytes(b"no log")
    logs = [str(SAMPLES / f"{name}.mcap") for name in ("curve", "intersection", "straight")]
    code = run_command_line(
        ["run", *logs, str(tmp_path / "broken.mcap"), "-d", str(tmp_path / "out"), "--jobs", "1", "--quiet"]
    )
    assert code != 0
    page = report(tmp_path / "out", tmp_path / "report.html")
    policy = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')
    changed = policy.sub("", page).replace("</body>", f"{ARRANGE}</body>")
    (tmp_path / "arranged.html").write_text(changed, encoding="utf-8")
    (body,) = Elements(visit(tmp_path / "arranged.html", tmp_path).dom).of("body")
    first, up, down, found, of_verdict, long, middling = body["data-told"].split(";")
    assert first == "broken,intersection,curve,straight"
    assert up == "intersection,straight,curve,broken"
    assert down == "curve,straight,intersection,broken"
    assert found == "intersection"
    assert "✗ the run failed" in body["data-verdicts"].split(";")
    assert of_verdict == "curve,straight"  # in the order that the table was sorted to
    assert (long, middling) == ("curve,straight", "straight")
    assert body["data-shown"] == "1 of 4 logs"


def test_pointing_at_a_moment_marks_it_on_the_map_and_in_all_curves(annotated: Path, tmp_path: Path) -> None:
    """A copy of the page with a script that points, without the policy that would forbid it."""
    page = report(annotated, tmp_path / "report.html")
    policy = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')
    (tmp_path / "pointed.html").write_text(policy.sub("", page).replace("</body>", f"{POINT}</body>"), encoding="utf-8")
    seen = visit(tmp_path / "pointed.html", tmp_path)
    (body,) = Elements(seen.dom).of("body")
    over_time = [
        kind for name in figures(page) for kind in ("motion", "errors", "distance", "residuals") if f"-{kind}" in name
    ]
    assert int(body["data-lines"]) == len(over_time) >= 2
    here = [tuple(map(float, pair)) for pair in re.findall(r"\[([-\d.e]+),([-\d.e]+)\]", body["data-here"])]
    # The ego drives north at 9 m/s, the other comes from the east towards the crossing at (0, 67), by the scenario
    assert any(abs(x) < 1.0 and 40.0 < y < 50.0 for x, y in here)
    assert any(x > 10.0 and 60.0 < y < 75.0 for x, y in here)


def test_compare_links_to_the_warnings_that_differ(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The earlier run had no stage that warns."""
    for name, options in (("few", ["--stage", "estimate,predict"]), ("all", [])):
        logs = [str(SAMPLES / f"{each}.mcap") for each in ("intersection", "straight")]
        assert run_command_line(["run", *logs, "-d", str(tmp_path / name), "--jobs", "1", "--quiet", *options]) == 0
    (warning,) = stable_anchor_names("intersection", "warning", [("cwcli", "d9583520")])
    (conflict,) = stable_anchor_names("intersection", "conflict", [("d9583520",)])
    few, every = str(tmp_path / "few"), str(tmp_path / "all")
    capsys.readouterr()
    at = ["--report-at", "r.html"]
    assert run_command_line(["compare", few, every, *at, "--json", "--markdown", str(tmp_path / "c.md")]) == 0
    told = json.loads(capsys.readouterr().out)["warnings"]
    assert [(each["change"], each["address"]) for each in told["listed"]] == [
        ("new", f"r.html#{warning}"),
        ("gone", ""),
    ]
    assert told["count"] == 2
    text = (tmp_path / "c.md").read_text(encoding="utf-8")
    assert f"- new: [`intersection: warning 1, vehicle d9583520: came true, 2.4 s ahead`](r.html#{warning})" in text
    assert "- gone: `intersection: conflict with vehicle d9583520: not warned of`" in text
    assert f'id="{warning}"' in report(tmp_path / "all", tmp_path / "r.html")

    assert run_command_line(["compare", every, few, *at]) == 0  # on the terminal, the other way round
    shown = capsys.readouterr().out
    assert f"r.html#{conflict}" in shown
    assert re.search("gone +intersection: warning 1", shown)
    assert run_command_line(["compare", every, every, *at, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["warnings"] == {
        "listed": [],
        "count": 0,
        "logs": 2,
        "logs_unread": [],
        "logs_left_out": 0,
    }
    one, other = (str(tmp_path / name / "logs" / "intersection" / "annotated.mcap") for name in ("few", "all"))
    (own,) = stable_anchor_names("annotated.mcap", "warning", [("cwcli", "d9583520")])
    assert run_command_line(["compare", one, other, *at, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["warnings"]["listed"][0]["address"] == f"r.html#{own}"
    assert run_command_line(["compare", "-", every, *at]) == 2


def test_a_warning_with_another_verdict_is_told_with_both(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = {
        "a.mcap": [("warning-1", "false alarm"), ("warning-2", "came true"), ("warning-3", "came true")],
        "b.mcap": [("warning-1", "came too late"), ("warning-2", "came true"), ("conflict-9", "not warned of")],
    }

    def marked(self: PageAddresses, entry: LogEntry, name: str = "") -> list[LinkTarget]:
        return [LinkTarget(mark, f"{mark} is {verdict}", verdict) for mark, verdict in found[entry.name]]

    for name in found:
        (tmp_path / name).write_bytes((SAMPLES / "straight.mcap").read_bytes())
    monkeypatch.setattr(PageAddresses, "read_warning_and_conflict_anchors", marked)
    early, late = (PageAddresses(str(tmp_path / name), "https://ci/r.html") for name in found)
    found_differing = compare_warnings_of_runs(early, late)
    assert [(each.change, each.words, each.address) for each in found_differing.listed] == [
        ("new", "conflict-9 is not warned of", "https://ci/r.html#conflict-9"),
        ("other", "warning-1 is came too late (before: false alarm)", "https://ci/r.html#warning-1"),
        ("gone", "warning-3 is came true", ""),
    ]
    assert (found_differing.n, found_differing.n_logs) == (3, 1)


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two logs, the first of which has a warning."""
    folder = tmp_path_factory.mktemp("both") / "run"
    logs = [str(SAMPLES / f"{each}.mcap") for each in ("intersection", "straight")]
    assert run_command_line(["run", *logs, "-d", str(folder), "--jobs", "1", "--quiet"]) == 0
    return folder


@pytest.mark.parametrize("harm", ["missing", "damaged"])
def test_a_log_that_can_not_be_read_is_named_and_its_warnings_are_neither_new_nor_gone(
    both: Path, harm: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    harmed = tmp_path / "harmed"
    shutil.copytree(both, harmed)
    annotated = harmed / "logs/intersection/annotated.mcap"
    annotated.unlink() if harm == "missing" else annotated.write_bytes(b"nothing")
    note = "warnings are not compared of 1 log that failed or whose annotated log can't be read: intersection"
    for early, late in ((both, harmed), (harmed, both)):
        capsys.readouterr()
        markdown = tmp_path / "c.md"
        arguments = ["compare", str(early), str(late), "--report-at", "r.html", "--markdown", str(markdown), "--force"]
        assert run_command_line([*arguments, "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["warnings"] == {
            "listed": [],
            "count": 0,
            "logs": 1,
            "logs_unread": ["intersection"],
            "logs_left_out": 0,
        }
        assert note in markdown.read_text(encoding="utf-8")
        assert run_command_line(arguments) == 0
        assert " ".join(capsys.readouterr().err.split()).count(note) == 1


def test_the_first_logs_in_both_runs_are_compared_and_the_others_counted(
    both: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first log of the candidate is in no other run, so the second one is the first that is in both."""
    monkeypatch.setattr(addresses, "MAX_LOGS_READ_FOR_LINKS", 1)
    assert run_command_line(["compare", str(both), str(both), "--report-at", "r.html"]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "warnings are compared of the first 1 of 2 logs in both" in said
    one = tmp_path / "one"
    assert run_command_line(["run", str(SAMPLES / "straight.mcap"), "-d", str(one), "--jobs", "1", "--quiet"]) == 0
    differing = compare_warnings_of_runs(PageAddresses(str(one), "r.html"), PageAddresses(str(both), "r.html"))
    assert (differing.n_logs, differing.unread, differing.n_left_out) == (1, (), 0)
