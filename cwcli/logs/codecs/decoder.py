"""The interface of the decoders of message encodings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Protocol

from cwcli.lazy_dataclass import dataclass
from cwcli.logs.codecs.column_buffers import Payloads
from cwcli.signals.columns import BoolArray, Field, Int64Array

MAX_CACHED_SCHEMA_BYTES = 1 << 16
"""Size in bytes of the largest schema that is one of many which are kept compiled; of larger ones the last is kept.
Chosen by hand."""


@dataclass(frozen=True)
class DecodeOutcome:
    """Which of the added messages were decoded, in their order.

    Attributes:
        is_ok: Shape (n,): the message was decoded.
        reasons: Reason why messages were not decoded -> how many.
    """

    is_ok: BoolArray
    reasons: Mapping[str, int] = field(default_factory=dict)


class Decoder(Protocol):
    """Decodes the messages of one channel, batch by batch."""

    @property
    def empty_row_bytes(self) -> int:
        """Memory in bytes that a message without any field takes."""

    def reset(self, n_expected: int = 0) -> None:
        """Forget all messages; `n_expected` messages will follow."""

    def decode_batch(self, payloads: Payloads) -> None:
        """Decode a batch of messages."""

    def outcome(self) -> DecodeOutcome:
        """Return which messages were decoded, and why others were not."""

    def build_columns(self, rows: Int64Array) -> dict[str, Field]:
        """Return leaf path -> column for the given decodable messages, in the given order."""

    def blobs_of_last_batch(self, path: str) -> list[bytes | memoryview]:
        """Return a blob field of each message of the last batch, b"" for a message without it.

        Raises:
            KeyError: The path is not a blob of this decoder.
        """
