"""The message encodings that cwcli reads. A further encoding is a file in this folder and a line here."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Protocol

from cwcli.logs.codecs.decoder import Decoder
from cwcli.logs.codecs.ros2msg import SchemaError


class ChannelLike(Protocol):
    """The encodings and the schema of a channel."""

    @property
    def message_encoding(self) -> str: ...
    @property
    def schema_encoding(self) -> str: ...
    @property
    def schema_name(self) -> str: ...
    @property
    def schema_data(self) -> bytes: ...


Fields = Collection[str] | None
Maker = Callable[[ChannelLike, Fields, Collection[str], int], Decoder]


def make_decoder(channel: ChannelLike, fields: Fields, *, blobs: Collection[str] = (), n_expected: int = 0) -> Decoder:
    """Return a new decoder for a channel; no decoder is shared between files.

    Raises:
        SchemaError: The encoding is unknown, or the schema can't be used.
    """
    maker = DECODER_MAKERS.get((channel.message_encoding, channel.schema_encoding))
    maker = maker or DECODER_MAKERS.get((channel.message_encoding, ANY_SCHEMA_ENCODING))
    if maker is None:
        known = ", ".join(
            f"{message}/{schema}".removesuffix(f"/{ANY_SCHEMA_ENCODING}") for message, schema in DECODER_MAKERS
        )
        encodings = f"{channel.message_encoding[:40] or '-'}/{channel.schema_encoding[:40] or '-'}"
        raise SchemaError(f"its encoding {encodings} is unknown (known: {known})")
    return maker(channel, fields, blobs, n_expected)


def _make_cdr_decoder(channel: ChannelLike, fields: Fields, blobs: Collection[str], n_expected: int) -> Decoder:
    from cwcli.logs.codecs.cdr import CdrDecoder

    return CdrDecoder(channel.schema_name, channel.schema_data, fields, blobs=blobs, n_expected=n_expected)


def _make_protobuf_decoder(channel: ChannelLike, fields: Fields, blobs: Collection[str], n_expected: int) -> Decoder:
    from cwcli.logs.codecs.protobuf import ProtobufDecoder

    return ProtobufDecoder(channel.schema_name, channel.schema_data, fields, blobs=blobs, n_expected=n_expected)


def _make_json_decoder(channel: ChannelLike, fields: Fields, blobs: Collection[str], n_expected: int) -> Decoder:
    from cwcli.logs.codecs.json import JsonDecoder

    return JsonDecoder(fields, blobs=blobs, n_expected=n_expected)


ANY_SCHEMA_ENCODING = "*"
"""The schema encoding of a registry entry that accepts every schema."""
DECODER_MAKERS: dict[tuple[str, str], Maker] = {
    ("cdr", "ros2msg"): _make_cdr_decoder,
    ("protobuf", "protobuf"): _make_protobuf_decoder,
    ("json", ANY_SCHEMA_ENCODING): _make_json_decoder,
}
"""The message encoding and schema encoding of a channel (MCAP registry) -> function that makes its decoder."""
