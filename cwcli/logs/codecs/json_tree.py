"""The keys of a JSON channel, as a tree that grows with the messages."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import field

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass

MAX_OBJECT_DEPTH = 256
"""The greatest depth of objects inside each other whose keys are learned; deeper ones are left out. Chosen by hand."""
MAX_LEARNED_KEYS = 4096
"""The greatest number of keys that are learned; with more of them keys are data rather than names. Chosen by hand."""

Tables = tuple[npt.NDArray[np.uint8], npt.NDArray[np.int32], npt.NDArray[np.int32]]

_NEEDS_ESCAPE = re.compile(r'["\\\x00-\x1f]')
"""The characters that JSON texts must escape (RFC 8259, 7)."""


@dataclass
class JsonKey:
    """A key of an object.

    Attributes:
        path: Dotted path from the message.
        slot: Number of its column, or -1.
        below: Keys of the object that is its value (or of the objects in its array), or None.
    """

    path: str
    slot: int = -1
    below: dict[str, JsonKey] | None = None


@dataclass
class KeyTree:
    """The known keys of a JSON channel.

    Attributes:
        root: Keys of the message.
        paths: Path of the key of each slot.
        learns: Unknown keys become columns.
    """

    root: dict[str, JsonKey] = field(default_factory=dict)
    paths: list[str] = field(default_factory=list)
    learns: bool = False

    @classmethod
    def from_leaf_paths(cls, fields: Collection[str] | None, blobs: Collection[str] = ()) -> KeyTree:
        """Return the tree of the wanted leaves; with None for `fields` a tree that learns all keys."""
        tree = cls(learns=fields is None)
        for path in dict.fromkeys((*(fields or ()), *blobs)):
            keys = tree.root
            names = path.split(".")
            for k, name in enumerate(names):
                key = keys.setdefault(name, JsonKey(".".join(names[: k + 1])))
                if k + 1 < len(names):
                    key.below = keys = {} if key.below is None else key.below
            if key.slot < 0:
                tree._assign_slot(key)
        return tree

    def add_keys_of_objects(self, value: object, keys: dict[str, JsonKey], prefix: str = "", depth: int = 0) -> None:
        """Add the keys of an object, or of the objects in an array, to `keys`."""
        if depth > MAX_OBJECT_DEPTH:
            return
        if isinstance(value, list):
            for each in iter_nested_elements(value):
                self.add_keys_of_objects(each, keys, prefix, depth)
        elif isinstance(value, dict):
            for name, inner in value.items():
                key = keys.get(name)
                if key is None:
                    if len(self.paths) >= MAX_LEARNED_KEYS:
                        self.learns = False
                        return
                    key = keys[name] = JsonKey(prefix + name)
                    self._assign_slot(key)
                if _contains_object(inner):
                    if key.below is None:
                        key.below = {}
                    self.add_keys_of_objects(inner, key.below, f"{key.path}.", depth + 1)

    def to_kernel_tables(self) -> Tables:
        """Return keys, entries and nodes as arrays for `cwcli.kernels.json_walk`."""
        text = bytearray()
        entries: list[list[int]] = []
        nodes: list[list[int]] = [[0, 0]]
        waiting: list[tuple[int, dict[str, JsonKey]]] = [(0, self.root)]
        while waiting:
            node, keys = waiting.pop()
            nodes[node] = [len(entries), len(keys)]
            for name, key in keys.items():
                child = -1
                if key.below is not None:
                    child = len(nodes)
                    nodes.append([0, 0])
                    waiting.append((child, key.below))
                octets = name.encode(errors="surrogatepass")
                size = -1 if _NEEDS_ESCAPE.search(name) else len(octets)
                entries.append([len(text), size, key.slot, child])
                text += octets
        return (
            np.frombuffer(bytes(text) or b"\0", np.uint8),
            np.array(entries or [[0, 0, -1, -1]], np.int32),
            np.array(nodes, np.int32),
        )

    def _assign_slot(self, key: JsonKey) -> None:
        key.slot = len(self.paths)
        self.paths.append(key.path)


def iter_nested_elements(value: list[object]) -> Iterator[object]:
    """Yield the elements of nested lists in order, without recursion, so that any depth works."""
    waiting = [iter(value)]
    while waiting:
        for each in waiting[-1]:
            if isinstance(each, list):
                waiting.append(iter(each))
                break
            yield each
        else:
            waiting.pop()


def _contains_object(value: object) -> bool:
    return isinstance(value, dict) or (
        isinstance(value, list) and any(isinstance(each, dict) for each in iter_nested_elements(value))
    )
