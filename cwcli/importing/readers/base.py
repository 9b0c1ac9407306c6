"""What a kind of file is: how it is recognised, and its reader."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

from cwcli.importing.tables import Answers, Guess, SourceTable
from cwcli.importing.text_file import TextHead, decode_text_head, read_head
from cwcli.lazy_dataclass import dataclass

if TYPE_CHECKING:
    from cwcli.logs.write.writer import LogWriter


class WrittenChannel(NamedTuple):
    """A channel that an import writes: its topic, its schema's name and its number of messages."""

    topic: str
    schema_name: str
    n_messages: int


class Recording(Protocol):
    """Something that a reader makes channels of itself: camera frames, messages of other vehicles."""

    @property
    def name(self) -> str:
        """For messages: the file."""

    @property
    def guesses(self) -> Sequence[Guess]:
        """What was guessed."""

    @property
    def topics(self) -> Sequence[WrittenChannel]:
        """The channels that are written."""

    def write(self, log: LogWriter) -> None:
        """Write the channels."""


class FileHead:
    """The beginning of a file, as the kinds look at it.

    Attributes:
        path: The file as named.
        data: Its first bytes.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self.data = read_head(path)

    @property
    def suffix(self) -> str:
        """The end of the name in lower case."""
        return Path(self.path).suffix.lower()

    @cached_property
    def text(self) -> TextHead | None:
        """The beginning as text; None if it is no text."""
        return decode_text_head(self.data)

    @cached_property
    def lines(self) -> tuple[str, ...]:
        """The first lines that are not empty; none where it is no text."""
        return () if self.text is None else tuple(line.strip() for line in self.text.lines if line.strip())[:200]


ReadTablesOfFile = Callable[[str, Answers], Sequence[SourceTable | Recording]]
"""Reader of a file: its tables, and what becomes channels as it is."""


@dataclass(frozen=True)
class ImportKind:
    """A kind of file.

    Attributes:
        summary: One line for the help and the docs.
        suffixes: Usual ends of names; the content decides.
        accepts: Whether a file is of this kind, by its beginning.
        read: Its reader.
    """

    summary: str
    suffixes: tuple[str, ...]
    accepts: Callable[[FileHead], bool]
    read: ReadTablesOfFile
