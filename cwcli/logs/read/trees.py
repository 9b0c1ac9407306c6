"""Reads messages one by one as trees, for content that columns do not hold."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from cwcli.errors import InputError
from cwcli.logs.codecs.ros2msg import SchemaError
from cwcli.logs.codecs.tree import UndecodableMessage, make_tree_decoder
from cwcli.logs.read.columns import check_single_schema

if TYPE_CHECKING:
    from cwcli.logs.read.channels import ChannelInfo
    from cwcli.logs.read.message_reader import MessageReader


def iter_message_trees(
    reader: MessageReader, channels: Sequence[ChannelInfo], name: str
) -> Iterator[tuple[int, object]]:
    """Yield log time in ns and tree of each message of one topic, in file order; see `Log.trees`."""
    check_single_schema(channels, name)
    try:
        decode = make_tree_decoder(channels[0])
    except SchemaError as error:
        what = f"the channel {channels[0].topic} ({channels[0].schema_name or 'no schema'}) can't be read: {error}"
        raise InputError(what, where=name) from error
    ids = [channel.id for channel in channels]
    reader.distrust_indexes_if_miscounted(ids)
    tally = reader.counts.start_tally(ids)
    for batch in reader.iter_batches(ids):
        tally.add_messages(batch.channel_id)
        for log_time_ns, payload in batch.iter_messages():
            try:
                yield log_time_ns, decode(bytes(payload))
            except UndecodableMessage as error:
                yield log_time_ns, error
    tally.compare_with_summary()
