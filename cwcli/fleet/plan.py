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
from cwcli.input import MAX_CHUNK_BYTES, MAX_RATIO
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.read_bounds import DEFAULT_TIMEOUT_S, MAX_PIPE_BYTES
from cwcli.pipeline.call import StageCall
from cwcli.version import __version__


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
    max_pipe_bytes: int = MAX_PIPE_BYTES
    max_ratio: float = MAX_RATIO
    strict: bool = False
    ego_station: str | None = None
    replace: bool = False
    tables: bool = False
    channels: tuple[str, ...] = ()
    rehash: bool = False
    timeout_s: float = DEFAULT_TIMEOUT_S
    shard: Shard | None = None

    def stage_calls(self) -> dict[str, StageCall]:
        """Stage calls by name, in order."""
        return {call.stage.name: call for call in self.stages}

    def cache_key(self, input_sha256: str) -> str:
        """Hash of version, input and options; an equal key means equal results.

        `max_pipe_bytes`, `timeout_s`, `rehash` and `shard` are no part of it, nor, without `--recover`, `max_ratio`:
        a log that was read within one bound gives the same results within another.
        """
        settings = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        settings["stages"] = [[call.stage.name, dataclasses.asdict(call.config)] for call in self.stages]
        del settings["pipeline"], settings["max_pipe_bytes"], settings["timeout_s"], settings["rehash"]
        del settings["shard"]
        if not self.recover:
            del settings["max_ratio"]
        basis = json.dumps([__version__, input_sha256, settings], sort_keys=True, default=str)
        return hashlib.sha256(basis.encode()).hexdigest()


@dataclass(frozen=True)
class TaskResult:
    """The result of one log.

    Attributes:
        id: Id of the log.
        status: `done`, `failed`, or `unchanged` if an earlier run had written the same.
        wall_s, cpu_s: Run times.
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
        id: Its safe, unique name.
        source: As the user named it, or as a pattern matched it.
        path: The file, absolute; a URL for a remote one.
        out: The output folder, absolute.
    """

    id: str
    source: str
    path: str
    out: str
