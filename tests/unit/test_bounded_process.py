"""A process that takes more than its bounds ends with an error in words; a bug in it stays a bug."""

from __future__ import annotations

from pathlib import Path

import pytest

from cwcli.bounded_process import Limits, cpu_limit_for_file_size_s, run_bounded
from cwcli.errors import CwcliError, DataError, InputError, OutputError

LIMITS = Limits(cpu_s=1, file_bytes=1_000_000, data_bytes=500_000_000)


def run(name: str, **request: object) -> dict[str, object]:
    return run_bounded(f"tests.unit.bounded_functions:{name}", request, LIMITS, "drive.csv")


def test_answer_comes_back() -> None:
    assert run("answer", number=21) == {"twice": 42}


@pytest.mark.parametrize(
    ("name", "kind", "words"),
    [
        ("take_memory", InputError, "drive.csv: reading it takes more than 500 MB of memory"),
        ("take_time", InputError, "more than the 1 s of processor time"),
        ("crash", InputError, "ended with SIGSEGV"),
        ("write_much", OutputError, "can't be converted: File too large"),
        ("fail", DataError, "a.csv: it is wrong"),
        ("stumble", RuntimeError, "KeyError: 'a bug'"),
    ],
)
def test_error_comes_back(tmp_path: Path, name: str, kind: type[Exception], words: str) -> None:
    with pytest.raises(kind, match=words) as found:
        run(name, path=str(tmp_path / "much"))
    if isinstance(found.value, CwcliError):
        assert "\n" not in str(found.value)
    if name == "fail":
        assert isinstance(found.value, CwcliError)
        assert (found.value.found, found.value.hint) == (("b",), "c")


def test_processor_time_grows_with_the_file() -> None:
    """4 s, and 8 s for each megabyte."""
    assert [cpu_limit_for_file_size_s(n) for n in (0, 1000, 1_000_000, 10_000_000)] == [4, 4, 12, 84]
