"""Numbers in the docs are outputs: result files, the markers that show them in pages, and the studies behind them.

python -m tools.results                 rerun every study, write docs/results/*.json, fill the pages
python -m tools.results --check         compare the pages with the result files; no study runs
python -m tools.results --check --small rerun a small seed set of each study, too, and compare
"""
