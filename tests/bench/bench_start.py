"""How long `cwcli --help` and `cwcli info` take as processes, against `python -c "import numpy"`, in one run.

    python tests/bench/bench_start.py [LOG]

The three take turns, so that a busy machine slows all of them; the best of the rounds counts. Prints a Markdown table
and exits with 1 when a ratio is above its bound.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

ROUNDS = 20
BOUND = 2.0
ROOT = Path(__file__).parents[2]


def seconds(arguments: list[str]) -> float:
    """Wall time of one process."""
    begin = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
    return time.perf_counter() - begin


def main() -> int:
    """Measure and print."""
    log = sys.argv[1] if len(sys.argv) > 1 else "sample_logs/intersection.mcap"
    measured = {
        'python -c "import numpy"': ["-c", "import numpy"],
        "cwcli --help": ["-m", "cwcli", "--help"],
        f"cwcli info {log}": ["-m", "cwcli", "info", log],
    }
    best_s = dict.fromkeys(measured, float("inf"))
    for _ in range(ROUNDS):
        for name, arguments in measured.items():
            best_s[name] = min(best_s[name], seconds(arguments))
    base_s = next(iter(best_s.values()))
    print("| process | best of 20 [ms] | ratio | bound |\n|---|---|---|---|")
    for name, value_s in best_s.items():
        print(f"| `{name}` | {1000 * value_s:.0f} | {value_s / base_s:.2f} | {BOUND:g} |")
    return int(max(best_s.values()) > BOUND * base_s)


if __name__ == "__main__":
    sys.exit(main())
