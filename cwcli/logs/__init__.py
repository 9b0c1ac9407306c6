"""MCAP in and out.

- `log`: opens a log; columns and frames come from it.
- `annotate`: writes the log again with more channels; `writer` writes a new one.
- `codecs/`: message encodings, one file each.

Nothing here knows what a number means (`cwcli.signals`), and no import here costs anything before it is needed: opening
a log for `cwcli info` needs neither NumPy nor the `mcap` package.
"""
