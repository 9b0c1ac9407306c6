"""Loads YAML of unknown origin, after a check of its expanded size.

A few hundred bytes of YAML can expand to gigabytes: an alias repeats what an anchor names, which may contain aliases
itself. The events of the parser are counted first, each alias with its expanded size; only a document within the bounds
is loaded. Every scalar stays text: numbers, times, merge keys and tags, which cost more or run code in other loaders,
are not interpreted.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

MAX_YAML_DEPTH = 64
"""The greatest depth of lists and mappings inside each other. Chosen by hand."""


class ExpandedSize(NamedTuple):
    """The size of a part of a document with every alias expanded.

    Attributes:
        nodes: Number of scalars, lists and mappings.
        chars: Number of characters of its scalars.
    """

    nodes: int = 0
    chars: int = 0


def load_yaml(text: bytes, *, max_nodes: int, max_chars: int, max_depth: int = MAX_YAML_DEPTH) -> Any:
    """Load a document as dicts, lists and texts.

    Args:
        text: One YAML document.
        max_nodes: Greatest number of values, with every alias expanded.
        max_chars: Greatest number of characters of all values, with every alias expanded.
        max_depth: Greatest depth of lists and mappings inside each other.

    Raises:
        ValueError: It exceeds a bound.
        yaml.YAMLError: It is not YAML.
    """
    import yaml

    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    measure_expanded_size(yaml.parse(text, loader), max_nodes=max_nodes, max_chars=max_chars, max_depth=max_depth)
    return yaml.load(text, loader)


def measure_expanded_size(events: Iterable[Any], *, max_nodes: int, max_chars: int, max_depth: int) -> ExpandedSize:
    """Return the expanded size of a document from its events, and check it against the bounds on the way.

    Args:
        events: From `yaml.parse`; no more are read than the bounds allow.
        max_nodes, max_chars, max_depth: The bounds; see `load_yaml`.

    Raises:
        ValueError: The document exceeds a bound, or an alias has no anchor before it or lies inside its own.
    """
    import yaml

    total = ExpandedSize()
    sizes: dict[str, ExpandedSize] = {}
    begun: list[tuple[str | None, ExpandedSize]] = []
    for event in events:
        before = total
        if isinstance(event, yaml.CollectionStartEvent):
            begun.append((event.anchor, before))
            if event.anchor is not None:
                sizes.pop(event.anchor, None)
            total = ExpandedSize(total.nodes + 1, total.chars)
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = begun.pop()
            if anchor is not None:
                sizes[anchor] = ExpandedSize(total.nodes - before.nodes, total.chars - before.chars)
        elif isinstance(event, yaml.ScalarEvent):
            total = ExpandedSize(total.nodes + 1, total.chars + len(event.value))
            if event.anchor is not None:
                sizes[event.anchor] = ExpandedSize(1, len(event.value))
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise ValueError("an alias names nothing that is complete before it")
            total = ExpandedSize(*(sum(pair) for pair in zip(total, sizes[event.anchor], strict=True)))
        if total.nodes > max_nodes or total.chars > max_chars or len(begun) > max_depth:
            raise ValueError("it is nested too deep, or stands for too much")
    return total
