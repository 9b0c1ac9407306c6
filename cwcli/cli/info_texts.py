"""Texts of `cwcli info`: times, the verdict on the recording, and the channels that are not used."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from cwcli.cli.tables import Cell
from cwcli.cli.text import format_count, join_names
from cwcli.signals.units import NS_PER_S

Document = dict[str, Any]
MAX_TOPIC_CHARACTERS = 120
"""Greatest length of a topic's name in the line on health, in characters; chosen by hand: no recorder writes longer
ones."""
MAX_NAMED_TOPICS = 3
"""Greatest number of topics that one line names before the others are counted. Chosen by hand."""
MAX_NAMED_FIELDS = 8
"""Greatest number of message fields that one line names before the others are counted. Chosen by hand."""


def health_verdict(document: Document) -> str:
    """Return the doctor's verdict on a log in one line, from its messages where they were read, else from its index."""
    faults = [f"{fault}: {n}" for fault, n in document["faults"].items()]
    if "health" not in document:
        empty = [channel["topic"] for channel in document["channels"] if channel["messages"] == 0]
        empty = [_shorten_topic_name(name) for name in empty]
        if empty:
            faults.append(f"no messages on {join_first_names_and_count_rest(empty, MAX_NAMED_TOPICS)}")
        return f"{'; '.join(faults) or 'no fault in the index'}; --doctor reads the messages"
    sick = {each["topic"]: text for each in document["health"] if (text := _message_troubles_text(each))}
    n = len(document["health"])
    if not sick:
        return "; ".join([*faults, f"{format_count(n, 'topic')} without gaps, drift, disorder or damage"])
    topic_texts = [f"{_shorten_topic_name(topic)} ({text})" for topic, text in sick.items()]
    return "; ".join(
        [
            *faults,
            f"trouble on {len(sick)} of {format_count(n, 'topic')}: {join_first_names_and_count_rest(topic_texts, 3)}",
        ]
    )


def _shorten_topic_name(name: str) -> str:
    """Return a topic's name, of a very long one its beginning and its length: a file can hold names of megabytes."""
    return name if len(name) <= MAX_TOPIC_CHARACTERS else f"{name[:MAX_TOPIC_CHARACTERS]}... ({len(name):,} characters)"


def _message_troubles_text(health: Document) -> str:
    """Return what is wrong with the messages of one topic, "" for nothing."""
    if health["undecodable"] < 0:
        return "it can't be read"
    facts = []
    if health["gaps"]:
        facts.append(f"{format_count(int(health['gaps']), 'gap')}, the longest {health['longest_gap_s']:.1f} s")
    if health["drift_ms_per_min"]:
        facts.append(f"the clock drifts by {health['drift_ms_per_min']:.1f} ms/min")
    if health["out_of_order"]:
        facts.append(f"{int(health['out_of_order'])} out of order")
    if health["undecodable"]:
        facts.append(f"{health['undecodable']} damaged")
    return ", ".join(facts)


def unused_channel_rows(channels: list[Document]) -> list[tuple[Cell, ...]]:
    """Return topics and reason of the channels that are not used; those with equal reasons are one row."""
    topics: dict[str, list[str]] = {}
    for channel in channels:
        if channel["why_not"]:
            fields = channel["fields"]
            known = f"; fields: {join_first_names_and_count_rest(fields, MAX_NAMED_FIELDS)}" if fields else ""
            topics.setdefault(f"{channel['why_not']}{known}", []).append(channel["topic"])
    return [(join_first_names_and_count_rest(names, MAX_NAMED_TOPICS), reason) for reason, names in topics.items()]


def join_first_names_and_count_rest(names: list[str], max_names: int) -> str:
    """Join the first names to a text, with the number of the others."""
    more = len(names) - max_names
    return join_names([*names[:max_names], *([f"{more:,} more"] if more > 0 else [])])


def format_utc_time(time_ns: int) -> str:
    """Format a Unix time as `2026-05-01 12:00:00.123 UTC`."""
    seconds, rest = divmod(time_ns, NS_PER_S)
    try:
        moment = datetime.fromtimestamp(seconds, UTC)
    except (OverflowError, ValueError, OSError):
        return f"{time_ns} ns"
    return f"{moment:%Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03d} UTC"
