"""Reads XML of unknown origin as a stream: the tree does not grow with the file, and nothing in it is nested deep.

What entities expand to is bounded by the parser itself (Expat 2.4.1 and later). No entity opens a file: the parser has
no handler for external ones.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from cwcli.errors import InputError

BYTES_PARSED_AT_ONCE = 1 << 16
"""Bytes that are parsed at a time. Chosen by hand."""
MAX_ELEMENT_DEPTH = 64
"""The greatest depth of elements inside each other. Chosen by hand: GPX and SUMO have ten at most."""
MAX_ELEMENTS_INSIDE_KEPT_ONE = 10_000
"""The greatest number of elements inside of one that is kept. Chosen by hand."""
MAX_BYTES_WITHOUT_TAG = 16_000_000
"""The greatest number of bytes without the begin or end of an element. Chosen by hand."""

XmlTagEvent = tuple[str, ElementTree.Element]
"""`start` or `end`, and the element."""


def iter_xml_events(path: str, wanted_tags: Collection[str]) -> Iterator[XmlTagEvent]:
    """Yield the begin and the end of each element.

    Args:
        wanted_tags: Names of elements, without a namespace, whose children are there when they end; others have none.

    Raises:
        InputError: It can't be read, is no XML, or exceeds a bound.
    """
    parser: ElementTree.XMLPullParser[ElementTree.Element] = ElementTree.XMLPullParser(("start", "end"))
    tree = _BoundedTree(path, wanted_tags)
    n_quiet_bytes = 0
    try:
        with Path(path).open("rb") as file:
            while block := file.read(BYTES_PARSED_AT_ONCE):
                _feed_xml_parser(parser, block, path)
                n_quiet_bytes += len(block)
                for event in _iter_xml_events(parser):
                    n_quiet_bytes = 0
                    yield from tree.yield_event_and_drop_ended_element(event)
                if n_quiet_bytes > MAX_BYTES_WITHOUT_TAG:
                    raise InputError(f"it has {MAX_BYTES_WITHOUT_TAG:,} bytes without an element", where=path)
            parser.close()
            for event in _iter_xml_events(parser):
                yield from tree.yield_event_and_drop_ended_element(event)
    except ElementTree.ParseError as error:
        raise InputError(f"the XML is damaged: {error}", where=path) from error
    except OSError as error:
        raise InputError(f"it can't be read: {error.strerror}", where=path) from error


def _feed_xml_parser(parser: ElementTree.XMLPullParser[ElementTree.Element], block: bytes, path: str) -> None:
    """Parse a block; raise `InputError` for an encoding that the parser does not know."""
    try:
        parser.feed(block)
    except (ValueError, LookupError) as error:
        raise InputError(f"the encoding of the XML can't be read: {error}", where=path) from error


class _BoundedTree:
    """The elements that are open, and those in the one that is kept."""

    def __init__(self, path: str, wanted_tags: Collection[str]) -> None:
        self._path = path
        self._kept = wanted_tags
        self._open: list[ElementTree.Element] = []
        self._depth_of_kept: int | None = None
        self._n_held = 0

    def yield_event_and_drop_ended_element(self, event: XmlTagEvent) -> Iterator[XmlTagEvent]:
        """Yield the event; behind the end of an element, take it out of the tree unless one around it is kept."""
        kind, element = event
        if kind == "start":
            self._add_open_element(element)
            yield event
            return
        yield event
        if self._depth_of_kept == len(self._open):
            self._depth_of_kept = None
        self._open.pop()
        if self._depth_of_kept is None:
            element.clear()
            if self._open:
                with suppress(ValueError):
                    self._open[-1].remove(element)

    def _add_open_element(self, element: ElementTree.Element) -> None:
        """Note an open element.

        Raises:
            InputError: It is nested too deep, or the one that is kept has too many.
        """
        self._open.append(element)
        self._n_held += 1
        if self._depth_of_kept is None:
            self._n_held = 0
            if element.tag.rpartition("}")[2] in self._kept:
                self._depth_of_kept = len(self._open)
        if len(self._open) > MAX_ELEMENT_DEPTH or self._n_held > MAX_ELEMENTS_INSIDE_KEPT_ONE:
            raise InputError("its elements are nested too deep, or one has too many", where=self._path)


def _iter_xml_events(parser: ElementTree.XMLPullParser[ElementTree.Element]) -> Iterator[XmlTagEvent]:
    found: Any
    for found in parser.read_events():
        yield found[0], found[1]
