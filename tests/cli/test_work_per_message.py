"""No Python runs for each message, neither from a chunk to a kernel nor from there to the written messages."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from cwcli import lazy_dataclass
from cwcli.cli.main import run_command_line
from cwcli.logs.write import message_merge, writer
from cwcli.metrics.chi_square import chi_square_quantile
from tests.bench import make_log
from tests.bench.make_log import CAR_HZ, GNSS_HZ, IMU_HZ, WRITERS, drive
from tests.work import count_lines, growing_functions

WARM_S, SHORT_S, LONG_S = 10, 60, 120
"""Seconds of a drive after which modules are imported, and of the two drives that are compared."""
N_CARS = 4
N_MORE = (LONG_S - SHORT_S) * (IMU_HZ + GNSS_HZ + CAR_HZ * N_CARS)
"""Messages that the long drive has more than the short one."""
ALLOWANCE = (LONG_S - SHORT_S) * GNSS_HZ * 2 // 3
"""Lines by which a function may differ between the drives: two thirds of the messages that the rarest channel has more.
What runs for each batch of rows differs by up to 350."""
WITHOUT_SEARCHES = ("--latency", "none", "--sensor-model", "none")
"""Options without which searches end a step sooner or later on other drives."""


@pytest.fixture(autouse=True)
def small_logs_of_one_chunk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Logs have few cars, and one chunk each, so that work for each chunk does not grow with the drive."""
    for module in (message_merge, writer):
        monkeypatch.setattr(module, "BYTES_OF_FULL_NEW_CHUNK", 1 << 30)
    monkeypatch.setattr(message_merge, "MAX_ROWS_ENCODED_AT_ONCE", 1 << 30)
    monkeypatch.setattr(make_log, "N_CARS", N_CARS)
    monkeypatch.setattr(
        lazy_dataclass, "MAX_INSTANCES_BEFORE_COMPILATION", 0
    )  # else methods are compiled between the two drives


def lines_of_estimate(folder: Path, encoding: str, seconds: int, options: tuple[str, ...]) -> Counter[str]:
    """The lines that `estimate` of a drive executes, by function."""
    log, target = folder / "log.mcap", folder / "estimated.mcap"
    WRITERS[encoding](log, drive(seconds), images=False)
    chi_square_quantile.cache_clear()
    codes: list[int] = []
    arguments = ["estimate", str(log), "-q", "-f", "-o", str(target), *options]
    lines = count_lines(lambda: codes.append(run_command_line(arguments)))
    assert codes == [0]
    return lines


@pytest.mark.parametrize("options", [WITHOUT_SEARCHES, ()], ids=["without searches", "with searches"])
@pytest.mark.parametrize("encoding", WRITERS)
def test_estimate_runs_no_python_for_each_message(encoding: str, options: tuple[str, ...], tmp_path: Path) -> None:
    lines_of_estimate(tmp_path, encoding, WARM_S, options)
    short, long = (lines_of_estimate(tmp_path, encoding, seconds, options) for seconds in (SHORT_S, LONG_S))
    growing = growing_functions(short, long, ALLOWANCE)
    if options == WITHOUT_SEARCHES:
        assert growing == {}
        # what compares the sources takes some thousand lines more or less on another drive
        assert long.total() - short.total() < 0.5 * N_MORE
    else:
        # what a search calls, it calls a few times more or less; what runs for each message, twice as often
        assert {name: n for name, n in growing.items() if n > 0.5 * short[name]} == {}
