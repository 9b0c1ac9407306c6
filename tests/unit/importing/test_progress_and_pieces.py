"""What an import tells of its progress, and tables whose pieces are joined while they are read."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from cwcli.importing import load
from cwcli.importing.bounded_import import ShareReport, import_files, open_pipe_for_shares
from cwcli.importing.readers import delimited
from cwcli.importing.run import plan_import
from cwcli.importing.tables import Answers


def table(folder: Path, n: int) -> str:
    clock = [f"2024-03-09T{k // 36000:02d}:{k // 600 % 60:02d}:{k % 600 / 10:04.1f}Z" for k in range(n)]
    rows = [f"{time},{k},{48 + k * 1e-6:.6f},11,{k % 7}" for k, time in enumerate(clock)]
    (folder / "drive.csv").write_text("\n".join(["time,n,lat,lon,speed_mps", *rows]))
    return str(folder / "drive.csv")


def test_import_tells_growing_shares_up_to_the_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shares: list[float] = []
    path = table(tmp_path, 30_000)
    import_files(
        [path], Answers(), str(tmp_path / "log.mcap"), progress=lambda done, total: shares.append(done / total)
    )
    time.sleep(0.1)
    assert all(0.0 <= share <= 1.0 for share in shares)
    assert shares == sorted(shares)


def test_share_report_passes_shares_of_reading_and_writing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cwcli.importing.bounded_import.PROGRESS_REPORT_INTERVAL_S", 0.01)
    shares: list[float] = []
    is_whole = threading.Event()

    def keep(done: float, total: float) -> None:
        shares.append(done / total)
        if done == total:
            is_whole.set()

    path = table(tmp_path, 1000)
    descriptor = open_pipe_for_shares(keep)
    report = ShareReport(descriptor, 0.4)
    with report.report_reading_progress_of_files([path]), Path(path).open("rb") as file:
        file.seek(Path(path).stat().st_size // 2)
        time.sleep(0.2)
    time.sleep(0.05)
    report.report_share(0.7)
    time.sleep(0.05)
    report.report_share(1.0)
    assert is_whole.wait(5.0)
    os.close(descriptor)
    assert min(abs(share - 0.2) for share in shares) < 0.01  # half of what is read
    assert 0.7 in shares


def test_a_report_without_a_reader_does_nothing(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    ShareReport(writing, 0.1).report_share(0.5)
    os.close(writing)
    ShareReport(None, 0.1).report_share(0.5)


def test_joined_pieces_are_the_same_columns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = table(tmp_path, 5000)
    whole = plan_import([path], Answers())
    monkeypatch.setattr(delimited, "BYTES_PARSED_AT_ONCE", 4096)
    monkeypatch.setattr(load, "MIN_ROWS_TO_JOIN_COLUMN_PIECES", 300)
    pieces = plan_import([path], Answers())
    for (_, one), (_, other) in zip(whole.channels, pieces.channels, strict=True):
        np.testing.assert_array_equal(one.log_time_ns, other.log_time_ns)
        for name, values in one.fields.items():
            if isinstance(values, np.ndarray):
                np.testing.assert_array_equal(values, other.fields[name])
