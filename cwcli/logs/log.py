"""A log: an MCAP file, or standard input, with the channels that a run has added in memory."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from cwcli.logs.faults import Faults
from cwcli.logs.records import AttachmentIndex

if TYPE_CHECKING:
    from cwcli.logs.frames import Frame
    from cwcli.signals.columns import Columns, OutputChannel


@dataclass(frozen=True)
class ChannelInfo:
    """A channel as the file declares it.

    Attributes:
        id: In the file; negative for a channel in memory.
        message_count: None where the file does not tell.
    """

    id: int
    topic: str
    schema_name: str
    schema_encoding: str
    message_encoding: str
    message_count: int | None
    metadata: Mapping[str, str] = field(default_factory=dict)
    schema_data: bytes = b""


class Log:
    name: str
    path: Path
    recover: bool
    channels: tuple[ChannelInfo, ...]
    profile: str
    library: str
    start_ns: int
    end_ns: int
    n_messages: int
    n_chunks: int
    compressions: tuple[str, ...]
    attachments: tuple[AttachmentIndex, ...]
    metadata: tuple[tuple[str, Mapping[str, str]], ...]
    faults: Faults
    added_channels: tuple[OutputChannel, ...]
    added_metadata: Mapping[str, Mapping[str, str]]

    @classmethod
    def open(cls, source: str | Path, *, recover: bool = False, verify: bool = True) -> Log:
        raise NotImplementedError

    def load(self, wanted: Mapping[str, Collection[str] | None]) -> dict[str, Columns]:
        raise NotImplementedError

    def columns(self, topic: str, fields: Collection[str] | None = None) -> Columns:
        return self.load({topic: fields})[topic]

    def frames(self, topic: str) -> Iterator[Frame]:
        raise NotImplementedError

    def sha256(self) -> str:
        raise NotImplementedError

    def with_channels(
        self, channels: Sequence[OutputChannel], metadata: Mapping[str, Mapping[str, str]] | None = None
    ) -> Log:
        raise NotImplementedError

    def close(self) -> None: ...

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
