"""What a finished run over many logs costs: its rerun, a query over its tables, its page, and the merge of its shards.

    python -m tests.studies.fleet_scale --logs 10000 --shards 8

Runs one log of five seconds, makes of its results a run over so many logs whose results are equal but for their names,
and prints processor and elapsed seconds of `cwcli run` again and of `cwcli report`, the size of the page, and how long
Chromium takes to open it. With `--shards`, it shares the same results out among folders of shards, merges these, and
compares the files with those of the whole run, merged alone.
"""

from __future__ import annotations

import argparse
import filecmp
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from cwcli.fleet.folder import ANNOTATED_LOG_NAME, LOG_ENTRY_FILE_NAME, SHARD_KEY, write_json_object
from cwcli.fleet.input_states import INPUT_STATES_KEY, FileState, file_states_to_document, read_file_state
from cwcli.fleet.shard import Shard
from tests.cli.browser import time_opening
from tests.cli.fleet_logs import cut

ROOT = Path(__file__).parents[2]
MAX_RERUN_S, MAX_QUERY_S, MAX_MERGE_S, MAX_MERGE_MB, MAX_PAGE_MB, MAX_OPENING_S = 3.0, 1.0, 60.0, 300.0, 5.0, 2.0
RUN_AND_TELL_MEMORY = """
import sys
from cwcli.cli.main import run_command_line
code = run_command_line(sys.argv[1:])
sys.stdout.flush()
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")), flush=True)
sys.exit(code)
"""
"""A program that runs a command and prints its greatest memory [kB]; what a parent is told holds its own memory, too."""
QUERY = "select metric, avg(value) from '{}/metrics.parquet' where metric like 'ego.%' group by metric"


def run_one_log(folder: Path) -> None:
    """Run a log of five seconds; its results are in `base/`."""
    (folder / "one").mkdir()
    cut(ROOT / "sample_logs" / "intersection.mcap", folder / "one" / "drive.mcap", seconds=5.0)
    command = [sys.executable, "-m", "cwcli", "run", "one", "-d", "base", "-q"]
    subprocess.run(command, check=True, cwd=folder)


def write_inputs(folder: Path, ids: list[str]) -> dict[str, FileState]:
    """Write an input of each log, which no rerun reads; return their states."""
    folder.mkdir()
    states = {}
    for id in ids:
        (folder / f"{id}.mcap").write_bytes(b"its state says that it was read")
        state = read_file_state(str(folder / f"{id}.mcap"))
        assert state is not None
        states[id] = state
    return states


def multiply_run(base: Path, out: Path, states: dict[str, FileState], shard: Shard | None = None) -> None:
    """Write the folder of a finished run whose logs all have the results of the one log in `base`."""
    manifest = json.loads((base / "manifest.json").read_text())
    (entry,) = manifest["logs"]
    for id in states:
        (out / "logs" / id).mkdir(parents=True)
        os.link(base / "logs/drive" / ANNOTATED_LOG_NAME, out / "logs" / id / ANNOTATED_LOG_NAME)
    manifest["logs"] = [
        {**entry, "id": id, "source": f"logs/{id}.mcap", "outputs": [f"logs/{id}/{ANNOTATED_LOG_NAME}"]}
        for id in states
    ]
    for each in manifest["logs"]:
        write_json_object(each, out / "logs" / each["id"] / LOG_ENTRY_FILE_NAME)
    if shard is not None:
        manifest[SHARD_KEY] = {"index": shard.index, "count": shard.count}
    for name in manifest["tables"]:
        table = pq.read_table(base / f"{name}.parquet")
        copies = [table.set_column(0, "log", pa.array([id] * len(table), pa.string())) for id in states]
        (out / name).parent.mkdir(exist_ok=True)
        pq.write_table(pa.concat_tables(copies), out / f"{name}.parquet", compression="zstd", row_group_size=65_536)
    write_json_object(manifest, out / "manifest.json")
    times = {id: {"status": "done", "wall_s": 1.0, "cpu_s": 1.0, "peak_mb": 1.0, "attempts": 1} for id in states}
    write_json_object({"logs": times, INPUT_STATES_KEY: file_states_to_document(states)}, out / "run_times.json")


def measure_merge(folder: Path, states: dict[str, FileState], n_shards: int) -> bool:
    """Share the results out among shards, merge these, and compare with the whole run; return whether all is well."""
    names = []
    for k in range(1, n_shards + 1):
        shard = Shard(k, n_shards)
        names.append(f"shards/{k}")
        own = {id: states[id] for id in shard.select_shard_items(list(states))}
        multiply_run(folder / "base", folder / names[-1], own, shard)
    cpu_s, memory_mb = measure(folder, "merge", *names, "-d", "merged")
    measure(folder, "merge", "out", "-d", "whole")
    names = sorted(path.relative_to(folder / "whole") for path in (folder / "whole").rglob("*") if path.is_file())
    equal = [filecmp.cmp(folder / "whole" / each, folder / "merged" / each, shallow=False) for each in names]
    print(f"{sum(equal)} of {len(names)} files of the merged shards equal those of the whole run, merged alone")
    return all(equal) and cpu_s < MAX_MERGE_S and memory_mb < MAX_MERGE_MB


def measure(folder: Path, *arguments: str) -> tuple[float, float]:
    """Run a command, print its processor and elapsed seconds; return the former, and its greatest memory, MB."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = subprocess.run([sys.executable, "-c", RUN_AND_TELL_MEMORY, *arguments], cwd=folder, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"cwcli {' '.join(arguments)}: exit {done.returncode}, {cpu_s:.2f} s processor,", end=" ")
    *said, memory_kb = (done.stderr + done.stdout).decode().splitlines()
    print(f"{time.monotonic() - begin:.2f} s, at most {int(memory_kb) / 1000:.0f} MB", *said[-3:], sep="\n")
    return cpu_s, int(memory_kb) / 1000


def open_page(page: Path, folder: Path) -> float:
    """Open a page three times in a browser of its own; return the least time to the load event, s."""
    loads_s = []
    for k in range(3):
        (folder / f"browser{k}").mkdir()
        times = time_opening(page, folder / f"browser{k}")
        print(f"opened: painted after {times.paint_s:.2f} s, loaded after {times.load_s:.2f} s,", end=" ")
        print(f"scripts at rest after {times.rest_s:.2f} s")
        loads_s.append(times.load_s)
    return min(loads_s)


def main() -> int:
    """Run the study; returns 1 where a bound is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=int, default=10_000)
    parser.add_argument("--shards", type=int, default=0, help="merge so many shards, too")
    parser.add_argument("--no-page", action="store_true", help="leave out the page")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run_one_log(folder)
        states = write_inputs(folder / "logs", [f"drive{k:06}" for k in range(arguments.logs)])
        multiply_run(folder / "base", folder / "out", states)
        print(f"manifest.json {(folder / 'out/manifest.json').stat().st_size / 1e6:.1f} MB")
        rerun_s = min(measure(folder, "run", "logs", "-d", "out")[0] for _ in range(2))
        import duckdb

        begin = time.process_time()
        n = len(duckdb.sql(QUERY.format(folder / "out")).fetchall())
        query_s = time.process_time() - begin
        print(f"DuckDB: {n} metrics in {query_s:.2f} s processor")
        is_well = rerun_s < MAX_RERUN_S and query_s < MAX_QUERY_S
        if arguments.shards:  # before the page, whose memory would count
            is_well &= measure_merge(folder, states, arguments.shards)
        if not arguments.no_page:
            measure(folder, "report", "out", "-o", "page.html")
            size_mb = (folder / "page.html").stat().st_size / 1e6
            print(f"page {size_mb:.2f} MB")
            is_well &= size_mb < MAX_PAGE_MB and open_page(folder / "page.html", folder) < MAX_OPENING_S
    return int(not is_well)


if __name__ == "__main__":
    sys.exit(main())
