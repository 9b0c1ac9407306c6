"""Commands that are disturbed at random moments: `python -m tests.disturb --help`.

They are killed, find no room, their input changes, their folder for temporary files goes, or they run twice at once.

What must hold of every one of them: no file of its outputs is a part of one, or a mixture of two logs; nothing else is
left; the same command, run again, gives what an undisturbed one gives; and it ends by itself with a documented code.
"""

from __future__ import annotations

import argparse
import os
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
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_BAD_INPUT, EXIT_OUTPUT
from tests.unit.importing import files
from tests.unit.logs_read.test_bags import bag, recording

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_logs"
LONGEST_S = 600
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
)
"""Each names its input second: that is what changes."""
WHOLE = (".mcap", ".csv", ".parquet", ".html", ".toml")
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


def start(folder: Path, command: tuple[str, ...], limit_bytes: int | None = None) -> subprocess.Popen[bytes]:
    """The command, in a group of processes of its own; `limit_bytes` is the longest file that it can write."""
    process = subprocess.Popen(
        [sys.executable, "-m", "cwcli", *command],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1", "TMPDIR": str(folder / "tmp")},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    if limit_bytes is not None:  # it is still about to start
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))
    return process


def ended(process: subprocess.Popen[bytes]) -> tuple[int, str]:
    """Its exit code and what it said."""
    _, said = process.communicate(timeout=LONGEST_S)
    return process.returncode, said.decode(errors="replace")


def outputs(folder: Path) -> Files:
    """The files below `out` that are the same in every run."""
    paths = (path for path in (folder / "out").rglob("*") if path.suffix in WHOLE)
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


@cache
def inputs() -> Inputs:
    """Inputs of every kind."""
    one, two = ((SAMPLES / f"{name}.mcap").read_bytes() for name in ("intersection", "rear-end"))
    found = {"log.mcap": (one, two), "other.mcap": (two, two)}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        annotated = []
        for log in ("intersection", "rear-end"):
            assert run_command_line(["run", str(SAMPLES / f"{log}.mcap"), "-o", str(folder / log), "--quiet"]) == 0
            annotated.append((folder / log).read_bytes())
        found["annotated.mcap"] = annotated[0], annotated[1]
        bags = (bag(folder / f"{each}.bag", each).read_bytes() for each in (None, Writer.CompressionFormat.LZ4))
        databases = (
            next(recording(folder / f"{mode}", StoragePlugin.SQLITE3, mode).glob("*.db3*")).read_bytes()
            for mode in (None, CompressionMode.MESSAGE)
        )
        csv, ubx = (make(folder)[0].read_bytes() for make in (files.csv_logger, files.ubx))
        found |= {"drive.bag": (next(bags), next(bags)), "drive.db3": (next(databases), next(databases))}
        found |= {"drive.csv": (csv, csv[: csv.rindex(b"\n", 0, -9999) + 1]), "drive.ubx": (ubx, ubx[:30_000])}
    return found


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
    return Reference(tuple(made), took_s)


def empty(folder: Path, command: tuple[str, ...], k: int = 0) -> None:
    """A folder with the inputs, the first of the command with its content k, and nothing written."""
    for name in ("out", "tmp"):
        shutil.rmtree(folder / name, ignore_errors=True)
        (folder / name).mkdir()
    for name, contents in inputs().items():
        (folder / name).write_bytes(contents[k if name == command[1] else 0])
    (folder / "cwcli.toml").write_bytes(b"")  # no other one, of a folder above, counts


def outputs_for_present_input(folder: Path, command: tuple[str, ...]) -> Files:
    """What the command writes, undisturbed, from the inputs as they are now; the folder of outputs stays as it is."""
    (folder / "out").rename(folder / "out-before")
    (folder / "out").mkdir()
    ended(start(folder, command))
    found = outputs(folder)
    shutil.rmtree(folder / "out")
    (folder / "out-before").rename(folder / "out")
    return found


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
    """No file can grow beyond some size."""
    largest = max(map(len, known.outputs[0].values()))
    code, said = ended(start(folder, command, int(rng.integers(int(largest * 1.05)))))
    if code not in (0, EXIT_OUTPUT) or "Traceback" in said:
        raise Finding(f"it ended with {code}: {said}")
    check_outputs(folder, known)
    if code and "-d" not in command and outputs(folder):
        raise Finding(f"it ended with {code} and wrote {sorted(outputs(folder))}")
    check_again(folder, command, known.outputs[0])
    return f"ended with {code}"


def change(folder: Path, command: tuple[str, ...], known: Reference, rng: np.random.Generator) -> str:
    """The log is replaced by another one, overwritten with it, or cut."""
    path, other = folder / command[1], folder / "changed"
    changed = inputs()[command[1]][1]
    other.write_bytes(changed)
    process = start(folder, command)
    time.sleep(float(rng.uniform(0, 1.05 * known.took_s)))
    how = int(rng.integers(3))
    if how == 0:
        other.rename(path)
    elif how == 1:
        with path.open("r+b") as file:
            file.write(changed)
    else:
        os.truncate(path, int(rng.integers(path.stat().st_size)))
    code, said = ended(process)
    if code not in (0, EXIT_BAD_INPUT) or "Traceback" in said:
        raise Finding(f"it ended with {code}: {said}")
    other.unlink(missing_ok=True)
    if how == 2 and not code:  # the cut may have come before the reading, and some formats are whole after any line
        of_cut_file = outputs_for_present_input(folder, command)
        known = Reference((*known.outputs, of_cut_file), known.took_s)
    check_outputs(folder, known)
    if bool(code) == bool(outputs(folder)):
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
    if code not in (0, EXIT_OUTPUT) or "Traceback" in said:
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
        if code not in (0, EXIT_OUTPUT) or "Traceback" in said:
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


def disturb(kind: str, n: int, seed: int, folder: Path, commands: Sequence[tuple[str, ...]] = COMMANDS) -> Counter[str]:
    """Disturb commands n times; what became of them, counted.

    Raises:
        Finding: Something came out that must not.
    """
    counts: Counter[str] = Counter()
    known: dict[tuple[str, ...], Reference] = {}
    if kind == "change":  # calibrate reports a log that fails, and goes on without it
        commands = [each for each in commands if each[0] != "calibrate"]
    for k in range(n):
        rng = np.random.default_rng([seed, k])
        command = commands[k % len(commands)]
        if command not in known:
            known[command] = reference(folder, command, 2 if kind == "change" else 1)
        empty(folder, command)
        try:
            counts[KINDS[kind](folder, command, known[command], rng)] += 1
        except Finding as error:
            raise Finding(f"{kind} {k} of seed {seed} ({' '.join(command)}): {error}") from error
    return counts


def main() -> int:
    """Parse the arguments, disturb and tell."""
    parser = argparse.ArgumentParser(prog="python -m tests.disturb", description=sys.modules[__name__].__doc__)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("-n", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="where the outputs go; a small file system to fill, say")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        counts = disturb(given.kind, given.n, given.seed, Path(folder))
    for what, count in sorted(counts.items()):
        print(f"{count:5} {what}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
