"""What share of the work is done: parts within parts, loops that report, and nothing where nobody follows."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from cwcli.cli.main import run_command_line
from cwcli.cli.progress import Progress
from cwcli.work_share import count_and_show_finished_work, part_of_work, report_work, report_work_share_to
from tests.cli.conftest import SAMPLES


def test_parts_lie_within_parts() -> None:
    shares: list[float] = []
    with report_work_share_to(shares.append):
        with part_of_work(0.2, 0.6), part_of_work(0.5, 1.0, "rows"):
            report_work("rows", 1, 4)
            report_work("frames", 3, 4)  # another loop that runs within this one
            report_work("rows", 1, 0)
        with part_of_work(0.6, 1.0, "passes", expected=4):
            for _ in range(6):  # more than expected
                count_and_show_finished_work("passes")
    # 0.2 + 0.4 (0.5 + 0.5 / 4), then the ends of both parts, then four quarters of 0.4
    assert shares == pytest.approx([0.45, 0.6, 0.7, 0.8, 0.9, 1.0])


def test_share_never_falls() -> None:
    shares: list[float] = []
    with report_work_share_to(shares.append):
        for _ in range(2):  # as where a search is done again
            with part_of_work(0.0, 0.5, "rows"):
                report_work("rows", 1, 2)
    assert shares == [0.25, 0.5]


def test_nothing_is_told_where_nobody_follows() -> None:
    shares: list[float] = []
    with report_work_share_to(shares.append):
        other = threading.Thread(target=report_work, args=("rows", 1, 2))
        other.start()
        other.join()
    with part_of_work(0.0, 1.0, "rows"):
        report_work("rows", 1, 2)
        count_and_show_finished_work("rows")
    assert shares == []


def test_error_in_a_part_is_passed_on_and_ends_it() -> None:
    shares: list[float] = []
    with report_work_share_to(shares.append), pytest.raises(ValueError, match="no"), part_of_work(0.0, 0.5, "rows"):
        raise ValueError("no")
    report_work("rows", 1, 2)
    assert shares == []


@pytest.mark.parametrize("log", ["intersection", "curve"])
def test_run_tells_growing_shares_and_writes_the_same(
    log: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[bytes] = []
    shares: list[float] = []
    for show in (lambda _, share: None, lambda _, share: shares.append(share)):
        monkeypatch.setattr(Progress, "show_share", show)
        target = tmp_path / f"{len(written)}.mcap"
        assert run_command_line(["run", str(SAMPLES / f"{log}.mcap"), "-o", str(target), "-q"]) == 0
        written.append(target.read_bytes())
    assert written[0] == written[1]
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    assert len(shares) >= 50
    assert max(after - before for before, after in zip([0.0, *shares], shares, strict=False)) < 0.5
