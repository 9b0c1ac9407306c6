"""Parts of an open file that are copied into an output, in a thread if they are long."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from cwcli.errors import InputError, OutputError
from cwcli.output import open_output

MEGABYTE = 1 << 20


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_copy_takes_a_part_of_a_file(tmp_path: Path) -> None:
    source = tmp_path / "in.bin"
    content = os.urandom(3 * MEGABYTE)
    source.write_bytes(content)
    with source.open("rb") as file, open_output(tmp_path / "out.bin") as output:
        output.write(b"head")
        output.copy_from_file(file.fileno(), 5, 2 * MEGABYTE)
        assert output.position == 4 + 2 * MEGABYTE
        output.write(b"tail")
    assert (tmp_path / "out.bin").read_bytes() == b"head" + content[5 : 5 + 2 * MEGABYTE] + b"tail"


def test_copy_without_the_kernels_help(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def not_here(*args: object) -> int:
        raise OSError(errno.EXDEV, "Invalid cross-device link")

    monkeypatch.setattr(os, "copy_file_range", not_here, raising=False)
    test_copy_takes_a_part_of_a_file(tmp_path)


@pytest.mark.parametrize("size", [5, 2 * MEGABYTE])  # the longer one is copied in a thread
def test_source_that_became_shorter(tmp_path: Path, size: int) -> None:
    source = tmp_path / "in.bin"
    source.write_bytes(bytes(size))
    with (
        source.open("rb") as file,
        pytest.raises(InputError, match="became shorter"),
        open_output(tmp_path / "out.bin") as output,
    ):
        output.copy_from_file(file.fileno(), 0, size + 1)
        output.write(b"more")
    assert names_in(tmp_path) == ["in.bin"]


def test_copies_and_data_stay_in_order(tmp_path: Path) -> None:
    source = tmp_path / "in.bin"
    content = os.urandom(4 * MEGABYTE)
    source.write_bytes(content)
    expected = bytearray()
    with source.open("rb") as file, open_output(tmp_path / "out.bin") as output:
        for k, length in enumerate((3 * MEGABYTE, 100, MEGABYTE, MEGABYTE, 300_000, 1)):
            data = bytes([k]) * (1 if k % 2 else 3 * MEGABYTE // 2)
            output.copy_from_file(file.fileno(), k, length)
            output.write(data)
            expected += content[k : k + length] + data
            assert output.position == len(expected)
    assert (tmp_path / "out.bin").read_bytes() == bytes(expected)


def test_an_error_in_the_thread_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_space(*args: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    source = tmp_path / "in.bin"
    source.write_bytes(bytes(MEGABYTE))
    monkeypatch.setattr(os, "copy_file_range", no_space, raising=False)
    with (
        source.open("rb") as file,
        pytest.raises(OutputError, match="no space is left"),
        open_output(tmp_path / "out.bin") as output,
    ):
        for _ in range(3):
            output.copy_from_file(file.fileno(), 0, MEGABYTE)
    assert names_in(tmp_path) == ["in.bin"]
