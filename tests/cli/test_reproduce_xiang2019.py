"""`cwcli reproduce xiang2019`: its tables, its JSON, its metrics file, what it refuses."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import pytest

from cwcli.cli.main import run_command_line
from cwcli.reproduction.classes import CLASS_MEANINGS, NOT_IN_PAPER
from cwcli.reproduction.expectations import load_expectations
from tests.cli.conftest import Run


def test_every_number_stands_beside_the_paper_s(cwcli: Run, tmp_path: Path) -> None:
    done = cwcli("reproduce", "xiang2019", "--seeds", "100", "--json", "--metrics", "x.csv")
    assert done.returncode == 0, done.stderr.decode()
    document = json.loads(done.stdout)
    assert (document["paper"], document["seeds"], document["failed"]) == ("xiang2019", 100, [])
    sections = document["sections"]
    assert [row["range_m"] for row in sections["figure_6"]] == [1.10, 3.20, 4.90, 9.30, 15.20]
    findings = {(row["figure"], row["what"]): row for row in document["findings"]}
    cells = [
        findings["table 1", f"{segment}, {axis}, UKF: mean square error"]
        for segment in ("line", "arc", "weave", "turn")
        for axis in "xy"
    ]
    assert [row["paper"] for row in cells] == [1.91, 5.31, 3.12, 3.14, 2.61, 5.14, 4.33, 5.74]
    assert not any(figure == "table 2" for figure, _ in findings)  # times get no class
    assert len(sections["verdict"]) >= 5
    with (tmp_path / "x.csv").open() as stream:
        rows = {(row["figure"], row["what"]): row for row in csv.DictReader(stream)}
    assert len(rows) == len(findings)
    assert float(rows["table 1", cells[0]["what"]]["ours"]) == pytest.approx(cells[0]["ours"])


def test_one_figure_alone(cwcli: Run, tmp_path: Path) -> None:
    done = cwcli(
        "reproduce", "xiang2019", "--only", "Fig7", "--only", "fig6", "--seeds", "100", "--plots", "figures", "--json"
    )
    assert done.returncode == 0, done.stderr.decode()
    document = json.loads(done.stdout)
    assert {row["figure"] for row in document["findings"]} == {"fig 6"}
    assert {"fig_7", "fig_6"} <= set(document["sections"])
    assert sorted(path.name for path in (tmp_path / "figures").iterdir()) == ["fig-6.png", "fig-7.png"]


def test_fewer_seeds_give_the_same_numbers_again(cwcli: Run) -> None:
    one, two = (json.loads(cwcli("reproduce", "xiang2019", "--seeds", "4", "--json").stdout) for _ in range(2))
    for name in ("figure_6", "table_1", "where"):
        assert one["sections"][name] == two["sections"][name]


def shown_findings(page: str) -> set[tuple[str, str]]:
    """Return each finding of a page with its class, which stands once above a table of rows of one class."""
    shown: set[tuple[str, str]] = set()
    columns: list[str] = []
    shared_class = ""
    for line in page.splitlines():
        if line.startswith("#"):
            columns, shared_class = [], ""
        elif found := re.match(r"All rows: .*?class: ([^;.]+)", line):
            shared_class = found[1]
        elif line.startswith("| "):
            cells = [cell.strip() for cell in line.split("|")[1:-1]]
            columns = columns or cells
            row = dict(zip(columns, cells, strict=True))
            shown.add((row.get("what", ""), row.get("class", shared_class)))
            shown |= {(f"{row['case']}: {column}", shared_class) for column in row if "case" in row}
        elif not line:
            columns = []
    return shown


def test_the_page_has_every_figure_and_every_number(cwcli: Run, tmp_path: Path) -> None:
    done = cwcli("reproduce", "xiang2019", "--seeds", "100", "--report", "pages", "--metrics", "x.csv", "--quiet")
    assert done.returncode == 0, done.stderr.decode()
    page = (tmp_path / "pages" / "xiang2019.md").read_text(encoding="utf-8")
    expected = load_expectations("xiang2019")
    headings = [line.removeprefix("### ") for line in page.splitlines() if line.startswith("### ")]
    assert headings == list(expected.figures)
    for figure in expected.figures.values():
        assert figure.description in page
        assert not figure.reason_for_absence or figure.reason_for_absence in page
        assert all(
            (tmp_path / "pages/figures/xiang2019" / f"{name.replace(' ', '-')}.png").exists()
            for name in figure.plot_names
        )
    with (tmp_path / "x.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in page.splitlines() if line.startswith("| ")]
    shown = shown_findings(page)
    for row in rows:
        if row["group"] and row["class"] == NOT_IN_PAPER:
            continue
        what = f"{row['what']} [{row['unit']}]" if row["unit"] else row["what"]
        assert (what, row["class"]) in shown
    counts = [cells for cells in lines if len(cells) == 5 and cells[0] in CLASS_MEANINGS]
    counted = {cells[0]: sum(map(int, cells[1:4])) for cells in counts}
    wanted = {name: sum(row["class"] == name for row in rows) for name in CLASS_MEANINGS}
    assert counted == {name: count for name, count in wanted.items() if count}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("xiang2018",), b"xiang2019"),
        (("xiang2019", "--seeds", "1"), b"--seeds"),
        (("xiang2019", "--only", "fig 99"), b"did you mean fig"),
        (("xiang2019", "--report", "a", "--only", "fig6"), b"--report has every figure"),
        (("xiang2019", "--labelled", "a.mcap"), b"--labelled"),
    ],
)
def test_what_it_refuses(cwcli: Run, options: tuple[str, ...], said: bytes) -> None:
    done = cwcli("reproduce", *options)
    assert done.returncode == 2
    assert said in done.stderr


def test_without_matplotlib_nothing_is_begun(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    for option in ("--plots", "--report"):
        assert run_command_line(["reproduce", "xiang2019", option, "figures"]) == 2
        error = capsys.readouterr().err
        assert "plots need matplotlib" in error
        assert "cwcli-drive[plots]" in error
        assert not Path("figures").exists()
