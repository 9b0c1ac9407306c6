"""Large arrays beyond a bound lie in a file: the same numbers, less memory, and nothing left behind."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ON_LINUX = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere arrays lie in memory")
BEGIN = """
import os, re, resource, sys, tempfile, time
from pathlib import Path
import numpy as np
from cwcli import array_memory
from cwcli.kernels import spill
array_memory.MAX_LARGE_ARRAY_BYTES_IN_MEMORY, array_memory.MAX_MAPPED_BYTES_OF_ARRAY_FILE = 32 << 20, 16 << 20
def anonymous_mb():
    return int(re.search(r"RssAnon:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) / 1024
def mapped_mb():
    return int(re.search(r"RssFile:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) / 1024
"""


def run_here(script: str, folder: Path, **environment: str) -> str:
    """What a process of its own prints: whoever bounds the memory of arrays does it for the whole process."""
    done = subprocess.run(
        [sys.executable, "-c", BEGIN + script],
        capture_output=True,
        check=False,
        text=True,
        cwd=folder,
        env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin", "TMPDIR": str(folder), **environment},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@ON_LINUX
def test_arrays_beyond_the_bound_take_no_memory_and_keep_their_numbers(tmp_path: Path) -> None:
    script = """
array_memory.bound_array_memory_and_get_old_handler()
before, mapped = anonymous_mb(), mapped_mb()
held = [np.full(1 << 18, k, float) for k in range(200)]  # of 2 MB each
assert all((each == k).all() for k, each in enumerate(held))
end = time.monotonic() + 600.0  # the thread that lets pages go may not have had a processor for a while
while mapped_mb() - mapped >= 48.0 and time.monotonic() < end:
    time.sleep(0.02)
print(anonymous_mb() - before, mapped_mb() - mapped, spill.counts()["in_file"] >> 20, os.listdir("."))
"""
    grown, mapped, in_file, left = run_here(script, tmp_path).split(maxsplit=3)
    assert float(grown) < 40.0
    assert float(mapped) < 48.0  # the bound, what was handed out since the last look, and a library
    assert int(in_file) == 370  # 400 MB but 15 arrays, which take a page more than 2 MB each
    assert left.strip() == "[]"


@ON_LINUX
def test_arrays_stay_apart_whatever_is_made_and_dropped(tmp_path: Path) -> None:
    script = """
array_memory.bound_array_memory_and_get_old_handler()
rng = np.random.default_rng(3)
held = [np.zeros(0)] * 40
for k in range(1200):
    i, n = int(rng.integers(40)), int(rng.integers(1, 400_000))
    kind = k % 4
    if kind == 0:
        held[i] = np.full(n, i, float)
    elif kind == 1:
        held[i] = np.zeros(n)
        assert not held[i].any()
        held[i] += i
    elif kind == 2:
        held[i] = held[i].copy()
        before = len(held[i])
        held[i].resize(n, refcheck=False)
        assert (held[i][:before] == i).all() and not held[i][before:].any()
        held[i][before:] = i
    else:
        held[i] = np.fromiter((i for _ in range(n // 8)), float)
    j = int(rng.integers(40))
    assert (held[j] == j).all(), (k, j)
counts = spill.counts()
assert counts["most_in_file"] > 16 << 20, counts
assert counts["file"] < 3 * counts["most_in_file"], counts
held.clear()
counts = spill.counts()
assert counts["in_file"] == 0 and counts["held"] < 2 << 20, counts
"""
    run_here(script, tmp_path)


@ON_LINUX
def test_a_full_disk_leaves_the_arrays_in_memory(tmp_path: Path) -> None:
    script = """
resource.setrlimit(resource.RLIMIT_FSIZE, (8 << 20, 8 << 20))
array_memory.bound_array_memory_and_get_old_handler()
held = [np.full(1 << 18, k, float) for k in range(40)]
assert all((each == k).all() for k, each in enumerate(held))
print(spill.counts()["in_file"])
"""
    assert int(run_here(script, tmp_path)) <= 8 << 20


@ON_LINUX
def test_few_addresses_leave_the_arrays_in_memory(tmp_path: Path) -> None:
    script = """
resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
array_memory.bound_array_memory_and_get_old_handler()
held = [np.full(1 << 18, k, float) for k in range(60)]
assert all((each == k).all() for k, each in enumerate(held))
huge = np.full(1 << 20, 2.0)
print(spill.counts()["in_file"] >> 20)
"""
    assert int(run_here(script, tmp_path)) == 98  # 120 MB and 8, but the same


@ON_LINUX
def test_threads_are_bounded_too(tmp_path: Path) -> None:
    script = """
from cwcli.estimation.track import map_in_threads
array_memory.bound_array_memory_and_get_old_handler()
held = map_in_threads(lambda k: np.full(1 << 18, k, float), range(60))
assert all((each == k).all() for k, each in enumerate(held))
print(spill.counts()["in_file"] >> 20)
"""
    assert int(run_here(script, tmp_path)) >= 80


@ON_LINUX
def test_a_forked_process_leaves_its_parents_arrays_alone(tmp_path: Path) -> None:
    script = """
array_memory.bound_array_memory_and_get_old_handler()
held = [np.full(1 << 18, k, float) for k in range(60)]
child = os.fork()
if not child:
    same = all((each == k).all() for k, each in enumerate(held))
    for each in held:
        each[:] = -1.0
    wrote = all((each == -1.0).all() for each in held)
    held.clear()
    own = [np.full(1 << 18, -2.0) for _ in range(60)]
    os._exit(0 if same and wrote and all((each == -2.0).all() for each in own) else 1)
status = os.waitpid(child, 0)[1]
assert all((each == k).all() for k, each in enumerate(held))
print(status, spill.counts()["in_file"] >> 20)
"""
    status, in_file = run_here(script, tmp_path).split()
    assert status == "0"
    assert int(in_file) >= 80


@ON_LINUX
@pytest.mark.skipif(not Path("/dev/shm").is_dir(), reason="no folder in memory")
def test_a_folder_in_memory_gets_no_arrays(tmp_path: Path) -> None:
    script = """
array_memory.LARGE_ARRAY_FOLDER = "/dev/shm"
array_memory.bound_array_memory_and_get_old_handler()
held = [np.full(1 << 18, k, float) for k in range(40)]
print(spill.counts()["in_file"])
"""
    assert int(run_here(script, tmp_path, TMPDIR="/dev/shm")) == 0


@ON_LINUX
def test_small_arrays_and_few_stay_in_memory(tmp_path: Path) -> None:
    script = """
array_memory.bound_array_memory_and_get_old_handler()
few = [np.full(1 << 18, k, float) for k in range(15)]
small = [np.full(1 << 10, k, float) for k in range(10_000)]
print(spill.counts()["in_file"])
"""
    assert int(run_here(script, tmp_path)) == 0


@ON_LINUX
def test_without_a_folder_for_temporary_files_another_one_on_a_disk_serves(tmp_path: Path) -> None:
    script = """
def none_usable():
    raise FileNotFoundError(2, "No usable temporary directory found")
tempfile.gettempdir = none_usable
array_memory.LARGE_ARRAY_FOLDER = os.getcwd()
array_memory.bound_array_memory_and_get_old_handler()
held = [np.full(1 << 18, k, float) for k in range(60)]
print(spill.counts()["in_file"] >> 20)
"""
    assert int(run_here(script, tmp_path)) >= 80


@ON_LINUX
def test_threads_that_begin_together_share_one_file_and_the_process_can_fork(tmp_path: Path) -> None:
    script = """
import signal, threading, time
look = spill.is_on_disk
def slow_look(fd):
    time.sleep(0.2)
    return look(fd)
spill.is_on_disk = slow_look
threads = [threading.Thread(target=array_memory.bound_array_memory_and_get_old_handler) for _ in range(4)]
for each in threads:
    each.start()
for each in threads:
    each.join()
links = [each for each in Path("/proc/self/fd").iterdir() if each.is_symlink()]
print(sum("deleted" in os.readlink(each) for each in links), flush=True)
signal.alarm(10)
child = os.fork()
if not child:
    os._exit(0)
print(os.waitpid(child, 0)[1])
"""
    assert run_here(script, tmp_path).split() == ["1", "0"]


@ON_LINUX
def test_a_second_file_is_refused_and_closed(tmp_path: Path) -> None:
    script = """
array_memory.bound_array_memory_and_get_old_handler()
before = len(os.listdir("/proc/self/fd"))
array_memory._open_file_and_get_memory_handler.cache_clear()
array_memory.bound_array_memory_and_get_old_handler()
print(len(os.listdir("/proc/self/fd")) - before)
"""
    assert int(run_here(script, tmp_path)) == 0


@ON_LINUX
def test_an_array_that_grew_into_the_file_leaves_no_memory_behind(tmp_path: Path) -> None:
    script = """
array_memory.bound_array_memory_and_get_old_handler()
before = anonymous_mb()
for _ in range(6):
    grown = np.ones(2 << 20)  # 16 MB, in memory
    grown.resize(4 << 20, refcheck=False)
    assert spill.counts()["in_file"] >= 32 << 20
    del grown
print(anonymous_mb() - before)
"""
    assert float(run_here(script, tmp_path)) < 24.0
