"""Reads messages one by one as trees, for content that columns do not hold."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import islice

from cwcli.errors import InputError
from cwcli.logs.codecs.ros2msg import SchemaError
from cwcli.logs.codecs.tree import Decode, UndecodableMessage, make_tree_decoder
from cwcli.logs.read.channels import ChannelInfo
from cwcli.logs.read.columns import check_single_schema
from cwcli.logs.read.message_reader import MessageReader


def read_first_message_trees(
    reader: MessageReader, channels: Sequence[ChannelInfo], name: str, n: int, max_bytes: int
) -> list[object]:
    """Return the trees of the first messages of one topic in file order, without undecodable and large ones.

    Args:
        name: Name of the log, for messages.
        n: Number of messages that are looked at.
        max_bytes: Size of the largest message that is decoded.

    Raises:
        InputError: The encoding or the schema is unknown, or the file is damaged.
        DataError: The topic has several schemas.
    """
    decode = _make_decoder(channels, name)
    batches = reader.iter_batches([channel.id for channel in channels])
    payloads = (payload for batch in batches for _, payload in batch.iter_log_times_and_payloads())
    found: list[object] = []
    for payload in islice(payloads, n):
        if len(payload) <= max_bytes:
            with suppress(UndecodableMessage):
                found.append(decode(bytes(payload)))
    return found


def _make_decoder(channels: Sequence[ChannelInfo], name: str) -> Decode:
    """Return the function that decodes the messages of a topic; raises as `read_first_message_trees` does."""
    check_single_schema(channels, name)
    try:
        return make_tree_decoder(channels[0])
    except SchemaError as error:
        what = f"the channel {channels[0].topic} ({channels[0].schema_name or 'no schema'}) can't be read: {error}"
        raise InputError(what, where=name) from error


def iter_message_trees(
    reader: MessageReader, channels: Sequence[ChannelInfo], name: str
) -> Iterator[tuple[int, object]]:
    """Yield log time in ns and tree of each message of one topic, in file order; see `Log.trees`."""
    decode = _make_decoder(channels, name)
    ids = [channel.id for channel in channels]
    reader.distrust_indexes_if_miscounted(ids)
    n_read = Counter(dict.fromkeys(ids, 0))
    for batch in reader.iter_batches(ids):
        n_read.update(batch.channel_id.tolist())
        for log_time_ns, payload in batch.iter_log_times_and_payloads():
            try:
                yield log_time_ns, decode(bytes(payload))
            except UndecodableMessage as error:
                yield log_time_ns, error
    reader.note_miscounted_channels(n_read)
