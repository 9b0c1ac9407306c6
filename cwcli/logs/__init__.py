"""MCAP in and out.

- `read/`: `reader` opens a log; columns, frames and transforms come from it.
- `write/`: `annotate` writes a log again with more channels; `writer` writes a new one.
- `format/`: the records of a file, the index of what it holds and where, and its chunks.
- `codecs/`: message encodings, one file each.

Nothing here knows what a number means (`cwcli.signals`), and no import here costs anything before it is needed: opening
a log for `cwcli info` needs neither NumPy nor the `mcap` package.
"""
