"""The page stays small and quick however long the log and however many the vehicles; odd logs have one, too.

Ten hours with 500 vehicles, and seconds: `PYTHONPATH=. python tests/bench/bench_report.py`.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_BAD_INPUT, EXIT_MISSING_SIGNAL
from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import annotate_log
from cwcli.report.map_figure import MAX_OTHERS_ON_MAP
from cwcli.report.overview import MAX_PAGE_BYTES
from tests.bench.bench_report import MOST_BYTES, write_long
from tests.cli.browser import figures, visit
from tests.cli.conftest import SAMPLES
from tests.work import count_calls

MOST_CALLS = 5_000_000
"""Of Python and built-in functions, for the page of an hour with 500 vehicles."""


def test_a_long_log_with_many_vehicles_has_a_small_page(tmp_path: Path) -> None:
    """An hour with 500 vehicles: 72,000 states, 36,000 fixes, 300,000 states of others."""
    write_long(tmp_path / "long.mcap", hours=1.0, vehicles=500)
    arguments = ["report", str(tmp_path / "long.mcap"), "-o", str(tmp_path / "long.html"), "--quiet"]
    codes = []
    assert count_calls(lambda: codes.append(run_command_line(arguments))) < MOST_CALLS
    assert codes == [0]
    assert (tmp_path / "long.html").stat().st_size < MAX_PAGE_BYTES < MOST_BYTES
    page = (tmp_path / "long.html").read_text(encoding="utf-8")
    found = figures(page)
    assert {"log-1-map", "log-1-motion", "log-1-residuals-1"} <= set(found)
    drawn = [trace["name"] for trace in found["log-1-map"]["data"] if trace["mode"] == "lines"]  # type: ignore[attr-defined]
    assert sum(name.startswith("vehicle ") for name in drawn) == MAX_OTHERS_ON_MAP
    assert f"{500 - MAX_OTHERS_ON_MAP} of 500 other vehicles are not on the map" in page
    visited = visit(tmp_path / "long.html", tmp_path)
    assert 'data-plots="drawn"' in visited.dom and visited.console == ()


def test_an_empty_a_foreign_and_a_damaged_log_have_one_line_and_no_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Log.open(SAMPLES / "straight.mcap") as log:
        annotate_log(log, [], {}, tmp_path / "foreign.mcap")
    (tmp_path / "empty.mcap").write_bytes(b"")
    assert run_command_line(["run", str(SAMPLES / "straight.mcap"), "-o", str(tmp_path / "whole.mcap"), "--quiet"]) == 0
    whole = (tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    for name, code in (("foreign", EXIT_MISSING_SIGNAL), ("empty", EXIT_BAD_INPUT), ("cut", EXIT_BAD_INPUT)):
        capsys.readouterr()
        assert run_command_line(["report", str(tmp_path / f"{name}.mcap"), "-o", str(tmp_path / "r.html")]) == code, (
            name
        )
        assert capsys.readouterr().err.count("error: ") == 1
        assert not (tmp_path / "r.html").exists()


def test_what_is_intact_of_a_damaged_log_has_a_page(tmp_path: Path) -> None:
    assert run_command_line(["run", str(SAMPLES / "straight.mcap"), "-o", str(tmp_path / "whole.mcap"), "--quiet"]) == 0
    whole = (tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[:-2000])  # the summary is gone, and the records of the run
    assert (
        run_command_line(["report", str(tmp_path / "cut.mcap"), "-o", str(tmp_path / "r.html"), "--recover", "--quiet"])
        == 0
    )
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "log-1-map" in page
