"""What finding plug-ins costs `cwcli info`: the processor time that it spends in looking for them.

    python -m tests.bench.bench_plugins [ROUNDS]

Each round runs `cwcli info` twice, as processes of their own: with no plug-in installed, and beside a package with one
of each kind. Every call of the registries' search is timed within the process, as whole processes differ by more than
the search takes. Prints a Markdown table, and exits with 1 when the best of the rounds is above the bound.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from importlib.metadata import distributions
from pathlib import Path
from statistics import median

from tests.cli.plugin_package import install

ROUNDS = 30
BOUND_MS = 5.0
ROOT = Path(__file__).parents[2]
TIMED = """
import sys
import time
from cwcli.cli.main import run_command_line
from cwcli.registry import Registry

spent_s, search = [], Registry._plugins

def timed(registry):
    begin = time.process_time()
    found = search(registry)
    spent_s.append(time.process_time() - begin)
    return found

Registry._plugins = timed
assert run_command_line(["info", "sample_logs/intersection.mcap"]) == 0
sys.stderr.write(repr(1e3 * sum(spent_s)))
"""


def searched_ms(*folders: str) -> float:
    """Processor time of all searches of one `cwcli info`, with folders on its path."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((*folders, str(ROOT)))}
    done = subprocess.run(
        [sys.executable, "-c", TIMED], check=True, cwd=ROOT, env=environment, capture_output=True, text=True
    )
    return float(done.stderr)


def main() -> int:
    """Measure and print."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else ROUNDS
    with tempfile.TemporaryDirectory() as folder:
        beside = {"no plug-in": (), "a package with one of each kind": (str(install(Path(folder))),)}
        taken_ms: dict[str, list[float]] = {what: [] for what in beside}
        for _ in range(rounds):
            for what, folders in beside.items():
                taken_ms[what].append(searched_ms(*folders))
    n_packages = len({each.name for each in distributions()})
    print(f"| {n_packages} packages installed, and | best [ms] | median [ms] | bound |\n|---|---|---|---|")
    for what, each_ms in taken_ms.items():
        print(f"| {what} | {min(each_ms):.1f} | {median(each_ms):.1f} | {BOUND_MS:g} |")
    return int(max(map(min, taken_ms.values())) > BOUND_MS)


if __name__ == "__main__":
    sys.exit(main())
