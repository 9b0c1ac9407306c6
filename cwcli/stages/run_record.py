"""The metadata record `cwcli.run.<stage>`: what made the channels, from what, and how."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

from cwcli import __version__
from cwcli.logs.log import Log
from cwcli.stages.result import Summary


def run_record(stage: str, log: Log, config: Any, summary: Summary, **more: str) -> dict[str, str]:
    """The record of one stage.

    Args:
        stage: Its name.
        log: Its input; the hash is of the file as it came in, before any stage of the same run.
        config: The stage's resolved configuration, a dataclass.
        summary: For the counts.
        more: Further entries, e.g. the map's origin.
    """
    return {
        "version": __version__,
        "stage": stage,
        "configuration": json.dumps(dataclasses.asdict(config), sort_keys=True, default=str),
        "input_sha256": log.sha256(),
        "counts": json.dumps(summary.to_json()["inputs"], sort_keys=True),
        **more,
    }
