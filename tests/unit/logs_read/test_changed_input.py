"""A log that is replaced, written into, cut or removed while it is read: an error that says so, never a mixture."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cwcli.errors import InputError, OutputError
from cwcli.input import (
    InputFile,
    RealPaths,
    check_unchanged,
    names_of_inputs_in_folders,
    read_file,
    remember_input_file,
    remember_inputs,
)
from cwcli.logs.read.reader import Log
from cwcli.logs.read.recording import log_names_in_folder, names_of_entries
from cwcli.logs.write.annotate import CopyOptions, annotate_log
from cwcli.output import AtomicGroup, refuse_unwritable_target, write_file
from tests.unit.logs_read.builders import small_log
from tests.unit.logs_write.builders import state_channel

CHANGED = "the log changed while it was read"


def replace(path: Path) -> None:
    other = path.with_name("other.mcap")
    other.write_bytes(path.read_bytes())
    other.rename(path)


def overwrite(path: Path) -> None:
    with path.open("r+b") as file:
        file.seek(path.stat().st_size // 2)
        file.write(b"#")


def shorten(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


def append(path: Path) -> None:
    with path.open("ab") as file:
        file.write(b"#")


CHANGES: dict[Callable[[Path], None], str] = {
    replace: "another file has its name now",
    overwrite: "something was written into it",
    shorten: r"it had \d+ bytes and has \d+",
    append: r"it had \d+ bytes and has \d+",
    Path.unlink: r"it is gone \(No such file or directory\)",
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "log.mcap"
    file.write_bytes(small_log())
    return file


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_is_told_at_the_end(path: Path, change: Callable[[Path], None]) -> None:
    with pytest.raises(InputError, match=f"{path}: {CHANGED}: {CHANGES[change]}") as caught, Log.open(path):
        change(path)
    assert "on a copy" in caught.value.hint


@pytest.mark.parametrize("change", CHANGES)
def test_a_changed_log_is_not_annotated(path: Path, change: Callable[[Path], None]) -> None:
    target = path.with_name("out.mcap")
    log = Log.open(path)
    change(path)
    with pytest.raises(InputError, match=f"{CHANGED}|became shorter"):
        annotate_log(log, [state_channel()], {}, target)
    assert not target.exists()
    log.close()


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_before_the_output_gets_its_name_is_told(path: Path, change: Callable[[Path], None]) -> None:
    target = path.with_name("out.mcap")
    log = Log.open(path)
    with pytest.raises(InputError, match=CHANGED), AtomicGroup() as together:
        annotate_log(log, [state_channel()], {}, target, options=CopyOptions(together=together))
        change(path)
    assert not target.exists()
    log.close()


def test_a_shortened_log_is_no_signal_but_an_error(path: Path) -> None:
    log = Log.open(path)
    os.truncate(path, 4096)
    with pytest.raises(InputError, match=f"{CHANGED}: it had {log.file.state[2]} bytes and ends at byte"):
        log.columns("/fix")
    log.close()


def test_an_error_that_a_change_explains_is_told_as_a_change(path: Path) -> None:
    with pytest.raises(InputError, match=f"{CHANGED}: something was written"), Log.open(path) as log:
        with path.open("r+b") as file:
            file.write(bytes(path.stat().st_size))
        with pytest.raises(InputError, match="damaged"):
            log.columns("/fix")
        raise ValueError("what a stage makes of zeros")


def test_an_error_of_the_output_stays_one(path: Path) -> None:
    with pytest.raises(OutputError, match="no space"), Log.open(path):
        replace(path)
        raise OutputError("no space is left on the disk")


def test_a_write_right_after_opening_is_seen(path: Path) -> None:
    """However coarse the clock is that the file system stamps changes with."""
    data = path.read_bytes()
    for _ in range(20):
        path.write_bytes(data)
        with pytest.raises(InputError, match=CHANGED), InputFile.open(path), path.open("r+b") as file:
            file.write(data)


def test_a_redirected_file_that_changes_is_told(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with path.open("rb") as file:
        monkeypatch.setattr(sys, "stdin", file)
        with pytest.raises(InputError, match=f"<stdin>: {CHANGED}"), Log.open("-") as log:
            assert len(log.columns("/fix")) == 60
            overwrite(path)


def test_hashing_a_shortened_log_is_an_error(path: Path) -> None:
    log = Log.open(path)
    os.truncate(path, 10)
    with pytest.raises(InputError, match=CHANGED):
        log.begin_sha256().result(20.0)
    log.close()


def test_bytes_are_those_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "bytes"
    data = np.random.default_rng(0).bytes(50_000)
    path.write_bytes(data)
    rng = np.random.default_rng(1)
    with InputFile.open(path) as file:
        assert len(file) == 50_000
        for _ in range(500):
            start, stop = sorted(rng.integers(0, 55_000, 2).tolist())
            if rng.random() < 0.7:
                stop = min(stop, start + 40)
            assert bytes(file[start:stop]) == data[start:stop]
        assert bytes(file.read_into(memoryview(bytearray(20_000)), 5)) == data[5:20_005]


def test_a_file_that_a_run_has_read_is_no_target(tmp_path: Path) -> None:
    source, link = tmp_path / "a.toml", tmp_path / "b.toml"
    source.write_bytes(b"mine")
    link.hardlink_to(source)
    with remember_inputs():
        assert read_file(source) == b"mine"
        assert names_of_inputs_in_folders(tmp_path) == [str(source)]
        with pytest.raises(OutputError, match="the input itself"):
            write_file(link, b"new", force=True)
        with remember_inputs(), pytest.raises(OutputError, match="the input itself"):
            refuse_unwritable_target(source, force=True)
    write_file(link, b"new", force=True)
    assert source.read_bytes() == b"mine"


def test_real_paths_are_those_of_the_system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "real/deep").mkdir(parents=True)
    (tmp_path / "real/a").touch()
    (tmp_path / "link").symlink_to("real")
    (tmp_path / "real/b").symlink_to("a")
    (tmp_path / "real/loop").symlink_to("loop")
    real_paths = RealPaths()
    for name in ("real/a", "link/a", "link/b", "link/loop", "link/deep/../a", "link/..", "link/", "link", ".", "none/x",
                 "/", f"{tmp_path}/link/a", "-", "link//a"):  # fmt: skip
        assert real_paths.resolve(name) == os.path.realpath(name), name


def test_a_link_to_itself_is_no_entry_of_a_folder(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").touch()
    (tmp_path / "deep").mkdir()
    (tmp_path / "loop.mcap").symlink_to("loop.mcap")
    assert log_names_in_folder(tmp_path) == ["a.mcap"]
    assert names_of_entries(tmp_path, os.DirEntry.is_dir) == ["deep"]


def test_a_run_minds_the_logs_that_are_open(path: Path) -> None:
    with remember_inputs():
        log = Log.open(path)
        overwrite(path)
        with pytest.raises(InputError, match=CHANGED):
            write_file(path.with_name("table.csv"), b"1,2")
        log.close()
        check_unchanged()
    assert not path.with_name("table.csv").exists()


def test_what_nobody_can_read_is_not_remembered(tmp_path: Path) -> None:
    with remember_inputs():
        remember_input_file(tmp_path / "none")
        remember_input_file("a\0b")
        remember_input_file(tmp_path)
        assert names_of_inputs_in_folders(tmp_path.parent) == []


def test_a_change_behind_the_last_read_is_nobodys_matter(path: Path) -> None:
    target = path.with_name("out.mcap")
    with Log.open(path) as log:
        annotate_log(log, [state_channel()], {}, target)
        overwrite(path)
    assert target.exists()
    with pytest.raises(InputError, match=CHANGED), Log.open(path) as log:
        annotate_log(log, [state_channel()], {}, target, force=True)
        overwrite(path)
        log.columns("/fix")
