"""Output targets: a file appears whole or not at all, and whatever can't be written is refused in one line."""

from __future__ import annotations

import errno
import os
import pty
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import cwcli.output_stream
import cwcli.temporary
from cwcli.errors import EXIT_NOT_WRITTEN, OutputError, UsageError
from cwcli.input import InputFile
from cwcli.output import AtomicGroup, open_output, refuse_unwritable_target, write_file

MEGABYTE = 1 << 20


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_file_appears_whole(tmp_path: Path) -> None:
    target = tmp_path / "out.bin"
    with open_output(target) as output:
        output.write(b"ab")
        output.write(bytes(3 * MEGABYTE))
        assert output.position == 3 * MEGABYTE + 2
        assert not target.exists()
    assert target.read_bytes() == b"ab" + bytes(3 * MEGABYTE)
    assert names_in(tmp_path) == ["out.bin"]


def test_file_mode_follows_the_umask(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_file(tmp_path / "out.bin", b"x")
    finally:
        os.umask(before)
    assert (tmp_path / "out.bin").stat().st_mode & 0o777 == 0o640


@pytest.mark.parametrize("error", [ValueError("no"), KeyboardInterrupt()])
def test_error_or_interrupt_leaves_nothing(tmp_path: Path, error: BaseException) -> None:
    with pytest.raises(type(error)), open_output(tmp_path / "out.bin") as output:
        output.write(bytes(20 * MEGABYTE))
        raise error
    assert names_in(tmp_path) == []


def test_error_keeps_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "out.bin"
    target.write_bytes(b"old")
    with pytest.raises(ValueError, match="no"), open_output(target, force=True) as output:
        output.write(b"new")
        raise ValueError("no")
    assert target.read_bytes() == b"old"
    assert names_in(tmp_path) == ["out.bin"]


def test_killed_run_leaves_no_file_under_the_name(tmp_path: Path) -> None:
    target = tmp_path / "out.bin"
    code = (
        "import sys, time\n"
        "from cwcli.output import open_output\n"
        "with open_output(sys.argv[1]) as output:\n"
        "    output.write(bytes(30_000_000))\n"
        "    print('half', flush=True)\n"
        "    time.sleep(60)\n"
    )
    run = subprocess.Popen(
        [sys.executable, "-c", code, str(target)], stdout=subprocess.PIPE, cwd=Path(__file__).parents[3]
    )
    assert run.stdout is not None
    assert run.stdout.readline() == b"half\n"
    os.kill(run.pid, signal.SIGKILL)
    assert run.wait(timeout=600) == -signal.SIGKILL
    run.stdout.close()
    assert not target.exists()
    assert all(name.startswith(".out.bin.") and name.endswith(".part") for name in names_in(tmp_path))


def test_existing_file_needs_force(tmp_path: Path) -> None:
    target = tmp_path / "out.bin"
    target.write_bytes(b"old")
    with pytest.raises(OutputError, match="the file exists") as caught:
        write_file(target, b"new")
    assert caught.value.exit_code == EXIT_NOT_WRITTEN
    assert "--force" in caught.value.hint
    write_file(target, b"new", force=True)
    assert target.read_bytes() == b"new"


def test_file_that_appears_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    target = tmp_path / "out.bin"
    with pytest.raises(OutputError, match="the file exists"), open_output(target):
        target.write_bytes(b"other")
    assert target.read_bytes() == b"other"
    assert names_in(tmp_path) == ["out.bin"]


def test_directory_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="is a directory"):
        refuse_unwritable_target(tmp_path, force=True)


def test_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="does not exist"):
        refuse_unwritable_target(tmp_path / "no" / "out.bin")


def test_folder_without_permission_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(OutputError, match="not writable"):
        refuse_unwritable_target(tmp_path / "out.bin")


@pytest.mark.parametrize("link", ["same", "symlink", "hardlink"])
def test_input_is_never_overwritten(tmp_path: Path, link: str) -> None:
    source = tmp_path / "in.mcap"
    source.write_bytes(b"data")
    target = source if link == "same" else tmp_path / "link.mcap"
    if link == "symlink":
        target.symlink_to(source)
    elif link == "hardlink":
        target.hardlink_to(source)
    with (
        InputFile.open(source) as file,
        pytest.raises(OutputError, match="the input itself"),
        open_output(target, force=True, inputs=(file,)) as output,
    ):
        output.write(b"new")
    assert source.read_bytes() == b"data"


def test_symlink_is_written_through(tmp_path: Path) -> None:
    real, link = tmp_path / "real.bin", tmp_path / "link.bin"
    real.write_bytes(b"old")
    link.symlink_to(real)
    write_file(link, b"new", force=True)
    assert link.is_symlink()
    assert real.read_bytes() == b"new"


def test_full_disk(tmp_path: Path) -> None:
    """`/dev/full` answers every write with ENOSPC; it is a device, so it is written directly."""
    with pytest.raises(OutputError, match="no space is left") as caught:
        write_file("/dev/full", b"x")
    assert str(caught.value).startswith("/dev/full: ")


def test_file_size_limit_leaves_nothing(tmp_path: Path) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (MEGABYTE, limits[1]))
    try:
        with pytest.raises(OutputError, match="larger than is allowed"):
            write_file(tmp_path / "out.bin", bytes(2 * MEGABYTE))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, before)
    assert names_in(tmp_path) == []


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_medium_that_fails_at_the_end_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    def fail(*args: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    if call == "fsync":
        monkeypatch.setattr(os, "fsync", fail)
    else:
        monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OutputError, match="no space is left"):
        write_file(tmp_path / "out.bin", bytes(MEGABYTE))
    monkeypatch.undo()
    assert names_in(tmp_path) == []


def test_error_of_background_writing_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real, calls = os.fsync, []

    def fail_first(descriptor: int) -> None:
        calls.append(descriptor)
        if len(calls) == 1:
            raise OSError(errno.EIO, "Input/output error")
        real(descriptor)

    monkeypatch.setattr(os, "fsync", fail_first)
    monkeypatch.setattr(cwcli.output_stream, "BYTES_BETWEEN_BACKGROUND_SYNCS", MEGABYTE)
    with pytest.raises(OutputError, match="Input/output error"):
        write_file(tmp_path / "out.bin", bytes(2 * MEGABYTE))
    monkeypatch.undo()
    assert names_in(tmp_path) == []


def run_to_stdout(code: str, **streams: object) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-c", code], cwd=Path(__file__).parents[3], **streams)  # type: ignore[call-overload]


def test_stdout_into_a_pipe(tmp_path: Path) -> None:
    source = tmp_path / "in.bin"
    source.write_bytes(os.urandom(300_000))
    code = (
        "from cwcli.output import open_output\n"
        f"with open({str(source)!r}, 'rb') as source, open_output('-') as output:\n"
        "    output.write(b'head')\n"
        "    output.copy_from_file(source.fileno(), 0, 300_000)\n"
    )
    run = run_to_stdout(code, stdout=subprocess.PIPE)
    found, _ = run.communicate(timeout=600)
    assert run.returncode == 0
    assert found == b"head" + source.read_bytes()


def test_closed_pipe_stays_a_broken_pipe() -> None:
    code = (
        "from cwcli.output import open_output\n"
        "try:\n"
        "    with open_output('-') as output:\n"
        "        for _ in range(100):\n"
        "            output.write(bytes(1 << 20))\n"
        "except BrokenPipeError:\n"
        "    raise SystemExit(141)\n"
    )
    run = run_to_stdout(code, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert run.stdout is not None and run.stderr is not None
    run.stdout.read(10)
    run.stdout.close()
    assert run.wait(timeout=600) == 141
    assert run.stderr.read() == b""
    run.stderr.close()


def test_full_disk_behind_stdout() -> None:
    code = (
        "from cwcli.errors import CwcliError\n"
        "from cwcli.output import write_file\n"
        "try:\n"
        "    write_file('-', b'x')\n"
        "except CwcliError as error:\n"
        "    raise SystemExit(error.exit_code)\n"
    )
    with Path("/dev/full").open("wb") as full:
        assert run_to_stdout(code, stdout=full).wait(timeout=600) == EXIT_NOT_WRITTEN


def test_terminal_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    leader, follower = pty.openpty()
    with os.fdopen(leader, "rb"), os.fdopen(follower, "w") as terminal:
        monkeypatch.setattr(sys, "stdout", terminal)
        with pytest.raises(UsageError, match="terminal"):
            refuse_unwritable_target("-")


def test_named_pipe_is_written_directly(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE)
    write_file(pipe, b"through the pipe")
    found, _ = reader.communicate(timeout=600)
    assert found == b"through the pipe"
    assert not pipe.is_file()


def test_names_that_no_file_can_have(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="too long"):
        write_file(tmp_path / ("x" * 300), b"")
    with pytest.raises(OutputError, match="null"):
        write_file(f"{tmp_path}/a\0b", b"")
    write_file(tmp_path / ("x" * 250), b"")
    assert names_in(tmp_path) == ["x" * 250]


def test_small_writes_are_gathered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real, sizes = os.write, []

    def count(descriptor: int, data: memoryview) -> int:
        sizes.append(len(data))
        return real(descriptor, data)

    monkeypatch.setattr(os, "write", count)
    with open_output(tmp_path / "out.bin") as output:
        for _ in range(1000):
            output.write(b"x" * 100)
    assert sizes == [100_000]


def test_files_written_together_appear_at_the_end(tmp_path: Path) -> None:
    with AtomicGroup() as together:
        write_file(tmp_path / "a", b"1", together=together)
        write_file(tmp_path / "b", b"2", together=together)
        assert not (tmp_path / "a").exists() and not (tmp_path / "b").exists()
    assert names_in(tmp_path) == ["a", "b"]
    assert ((tmp_path / "a").read_bytes(), (tmp_path / "b").read_bytes()) == (b"1", b"2")


def test_of_files_written_together_none_appears_after_an_error(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"old")
    with pytest.raises(OutputError, match="does not exist"), AtomicGroup() as together:
        write_file(tmp_path / "a", b"new", force=True, together=together)
        write_file(tmp_path / "no" / "b", b"2", together=together)
    assert names_in(tmp_path) == ["a"]
    assert (tmp_path / "a").read_bytes() == b"old"


def test_of_files_written_together_none_appears_where_one_name_is_taken_meanwhile(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="the file exists"), AtomicGroup() as together:
        write_file(tmp_path / "a", b"1", together=together)
        write_file(tmp_path / "b", b"2", together=together)
        (tmp_path / "b").write_bytes(b"other")
    assert names_in(tmp_path) == ["b"]
    assert (tmp_path / "b").read_bytes() == b"other"


@pytest.fixture
def no_nameless_files(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a file system or a system without them."""
    monkeypatch.setattr(cwcli.temporary, "_open_unnamed_file_or_none", lambda folder: None)


@pytest.mark.usefixtures("no_nameless_files")
def test_without_nameless_files_a_hidden_one_is_renamed(tmp_path: Path) -> None:
    target = tmp_path / "out.bin"
    with open_output(target) as output:
        output.write(b"whole")
        output.flush()
        [hidden] = names_in(tmp_path)
        assert hidden.startswith(".out.bin.") and hidden.endswith(".part")
    assert names_in(tmp_path) == ["out.bin"]
    with pytest.raises(ValueError, match="no"), open_output(target, force=True) as output:
        output.write(b"half")
        raise ValueError("no")
    assert names_in(tmp_path) == ["out.bin"]
    assert target.read_bytes() == b"whole"


@pytest.mark.skipif(not hasattr(os, "O_TMPFILE"), reason="the system has no files without a name")
def test_with_nameless_files_the_folder_is_empty_meanwhile(tmp_path: Path) -> None:
    try:
        os.close(os.open(tmp_path, os.O_TMPFILE | os.O_WRONLY))
    except OSError:
        pytest.skip("the file system has no files without a name")
    with open_output(tmp_path / "out.bin") as output:
        output.write(b"whole")
        output.flush()
        assert names_in(tmp_path) == []
    assert (tmp_path / "out.bin").read_bytes() == b"whole"
    assert (tmp_path / "out.bin").stat().st_mode & 0o777 == 0o666 & ~current_umask()


def current_umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
