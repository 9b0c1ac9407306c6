#!/usr/bin/env bash
# Every benchmark of the spine, one after the other, on this machine: bash tests/bench/run.sh
# Needs the development extra. Use an idle machine; the numbers of docs/performance.md come from here.
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
export PYTHONPATH=.
unset PYTHONDONTWRITEBYTECODE  # an installed package is compiled: without, each start takes twice as long
failed=0
for bench in "bench_read.py" "bench_read.py --images" "bench_process.py" "bench_annotate.py" "bench_ekf.py" "bench_lanes.py" "bench_fleet.py" "bench_measures.py" "bench_report.py"; do
    printf '\n## %s\n\n' "$bench"
    # shellcheck disable=SC2086 - the options are words of their own
    python tests/bench/$bench || failed=1
done
exit "$failed"
