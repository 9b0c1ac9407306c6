"""Writes a clip of each event: the part of its log around it, cut byte for byte."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

from cwcli.events.search import FoundEvent
from cwcli.logs.read.reader import Log
from cwcli.logs.write.cut import MAX_LOG_TIME_NS, CutSpan, cut_log
from cwcli.output import make_folder, refuse_unwritable_targets
from cwcli.signals.units import NS_PER_S
from cwcli.text import map_to_distinct_endings

MAX_LOG_NAME_CHARACTERS_IN_CLIP_NAME = 80
"""Longest part of a clip's name that comes from the log's name, in characters; chosen by hand."""


def clip_file_name(event: FoundEvent, log_name: str) -> str:
    """Return the file name of an event's clip: the log's distinct name, event and id."""
    stem = log_name.removesuffix(".mcap") or "log"
    stem = re.sub(r"[^\w.-]+", "_", stem)[:MAX_LOG_NAME_CHARACTERS_IN_CLIP_NAME]
    return f"{stem}_{event.event}_{event.id}.mcap"


def write_clips(
    found: Sequence[FoundEvent],
    paths: dict[str, str],
    folder: str | Path,
    open_log: Callable[[str], Log],
    *,
    margin_s: float,
    force: bool = False,
    step: Callable[[int, str], None] = lambda done, name: None,
) -> dict[tuple[str, str], str]:
    """Write the clips of some events; return key of the event -> file name.

    A clip that is there already is refused before the first is written; another error leaves those before it.

    Args:
        paths: Name of a log -> its path.
        folder: Where the clips lie; created if it does not exist.
        open_log: Opens a log by its path.
        margin_s: How much of the log a clip holds before and after the event, s.
        step: Called with the number of the clip and its name before it is written.

    Raises:
        OutputError: The folder or a clip can't be written.
        InputError: A log is damaged.
    """
    log_names = map_to_distinct_endings(paths)
    targets = {event.key: Path(folder) / clip_file_name(event, log_names[event.log]) for event in found}
    if found:
        make_folder(folder)
    refuse_unwritable_targets(list(targets.values()), force=force)
    file_by_event: dict[tuple[str, str], str] = {}
    by_log: dict[str, list[FoundEvent]] = {}
    for event in found:
        by_log.setdefault(event.log, []).append(event)
    margin_ns = round(margin_s * NS_PER_S)
    for name, events in by_log.items():
        with open_log(paths[name]) as log:
            for event in events:
                target = targets[event.key]
                step(len(file_by_event), target.name)
                span = CutSpan(
                    max(event.moment.start_ns - margin_ns, 0), min(event.moment.end_ns + margin_ns, MAX_LOG_TIME_NS)
                )
                cut_log(log, span, target, force=force)
                file_by_event[event.key] = str(target)
    return file_by_event
