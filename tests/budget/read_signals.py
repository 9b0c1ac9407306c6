"""Reads all columns of a log's signals: `python read_signals.py LOG TIMES`."""

import sys
from pathlib import Path

from cwcli.logs.read.reader import Log

for _ in range(int(sys.argv[2])):
    with Log.open(Path(sys.argv[1])) as log:
        for topic in sorted({channel.topic for channel in log.channels}):
            log.columns(topic)
