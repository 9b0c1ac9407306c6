"""The work of a run as values that can be sent to another process."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import field
from typing import Any

from cwcli.fleet.input_states import FileState
from cwcli.fleet.shard import Shard
from cwcli.fleet.table_schemas import TABLES_SCHEMA_VERSION
from cwcli.input import MAX_CHUNK_BYTES, MAX_UNPACKED_TO_STORED_SIZE_RATIO
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.read_bounds import DEFAULT_MAX_INPUT_BYTES_OF_PIPE_OR_URL, DEFAULT_TIMEOUT_S
from cwcli.pipeline.call import StageCall
from cwcli.version import __version__

RUN_ID_CHARACTERS = 16
"""Length of a run's id, hexadecimal digits: two of a million pipelines are equal with a probability of 3e-8."""


@dataclass(frozen=True)
class FleetPlan:
    """Stages and options that are the same for every log of a run.

    Attributes:
        stages: In the order in which they run.
        pipeline: The resolved options, as the manifest shows them (JSON-ready).
        topic, start, end, recover, max_chunk_bytes, max_pipe_bytes, max_ratio, strict, timeout_s: The reading
            options of the command line.
        ego_station: V2X station of the ego, or None.
        replace: Leave channels of an earlier run out of the annotated log.
        tables: Write the channels' columns too.
        annotate: Write the annotated logs.
        channels: Patterns of the new channels that are written into the annotated logs; empty for all.
        shard: The part of the logs that this run does; None: all.
        rehash: Hash every log again, also where the state of its file says that it has not changed.
    """

    stages: tuple[StageCall, ...]
    pipeline: Mapping[str, Any] = field(default_factory=dict)
    topic: tuple[str, ...] = ()
    start: str | None = None
    end: str | None = None
    recover: bool = False
    max_chunk_bytes: int = MAX_CHUNK_BYTES
    max_pipe_bytes: int = DEFAULT_MAX_INPUT_BYTES_OF_PIPE_OR_URL
    max_ratio: float = MAX_UNPACKED_TO_STORED_SIZE_RATIO
    strict: bool = False
    ego_station: str | None = None
    replace: bool = False
    tables: bool = False
    annotate: bool = True
    channels: tuple[str, ...] = ()
    rehash: bool = False
    timeout_s: float = DEFAULT_TIMEOUT_S
    shard: Shard | None = None

    def stage_calls(self) -> dict[str, StageCall]:
        """Stage calls by name, in order."""
        return {call.stage.name: call for call in self.stages}

    def cache_key(self, input_sha256: str) -> str:
        """Hash of version, input and options; an equal key means equal results."""
        return make_cache_key(self.settings_hash(), input_sha256)

    @property
    def run_id(self) -> str:
        """What runs of one version with equal options have in common, over whichever logs."""
        return self.settings_hash()[:RUN_ID_CHARACTERS]

    def settings_hash(self) -> str:
        """Hash of version and options.

        `max_pipe_bytes`, `timeout_s`, `rehash` and `shard` are no part of it, nor, without `--recover`, `max_ratio`:
        a log that was read within one bound gives the same results within another.
        """
        settings = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        settings["stages"] = [[call.stage.name, dataclasses.asdict(call.config)] for call in self.stages]
        for name in ("pipeline", "max_pipe_bytes", "timeout_s", "rehash", "shard"):
            del settings[name]
        if not self.recover:
            del settings["max_ratio"]
        basis = json.dumps([__version__, TABLES_SCHEMA_VERSION, settings], sort_keys=True, default=str)
        return hashlib.sha256(basis.encode()).hexdigest()


def make_cache_key(settings_hash: str, input_sha256: str) -> str:
    """Hash of `FleetPlan.settings_hash` and the hash of a log."""
    return hashlib.sha256(f"{settings_hash} {input_sha256}".encode()).hexdigest()


@dataclass(frozen=True)
class TaskResult:
    """The result of one log.

    Attributes:
        status: `done`, `failed`, or `unchanged` if an earlier run had written the same.
        peak_mb: Largest memory of the worker up to now.
        attempts: Number of attempts; more than one if a worker died, none if the log was not read.
        input_state: State of the log's file when it was read; None if it failed, or is not one plain file.
    """

    id: str
    status: str
    wall_s: float
    cpu_s: float
    peak_mb: float = 0.0
    attempts: int = 1
    input_state: FileState | None = None


@dataclass(frozen=True)
class LogTask:
    """One log of a run.

    Attributes:
        source: As the user named it, or as a pattern matched it.
        path: The file, absolute; a URL for a remote one.
        has_tables: The tables of the run in it are whole, with the rows of all logs that are done.
    """

    id: str
    source: str
    path: str
    out: str
    has_tables: bool = True
