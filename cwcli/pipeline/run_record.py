"""The metadata record `cwcli.run.<stage>`: what made the channels, from what, and how."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping
from typing import Any

from cwcli.logs.read.reader import Log
from cwcli.pipeline.result import StageSummary
from cwcli.version import __version__

INPUT_HASH_KEY = "input_sha256"
"""Entry of a record that holds the SHA-256 of the input file in hexadecimal."""


class RunRecord(Mapping[str, str]):
    """The entries of a record; the input's hash is computed in the background, and reading its entry waits for it."""

    def __init__(self, log: Log, entries: dict[str, str]) -> None:
        self._entries = entries
        self._hash = log.begin_sha256()

    def __getitem__(self, key: str) -> str:
        return self._hash.result() if key == INPUT_HASH_KEY else self._entries[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)


def build_run_record(stage: str, log: Log, config: Any, summary: StageSummary, **further_entries: str) -> RunRecord:
    """Build the record of one stage.

    Args:
        stage: Its name.
        log: Its input; the hash is that of the input file, whatever earlier stages of the run have added.
        config: The stage's resolved configuration, a dataclass.
        summary: The stage's summary, which gives the counts, tables, notes and verdict.
        further_entries: Further entries, e.g. the map's origin.
    """
    entries = {
        "version": __version__,
        "stage": stage,
        "configuration": json.dumps(dataclasses.asdict(config), sort_keys=True, default=str),
        INPUT_HASH_KEY: "",
        "counts": json.dumps(summary.to_json()["inputs"], sort_keys=True),
        **summary.to_record_entry(),
        **further_entries,
    }
    return RunRecord(log, entries)
