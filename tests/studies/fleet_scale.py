"""What a finished run over many logs costs: its rerun, a query over its tables, and its page.

    python -m tests.studies.fleet_scale --logs 10000

Runs one log of five seconds, makes of its results a run over so many logs whose results are equal but for their names,
and prints processor and elapsed seconds of `cwcli run` again and of `cwcli report`, and the size of the page.
"""

from __future__ import annotations

import argparse
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

from cwcli.fleet.folder import ANNOTATED_LOG_NAME, write_json_object
from cwcli.fleet.input_states import INPUTS_KEY, read_file_state, file_states_to_document
from tests.cli.fleet_logs import cut

ROOT = Path(__file__).parents[2]
QUERY = "select metric, avg(value) from '{}/metrics.parquet' where metric like 'ego.%' group by metric"


def multiply_run(folder: Path, n_logs: int, options: tuple[str, ...]) -> None:
    """Make `logs/` and `out/` of a finished run over many logs."""
    (folder / "one").mkdir()
    cut(ROOT / "sample_logs" / "intersection.mcap", folder / "one" / "drive.mcap", seconds=5.0)
    command = [sys.executable, "-m", "cwcli", "run", "one", "-d", "base", "-q", *options]
    subprocess.run(command, check=True, cwd=folder)
    base, out, logs = folder / "base", folder / "out", folder / "logs"
    logs.mkdir()
    manifest = json.loads((base / "manifest.json").read_text())
    (entry,) = manifest["logs"]
    ids = [f"drive{k:06}" for k in range(n_logs)]
    states = {}
    for id in ids:
        (logs / f"{id}.mcap").write_bytes(b"its state says that it was read")
        state = read_file_state(str(logs / f"{id}.mcap"))
        assert state is not None
        states[id] = state
        (out / "logs" / id).mkdir(parents=True)
        os.link(base / "logs/drive" / ANNOTATED_LOG_NAME, out / "logs" / id / ANNOTATED_LOG_NAME)
    manifest["logs"] = [
        {**entry, "id": id, "source": f"logs/{id}.mcap", "outputs": [f"logs/{id}/{ANNOTATED_LOG_NAME}"]} for id in ids
    ]
    for name in manifest["tables"]:
        table = pq.read_table(base / f"{name}.parquet")
        copies = [table.set_column(0, "log", pa.array([id] * len(table), pa.string())) for id in ids]
        (out / name).parent.mkdir(exist_ok=True)
        pq.write_table(pa.concat_tables(copies), out / f"{name}.parquet", compression="zstd", row_group_size=65_536)
    write_json_object(manifest, out / "manifest.json")
    times = {id: {"status": "done", "wall_s": 1.0, "cpu_s": 1.0, "peak_mb": 1.0, "attempts": 1} for id in ids}
    write_json_object({"logs": times, INPUTS_KEY: file_states_to_document(states)}, out / "run_times.json")


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
    parser.add_argument("--no-page", action="store_true", help="leave out the page")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        multiply_run(folder, arguments.logs, ())
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


if __name__ == "__main__":
    main()
