"""Commands that are disturbed at random moments: `python -m tests.disturb --help`.

They are killed, find no room, their input changes, their folder for temporary files goes, or they run twice at once.
A full disk is a small file system where one can be mounted (Linux, as root), else a limit on the size of files.
`--state FILE` keeps what was done, and goes on from there. `--warm` forks most commands from this process, which has
imported the libraries, so that most of their time is work; every fourth one starts as a user starts it.

What must hold of every one of them: no file of its outputs is a part of one, or a mixture of two logs; nothing else is
left; the same command, run again, gives what an undisturbed one gives; and it ends by itself with a documented code.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import pkgutil
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path

import numpy as np
import zstandard
from rosbags.rosbag1 import Writer
from rosbags.rosbag2 import CompressionMode, StoragePlugin

import cwcli
from cwcli.errors import EXIT_BAD_INPUT, EXIT_NOT_WRITTEN, EXIT_USAGE
from tests.unit.importing import files
from tests.unit.logs_read.test_bags import bag, recording

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_logs"
CLAUSES = ROOT / "cwcli" / "conformance" / "clauses"
LONGEST_S = 600
FINDINGS = "FINDINGS"
"""The name under which findings are counted."""
CHILDREN_END_S = 20.0
"""Seconds in which the processes of a command end with it. Chosen by hand, for a busy machine."""
MIN_DISK_BYTES = 16_384
"""The smallest file system that is mounted: one page of Linux holds no file beside its folder."""
COMMANDS = (
    ("estimate", "log.mcap", "-o", "out/out.mcap", "--metrics", "out/out.csv", "--force", "--quiet"),
    ("run", "log.mcap", "-o", "out/out.mcap", "--metrics-dir", "out/tables", "--force", "--quiet"),
    ("run", "log.mcap", "-d", "out/many", "--jobs", "1", "--force", "--quiet"),
    ("cut", "drive.bag", "--topics", "/fix", "-o", "out/cut.mcap", "--force", "--quiet"),
    ("cut", "drive.db3", "--topics", "/fix", "-o", "out/cut.mcap", "--force", "--quiet"),
    ("import", "drive.csv", "-o", "out/drive.mcap", "--force", "--quiet"),
    ("import", "drive.ubx", "-o", "out/drive.mcap", "--force", "--quiet"),
    ("join", "log.mcap", "other.mcap", "--role", "remote", "-o", "out/both.mcap", "--force", "--quiet"),
    ("export", "annotated.mcap", "--what", "ego", "-o", "out/ego.csv", "--force", "--quiet"),
    ("export", "annotated.mcap", "--format", "ros2", "-o", "out/ros.mcap", "--force", "--quiet"),
    ("report", "annotated.mcap", "-o", "out/page.html", "--force", "--quiet"),
    ("calibrate", "log.mcap", "other.mcap", "-o", "out/car.toml", "--force", "--quiet"),
    ("find", "annotated.mcap", "all", "-o", "out/found.csv", "--clips", "out/clips", "--force", "--quiet"),
    ("merge", "shards/1", "shards/2", "-d", "out/merged", "--quiet"),
    ("estimate", "log.mcap.zst", "-o", "out/out.mcap", "--force", "--quiet"),
    ("export", "annotated.mcap", "--what", "paths", "-o", "out/paths.parquet", "--force", "--quiet"),
    ("import", "drive.gpx", "-o", "out/drive.mcap", "--force", "--quiet"),
    ("import", "drive.nmea", "-o", "out/drive.mcap", "--force", "--quiet"),
    ("import", "drive.blf", "--dbc", "car.dbc", "-o", "out/drive.mcap", "--force", "--quiet"),
    ("import", "drive.zip", "-o", "out/drive.mcap", "--force", "--quiet"),
    ("import", "drive.parquet", "-o", "out/drive.mcap", "--force", "--quiet"),
    ("import", "drive.mp4", "--times", "frames.txt", "-o", "out/drive.mcap", "--force", "--quiet"),
    ("conform", "clause.toml", "--seeds", "1", "--jobs", "1", "--html", "out/page.html", "--force", "--quiet"),
    ("lanes", "road.mcap", "-o", "out/lanes.mcap", "--force", "--quiet"),
    ("track", "targets.mcap", "-o", "out/tracked.mcap", "--force", "--quiet"),
    ("simulate", "scene.toml", "-o", "out/scene.mcap", "--force", "--quiet"),
    ("plot", "annotated.mcap", "-o", "out/plot.png", "--force", "--quiet"),
)
"""Each names its input second: that is what changes, or a file in it."""
CHANGED_FILE_OF_FOLDER = {"shards/1": "shards/1/logs/intersection/annotated.mcap"}
"""Folder that a command reads -> the file in it that is replaced; outputs may be links to it, so that it is not
overwritten."""
GO_ON_WITHOUT = {"calibrate": 1}
"""Command -> the index of the log without which it goes on: it reports the log that fails, and writes the others."""
WHOLE = (".mcap", ".csv", ".parquet", ".html", ".toml", ".png")
"""Outputs that are the same bytes in every run; the manifest of `-d` tells how long it took."""
Files = dict[str, bytes]
Inputs = dict[str, tuple[bytes, bytes]]
"""Name of an input -> its content, and another one that it changes to."""


@dataclass(frozen=True)
class Reference:
    """What an undisturbed command makes of each log, and how long it takes."""

    outputs: tuple[Files, ...]
    took_s: float


class Finding(AssertionError):
    """What must not be."""


class Forked:
    """A command in a process that was forked from this one, with what the tests use of `subprocess.Popen`.

    Args:
        folder: The folder that it runs in.
        command: Its arguments.
        limit_bytes: The longest file that it can write.
    """

    def __init__(self, folder: Path, command: tuple[str, ...], limit_bytes: int | None) -> None:
        self._said, writes = os.pipe()
        self.pid = os.fork()
        if not self.pid:
            code = 70
            try:
                os.setpgid(0, 0)
                os.chdir(folder)
                os.environ.update(environment_of(folder))
                tempfile.tempdir = None
                os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
                os.dup2(writes, 2)
                sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)
                if limit_bytes is not None:
                    resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))
                sys.argv[1:] = command
                from cwcli.cli.main import main as run_cwcli

                run_cwcli()
            except SystemExit as left:
                code = int(left.code or 0)
            finally:
                with contextlib.suppress(OSError, ValueError):
                    sys.stderr.flush()
                os._exit(code)
        os.close(writes)
        with contextlib.suppress(OSError):  # the child has done it, and may have gone
            os.setpgid(self.pid, self.pid)

    def terminate(self) -> None:
        """Send SIGTERM."""
        os.kill(self.pid, signal.SIGTERM)

    def wait_and_read(self) -> tuple[int, str]:
        """Its exit code, and what it said."""
        with os.fdopen(self._said, "rb") as file:
            said = file.read().decode(errors="replace")
        return os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1]), said


def environment_of(folder: Path) -> dict[str, str]:
    """The environment of a command."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1", "TMPDIR": str(folder / "tmp")}


@dataclass
class Launcher:
    """Starts commands.

    Attributes:
        is_warm: Whether most are forked from this process.
        n_started: Commands that were started.
    """

    is_warm: bool = False
    n_started: int = 0

    def forks(self, command: tuple[str, ...]) -> bool:
        """Whether the next command is forked: not every fourth one, and none of those that start processes by name."""
        self.n_started += 1
        return self.is_warm and self.n_started % 4 > 0 and "-d" not in command


LAUNCHER = Launcher()
Process = subprocess.Popen[bytes] | Forked


def import_all() -> None:
    """Import what commands import, for those that are forked."""
    for each in pkgutil.walk_packages(cwcli.__path__, "cwcli."):
        if not each.name.endswith("__main__"):
            with contextlib.suppress(ImportError):
                import_module(each.name)
    for name in ("cv2", "pyarrow.parquet", "pyarrow.csv", "mcap.writer", "lz4.frame", "zstandard", "yaml", "jinja2"):
        import_module(name)


def start(folder: Path, command: tuple[str, ...], limit_bytes: int | None = None) -> Process:
    """The command, in a group of processes of its own; `limit_bytes` is the longest file that it can write."""
    if LAUNCHER.forks(command):
        return Forked(folder, command, limit_bytes)
    process = subprocess.Popen(
        [sys.executable, "-m", "cwcli", *command],
        cwd=folder,
        env=environment_of(folder),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    if limit_bytes is not None:  # it is still about to start
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))
    return process


def ended(process: Process) -> tuple[int, str]:
    """Its exit code and what it said; it leaves no process behind.

    Raises:
        Finding: A process of its group still runs.
    """
    if isinstance(process, Forked):
        code, said = process.wait_and_read()
    else:
        _, text = process.communicate(timeout=LONGEST_S)
        code, said = process.returncode, text.decode(errors="replace")
    until = time.monotonic() + CHILDREN_END_S
    while has_processes(process.pid):
        if time.monotonic() > until:
            os.killpg(process.pid, signal.SIGKILL)
            raise Finding(f"a process of it still runs {CHILDREN_END_S:g} s after it ended with {code}: {said}")
        time.sleep(0.01)
    return code, said


def has_processes(group: int) -> bool:
    """Whether a group of processes has any."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def outputs(folder: Path) -> Files:
    """The files below `out` that are the same in every run."""
    paths = (path for path in (folder / "out").rglob("*") if path.suffix in WHOLE)
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


@cache
def sample_inputs() -> Inputs:
    """Inputs that need no command."""
    one, two = ((SAMPLES / f"{name}.mcap").read_bytes() for name in ("intersection", "rear-end"))
    compressed = zstandard.compress(one), zstandard.compress(two)
    return {"log.mcap": (one, two), "other.mcap": (two, two), "log.mcap.zst": compressed}


def inputs_of(command: tuple[str, ...]) -> Inputs:
    """Inputs among which are those of a command."""
    files = {word for word in command[1:] if Path(word).suffix and not word.startswith("out/")}
    return sample_inputs() if command[1] in sample_inputs() and files <= sample_inputs().keys() else inputs()


@cache
def inputs() -> Inputs:
    """Inputs of every kind."""
    found = dict(sample_inputs())
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        annotated = []
        for log in ("intersection", "rear-end"):
            run_undisturbed(folder, "run", str(SAMPLES / f"{log}.mcap"), "-o", log)
            annotated.append((folder / log).read_bytes())
        found["annotated.mcap"] = annotated[0], annotated[1]
        samples = [str(SAMPLES / f"{log}.mcap") for log in ("intersection", "rear-end")]
        for shard in ("1", "2"):
            run_undisturbed(folder, "run", *samples, "--shard", f"{shard}/2", "-d", f"shards/{shard}", "--jobs", "1")
        for path in (folder / "shards").rglob("*"):
            if path.is_file():
                found[str(path.relative_to(folder))] = path.read_bytes(), b""
        changed = CHANGED_FILE_OF_FOLDER["shards/1"]
        found[changed] = found[changed][0], found["annotated.mcap"][1]
        one, two = ((CLAUSES / f"{name}.toml").read_bytes() for name in ("iso-15623", "nhtsa-fcw"))
        found["clause.toml"] = one, two
        one, two = ((SAMPLES / f"{name}.toml").read_bytes() for name in ("intersection", "rear-end"))
        found["scene.toml"] = one, two
        for kind, scenario in (("road", "road"), ("targets", "xiang2019-line")):
            logs = []
            for seed in ("1", "2"):
                made = f"{kind}{seed}"
                run_undisturbed(folder, "simulate", scenario, "--seed", seed, "--set", "duration_s=2", "-o", made)
                logs.append((folder / made).read_bytes())
            found[f"{kind}.mcap"] = logs[0], logs[1]
        bags = (bag(folder / f"{each}.bag", each).read_bytes() for each in (None, Writer.CompressionFormat.LZ4))
        databases = (
            next(recording(folder / f"{mode}", StoragePlugin.SQLITE3, mode).glob("*.db3*")).read_bytes()
            for mode in (None, CompressionMode.MESSAGE)
        )
        found |= {"drive.bag": (next(bags), next(bags)), "drive.db3": (next(databases), next(databases))}
        csv, ubx, nmea, gpx, phone, parquet, video = (
            make(folder)[0].read_bytes()
            for make in (
                files.csv_logger,
                files.ubx,
                files.nmea_full,
                files.gpx_speed,
                files.sensor_logger,
                files.parquet_epoch,
                files.video,
            )
        )
        found |= {"drive.csv": (csv, csv[: csv.rindex(b"\n", 0, -9999) + 1]), "drive.ubx": (ubx, ubx[:30_000])}
        found["drive.nmea"] = nmea, nmea[: nmea.rindex(b"\n", 0, -9999) + 1]
        found |= {
            "drive.gpx": (gpx, files.gpx_plain(folder)[0].read_bytes()),
            "drive.mp4": (video, video + b"\0\0\0\x08free"),
        }
        found["drive.zip"] = phone, files.phyphox(folder)[0].read_bytes()
        found["drive.parquet"] = parquet, files.parquet_zone(folder)[0].read_bytes()
        found["frames.txt"] = files.video(folder)[1].read_bytes(), b""
        trace, dbc = files.can_blf(folder)
        found |= {"car.dbc": (dbc.read_bytes(), b""), "drive.blf": (trace.read_bytes(), trace.read_bytes()[:-99])}
    return found


def run_undisturbed(folder: Path, *command: str) -> None:
    """Run a command of cwcli that must not fail."""
    subprocess.run(
        [sys.executable, "-m", "cwcli", *command, "--quiet"], cwd=folder, env=environment_of(folder.parent), check=True
    )


def reference(folder: Path, command: tuple[str, ...], n_contents: int) -> Reference:
    """Run the command undisturbed."""
    made = []
    took_s = 0.0
    for k in range(n_contents):
        empty(folder, command, k)
        begin = time.perf_counter()
        code, said = ended(start(folder, command))
        took_s = max(took_s, time.perf_counter() - begin)
        if code:
            raise Finding(f"{command} ended with {code}: {said}")
        made.append(outputs(folder))
    if n_contents > 1 and command[0] in GO_ON_WITHOUT:
        left_out = GO_ON_WITHOUT[command[0]]
        empty(folder, command)
        ended(start(folder, command[:left_out] + command[left_out + 1 :]))
        made.append(outputs(folder))
    return Reference(tuple(made), took_s)


def empty(folder: Path, command: tuple[str, ...], k: int = 0) -> None:
    """A folder with the inputs, the first of the command with its content k, and nothing written."""
    for name in ("out", "tmp"):
        shutil.rmtree(folder / name, ignore_errors=True)
        (folder / name).mkdir()
    shutil.rmtree(folder / "shards", ignore_errors=True)
    for name, contents in inputs_of(command).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(contents[k if name == changed_file(command) else 0])
    (folder / "cwcli.toml").write_bytes(b"")  # no other one, of a folder above, counts


def changed_file(command: tuple[str, ...]) -> str:
    """The input of a command that changes."""
    return CHANGED_FILE_OF_FOLDER.get(command[1], command[1])


def outputs_and_code_for_present_input(folder: Path, command: tuple[str, ...]) -> tuple[Files, int]:
    """What the command makes, undisturbed, of the inputs as they are now; the folder of outputs stays as it is."""
    (folder / "out").rename(folder / "out-before")
    (folder / "out").mkdir()
    code, _ = ended(start(folder, command))
    found = outputs(folder)
    shutil.rmtree(folder / "out")
    (folder / "out-before").rename(folder / "out")
    return found, code


def check_outputs(folder: Path, known: Reference, *, was_killed: bool = False) -> None:
    """Check that each file is that of one of the undisturbed runs, all of the same one, and that no other is there.

    A file has a hidden name for a moment: a run that is killed then can't remove it.
    """
    found = outputs(folder)
    if not any(found.items() <= each.items() for each in known.outputs):
        raise Finding(f"not what a run of one log writes: {sorted(found)}")
    hidden = [str(path) for path in folder.rglob("*") if path.name.endswith(".part") or path.parent.name == "tmp"]
    if hidden and not was_killed:
        raise Finding(f"left behind: {hidden}")


def check_again(folder: Path, command: tuple[str, ...], expected: Files) -> None:
    """Check that the command, run again, makes what it should."""
    code, said = ended(start(folder, command))
    if code or outputs(folder) != expected:
        raise Finding(f"run again, it ended with {code}: {said}")


def kill(folder: Path, command: tuple[str, ...], known: Reference, rng: np.random.Generator) -> str:
    """SIGKILL for all its processes, as when the machine goes down, or SIGTERM for the first."""
    how = signal.SIGKILL if rng.random() < 0.5 else signal.SIGTERM
    process = start(folder, command)
    time.sleep(float(rng.uniform(0, 1.1 * known.took_s)))
    if how == signal.SIGKILL:
        os.killpg(process.pid, how)
    else:
        process.terminate()
    code, said = ended(process)
    if code not in (0, -how, 128 + how) or "Traceback" in said:
        raise Finding(f"{how.name}: it ended with {code}: {said}")
    check_outputs(folder, known, was_killed=how == signal.SIGKILL)
    check_again(folder, command, known.outputs[0])
    return f"{how.name}, ended with {code}"


def fill(folder: Path, command: tuple[str, ...], known: Reference, rng: np.random.Generator) -> str:
    """No file can grow beyond some size, or the file system of the outputs or of temporary files is full."""
    largest = max(map(len, known.outputs[0].values()))
    n_bytes = int(rng.integers(int(largest * 1.05)))
    place = ("", "out", "tmp")[int(rng.integers(3))]
    if place and mount_disk(folder / place, n_bytes):
        try:
            code, said = ended(start(folder, command))
            found = check_full_disk(folder, command, known, code, said)
        finally:
            subprocess.run(["umount", str(folder / place)], check=True)
        if code == 0:  # a file was on the disk that is no more there
            return f"{place} on a small disk, ended with 0, {len(found)} files"
    else:
        place = ""
        code, said = ended(start(folder, command, n_bytes))
        check_full_disk(folder, command, known, code, said)
    check_again(folder, command, known.outputs[0])
    return f"{f'{place} on a small disk' if place else 'a limit on files'}, ended with {code}"


def check_full_disk(folder: Path, command: tuple[str, ...], known: Reference, code: int, said: str) -> Files:
    """Check what a command left that found no room; returns the files."""
    if code not in (0, EXIT_NOT_WRITTEN) or "Traceback" in said:
        raise Finding(f"it ended with {code}: {said}")
    check_outputs(folder, known)
    found = outputs(folder)
    if code and "-d" not in command and "--clips" not in command and found:
        raise Finding(f"it ended with {code} and wrote {sorted(found)}")
    if code == 0 and found != known.outputs[0]:
        raise Finding(f"it ended with 0 and wrote {sorted(found)}")
    return found


def mount_disk(folder: Path, n_bytes: int) -> bool:
    """Mount a file system of some size over an empty folder; False where that is not permitted."""
    size = f"size={max(n_bytes, MIN_DISK_BYTES)}"
    command = ["mount", "-t", "tmpfs", "-o", size, "cwcli-small-disk", str(folder)]
    try:
        return subprocess.run(command, check=False, capture_output=True).returncode == 0
    except OSError:
        return False


def change(folder: Path, command: tuple[str, ...], known: Reference, rng: np.random.Generator) -> str:
    """The log is replaced by another one, overwritten with it, or cut."""
    path, other = folder / changed_file(command), folder / "changed"
    changed = inputs_of(command)[changed_file(command)][1]
    other.write_bytes(changed)
    process = start(folder, command)
    time.sleep(float(rng.uniform(0, 1.05 * known.took_s)))
    how = 0 if command[1] in CHANGED_FILE_OF_FOLDER else int(rng.integers(3))
    if how == 0:
        other.rename(path)
    elif how == 1:
        with path.open("r+b") as file:
            file.write(changed)
    else:
        os.truncate(path, int(rng.integers(path.stat().st_size)))
    code, said = ended(process)
    other.unlink(missing_ok=True)
    expected = {0, EXIT_USAGE if path.suffix == ".toml" else EXIT_BAD_INPUT}
    if how == 2 and code != EXIT_BAD_INPUT:  # the cut may have come before the reading: some formats are whole then
        of_cut_file, code_of_cut_file = outputs_and_code_for_present_input(folder, command)
        known = Reference((*known.outputs, of_cut_file), known.took_s)
        expected.add(code_of_cut_file)
    if code not in expected or "Traceback" in said:
        raise Finding(f"it ended with {code}: {said}")
    check_outputs(folder, known)
    may_write_some = {"-d", "--clips"} & {*command} or command[0] in GO_ON_WITHOUT
    if bool(code) == bool(outputs(folder)) and not (code and may_write_some):
        raise Finding(f"it ended with {code} and wrote {sorted(outputs(folder))}")
    return f"{('replaced', 'overwritten', 'cut')[how]}, ended with {code}"


def lose_folder(folder: Path, command: tuple[str, ...], known: Reference, rng: np.random.Generator) -> str:
    """The folder for temporary files goes, or is a file."""
    shutil.rmtree(folder / "tmp")
    how = "goes" if rng.random() < 0.5 else "is a file"
    if how == "goes":
        (folder / "tmp").mkdir()
        process = start(folder, command)
        time.sleep(float(rng.uniform(0, 1.05 * known.took_s)))
        shutil.rmtree(folder / "tmp", ignore_errors=True)
    else:
        (folder / "tmp").write_bytes(b"")
        process = start(folder, command)
    code, said = ended(process)
    if code not in (0, EXIT_NOT_WRITTEN) or "Traceback" in said:
        raise Finding(f"it ended with {code}: {said}")
    check_outputs(folder, known)
    if code == 0 and outputs(folder) != known.outputs[0]:
        raise Finding(f"it ended with {code} and wrote {sorted(outputs(folder))}")
    if how == "is a file":
        (folder / "tmp").unlink()
    (folder / "tmp").mkdir(exist_ok=True)
    check_again(folder, command, known.outputs[0])
    return f"TMPDIR {how}, ended with {code}"


def run_twice(folder: Path, command: tuple[str, ...], known: Reference, rng: np.random.Generator) -> str:
    """Two of the same command write the same files at once."""
    first = start(folder, command)
    time.sleep(float(rng.uniform(0, known.took_s)))
    codes = []
    for process in (start(folder, command), first):
        code, said = ended(process)
        if code not in (0, EXIT_NOT_WRITTEN) or "Traceback" in said:
            raise Finding(f"it ended with {code}: {said}")
        codes.append(code)
    check_outputs(folder, known)
    if 0 in codes and outputs(folder) != known.outputs[0]:
        raise Finding(f"they ended with {codes} and wrote {sorted(outputs(folder))}")
    return f"two at once, ended with {min(codes)} and {max(codes)}"


Kind = Callable[[Path, tuple[str, ...], Reference, np.random.Generator], str]
KINDS: dict[str, Kind] = {
    "kill": kill,
    "fill": fill,
    "change": change,
    "folder": lose_folder,
    "twice": run_twice,
}


def disturb(
    kind: str,
    n: int,
    seed: int,
    folder: Path,
    commands: Sequence[tuple[str, ...]] = COMMANDS,
    state: Path | None = None,
) -> Counter[str]:
    """Disturb commands n times; what became of them, counted.

    Args:
        kind: One of `KINDS`.
        n: How many times, with those of `state`.
        seed: Of the moments.
        folder: Where the commands run.
        commands: The commands, in turn.
        state: A file that keeps the counts, so that another call goes on; findings are printed and counted there.

    Raises:
        Finding: Something came out that must not, and there is no `state`.
    """
    counts: Counter[str] = Counter()
    known: dict[tuple[str, ...], Reference] = {}
    if state is not None and state.exists():
        counts.update(json.loads(state.read_text()))
    for k in range(counts.total(), n):
        rng = np.random.default_rng([seed, k])
        command = commands[k % len(commands)]
        if command not in known:
            known[command] = reference(
                folder, command, 2 if kind == "change" and command[1] not in CHANGED_FILE_OF_FOLDER else 1
            )
        empty(folder, command)
        try:
            counts[KINDS[kind](folder, command, known[command], rng)] += 1
        except Finding as error:
            what = f"{kind} {k} of seed {seed} ({' '.join(command)}): {error}"
            if state is None:
                raise Finding(what) from error
            print(what, flush=True)
            counts[FINDINGS] += 1
        if state is not None:
            state.write_text(json.dumps(counts))
    return counts


def main() -> int:
    """Parse the arguments, disturb and tell."""
    parser = argparse.ArgumentParser(prog="python -m tests.disturb", description=sys.modules[__name__].__doc__)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("-n", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", metavar="COMMAND", help="commands of these names (default: all)")
    parser.add_argument("--folder", type=Path, help="where the outputs go")
    parser.add_argument("--state", type=Path, help="keeps what was done; the same command goes on behind it")
    parser.add_argument("--warm", action="store_true", help="fork most commands from this process")
    given = parser.parse_args()
    if given.warm:
        LAUNCHER.is_warm = True
        import_all()
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        commands = [each for each in COMMANDS if not given.only or each[0] in given.only]
        counts = disturb(given.kind, given.n, given.seed, Path(folder), commands, given.state)
    for what, count in sorted(counts.items()):
        print(f"{count:5} {what}")
    return 1 if counts[FINDINGS] else 0


if __name__ == "__main__":
    sys.exit(main())
