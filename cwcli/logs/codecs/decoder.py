"""What every message encoding offers to the reader."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from cwcli.logs.codecs.slots import BoolArray, Payloads
from cwcli.signals.columns import Field, Int64Array


@dataclass(frozen=True)
class Outcome:
    """What became of the messages that were added, in their order.

    Attributes:
        is_ok: Shape (n,): messages that could be decoded.
        reasons: Why the others could not -> how many.
    """

    is_ok: BoolArray
    reasons: Mapping[str, int] = field(default_factory=dict)


class Decoder(Protocol):
    """Decodes the messages of one channel, batch by batch."""

    @property
    def empty_row_bytes(self) -> int:
        """What a message that leaves everything out takes in memory."""

    def restart(self, n_expected: int = 0) -> None:
        """Forget all messages; this many are to come."""

    def add(self, payloads: Payloads) -> None:
        """Decode a batch."""

    def outcome(self) -> Outcome:
        """What became of the messages."""

    def finish(self, rows: Int64Array) -> dict[str, Field]:
        """Leaf path -> column, for the given messages in the given order; all of them decodable."""

    def blobs(self, path: str) -> list[bytes | memoryview]:
        """A blob field of each message of the last batch; b"" where there is none.

        Raises:
            KeyError: It is not a blob of this decoder.
        """
