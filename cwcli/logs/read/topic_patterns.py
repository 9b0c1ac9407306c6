"""Resolves names of topics that a user gave, with `*` for any characters."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from cwcli.errors import UsageError, hint_at_closest_or_all_known_names


def topics_matching_patterns(patterns: str, known_topics: Sequence[str], where: str) -> frozenset[str]:
    """Return the topics that some patterns, separated by commas, name.

    A name that is a topic of the log stands for itself, whatever characters it has.

    Raises:
        UsageError: A pattern names no topic.
    """
    found: set[str] = set()
    for pattern in (each.strip() for each in patterns.split(",")):
        if not pattern:
            raise UsageError(f"the list of topics {patterns!r} has an empty name", where=where)
        own = (
            {pattern}
            if pattern in known_topics
            else {topic for topic in known_topics if _does_topic_match_pattern(topic, pattern)}
        )
        if not own:
            raise UsageError(
                f"no topic is called {pattern}",
                where=where,
                hint=hint_at_closest_or_all_known_names(pattern, known_topics, "topics"),
            )
        found |= own
    return frozenset(found)


def _does_topic_match_pattern(topic: str, pattern: str) -> bool:
    """Tell whether a topic matches a pattern in which `*` alone is special."""
    return fnmatchcase(topic, pattern.replace("[", "[[]").replace("?", "[?]"))
