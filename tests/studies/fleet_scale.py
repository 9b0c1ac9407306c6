"""What a finished run over many logs costs: its rerun, a query over its tables, its page, and the merge of its shards.

    python -m tests.studies.fleet_scale --logs 10000 --shards 8

Runs one log of five seconds, makes of its results a run over so many logs whose results are equal but for their names,
and prints processor and elapsed seconds of `cwcli run` again and of `cwcli report`, and the size of the page. With
`--shards`, it shares the same results out among folders of shards, merges these, and compares the files with those of
the whole run, merged alone.
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

from cwcli.fleet.folder import ANNOTATED_LOG_NAME, SHARD_KEY, write_json_object
from cwcli.fleet.input_states import INPUT_STATES_KEY, FileState, file_states_to_document, read_file_state
from cwcli.fleet.shard import Shard
from tests.cli.fleet_logs import cut

ROOT = Path(__file__).parents[2]
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


def measure_merge(folder: Path, states: dict[str, FileState], n_shards: int) -> None:
    """Share the results out among shards, merge these, and compare with the whole run."""
    names = []
    for k in range(1, n_shards + 1):
        shard = Shard(k, n_shards)
        names.append(f"shards/{k}")
        own = {id: states[id] for id in shard.select_shard_items(list(states))}
        multiply_run(folder / "base", folder / names[-1], own, shard)
    measure(folder, "merge", *names, "-d", "merged")
    measure(folder, "merge", "out", "-d", "whole")
    names = sorted(path.relative_to(folder / "whole") for path in (folder / "whole").rglob("*") if path.is_file())
    equal = [filecmp.cmp(folder / "whole" / each, folder / "merged" / each, shallow=False) for each in names]
    print(f"{sum(equal)} of {len(names)} files of the merged shards equal those of the whole run, merged alone")


def measure(folder: Path, *arguments: str) -> None:
    """Run a command and print its processor and elapsed seconds."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = subprocess.run([sys.executable, "-m", "cwcli", *arguments], check=False, cwd=folder, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"cwcli {' '.join(arguments)}: exit {done.returncode}, {cpu_s:.2f} s processor,", end=" ")
    print(f"{time.monotonic() - begin:.2f} s, at most {after.ru_maxrss / 1000:.0f} MB")
    print("\n".join((done.stdout + done.stderr).decode().splitlines()[-3:]))


def main() -> None:
    """Run the study."""
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
        for _ in range(2):
            measure(folder, "run", "logs", "-d", "out")
        import duckdb

        begin = time.process_time()
        n = len(duckdb.sql(QUERY.format(folder / "out")).fetchall())
        print(f"DuckDB: {n} metrics in {time.process_time() - begin:.2f} s processor")
        if not arguments.no_page:
            measure(folder, "report", "out", "-o", "page.html")
            print(f"page {(folder / 'page.html').stat().st_size / 1e6:.2f} MB")
        if arguments.shards:
            measure_merge(folder, states, arguments.shards)


if __name__ == "__main__":
    main()
