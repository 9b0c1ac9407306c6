"""YAML from strangers: bounded before anything is built from it.

A few hundred bytes of YAML can stand for gigabytes: an alias repeats what an anchor names, and what it repeats may hold
aliases itself. The events of the parser are counted first, an alias as all that it stands for; only a document within
the bounds is built. Every scalar stays text: numbers, times, merge keys and tags, which cost more or run code in other
loaders, mean nothing here.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

MAX_DEPTH = 64


class Size(NamedTuple):
    """What a part of a document comes to when every alias is written out.

    Attributes:
        nodes: Scalars, lists and mappings.
        chars: Of its scalars.
    """

    nodes: int = 0
    chars: int = 0


def load_yaml(text: bytes, *, max_nodes: int, max_chars: int, max_depth: int = MAX_DEPTH) -> Any:
    """The document as dicts, lists and texts.

    Args:
        text: One YAML document.
        max_nodes: Values in it, with every alias written out.
        max_chars: Of all values together, likewise.
        max_depth: Of lists and mappings inside each other.

    Raises:
        ValueError: It is beyond a bound.
        yaml.YAMLError: It is no YAML.
    """
    import yaml

    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    check_events(yaml.parse(text, loader), max_nodes=max_nodes, max_chars=max_chars, max_depth=max_depth)
    return yaml.load(text, loader)


def check_events(events: Iterable[Any], *, max_nodes: int, max_chars: int, max_depth: int) -> Size:
    """Count what the events of a document come to; an alias counts as all that its anchor names.

    Args:
        events: As `yaml.parse` gives them; no more are taken than the bounds allow.
        max_nodes, max_chars, max_depth: The bounds; see `load_yaml`.

    Raises:
        ValueError: The document is beyond a bound, or an alias has no anchor before it or lies inside its own.
    """
    import yaml

    total = Size()
    sizes: dict[str, Size] = {}
    begun: list[tuple[str | None, Size]] = []
    for event in events:
        before = total
        if isinstance(event, yaml.CollectionStartEvent):
            begun.append((event.anchor, before))
            if event.anchor is not None:
                sizes.pop(event.anchor, None)
            total = Size(total.nodes + 1, total.chars)
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = begun.pop()
            if anchor is not None:
                sizes[anchor] = Size(total.nodes - before.nodes, total.chars - before.chars)
        elif isinstance(event, yaml.ScalarEvent):
            total = Size(total.nodes + 1, total.chars + len(event.value))
            if event.anchor is not None:
                sizes[event.anchor] = Size(1, len(event.value))
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise ValueError("an alias names nothing that is complete before it")
            total = Size(*(sum(pair) for pair in zip(total, sizes[event.anchor], strict=True)))
        if total.nodes > max_nodes or total.chars > max_chars or len(begun) > max_depth:
            raise ValueError("it is nested too deep, or stands for too much")
    return total
