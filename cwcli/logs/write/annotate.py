"""Writes a log again with more channels.

Chunks, message indexes, attachments and metadata records of the source are copied byte for byte. New messages lie in
chunks of their own, right after the source's chunk of the same time. The summary is rewritten. A ROS profile in the
header is dropped if a channel is not of ROS.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from cwcli.errors import DataError, OutputError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.format.faults import Faults
from cwcli.logs.format.open_index import index_every_record
from cwcli.logs.write.channel_ids import NewChannel, assign_channel_ids
from cwcli.logs.write.message_merge import MessageMerge
from cwcli.logs.write.new_messages import feed_from_columns
from cwcli.logs.write.profile import profile_that_channels_keep
from cwcli.logs.write.record_writer import RecordWriter
from cwcli.logs.write.source_copy import SourceCopy
from cwcli.output import AtomicGroup, open_output
from cwcli.signals.columns import OutputChannel

if TYPE_CHECKING:
    from cwcli.logs.read.reader import Log

MIN_NEW_CHUNK_BYTES = 1 << 16
"""The number of bytes of new messages that are worth a chunk; fewer wait for the source's next chunk, because tiny
chunks are slow to read. Chosen by hand."""


class CopyOptions(NamedTuple):
    """What a copy holds, and how its file appears.

    Attributes:
        chosen_topics: Topics of the new channels that are written; None for all. Channels of the source that the others
            would replace are left out as well, so that the copy holds the channels of one run.
        excluded_channel_ids: Ids of further channels of the source to leave out.
        excluded_metadata_names: Names of further metadata records of the source to leave out.
        profile: Profile of the copy, if its channels conform to it; None for that of the source.
        durable, together: As in `cwcli.output.open_output`.
    """

    chosen_topics: Container[str] | None = None
    excluded_channel_ids: frozenset[int] = frozenset()
    excluded_metadata_names: frozenset[str] = frozenset()
    profile: str | None = None
    durable: bool = True
    together: AtomicGroup | None = None


@dataclass(frozen=True)
class AnnotateReport:
    """Sizes and counts of a written log.

    Attributes:
        target: The file name as given.
        n_bytes: Size of the file.
        n_messages_copied, n_messages_added: Messages of the source and new ones.
        n_chunks_copied, n_chunks_added: Chunks of the source and new ones.
        replaced_topics: Topics of the source that were left out.
        n_chunks_lost, n_bytes_lost: Damaged parts of the source that were left out (`recover`).
        dropped_profile: The source's profile, if the copy has none because not all channels conform to it.
    """

    target: str
    n_bytes: int
    n_messages_copied: int
    n_messages_added: int
    n_chunks_copied: int
    n_chunks_added: int
    replaced_topics: tuple[str, ...]
    n_chunks_lost: int
    n_bytes_lost: int
    dropped_profile: str


def annotate_log(
    source: Log,
    channels: Sequence[OutputChannel],
    metadata: Mapping[str, Mapping[str, str]],
    target: str | Path,
    *,
    replace: bool = False,
    force: bool = False,
    options: CopyOptions = CopyOptions(),  # noqa: B008 - it can't change
) -> AnnotateReport:
    """Write the source with more channels.

    The same source and channels give the same bytes. Messages of a source without chunks are put into chunks unchanged,
    because readers that find a chunk index read nothing else.

    Args:
        source: The log. The channels and metadata that it holds in memory (`Log.with_channels`) are written too. A log
            opened with `recover` is copied as far as it is intact.
        channels: New channels.
        metadata: New metadata records by name, e.g. `cwcli.run.estimate`.
        target: File name, or `-` for standard output.
        replace: Leave the source's channels on the same topics, and its metadata records of the same names, out of the
            copy.
        force: Overwrite a file that exists. The source itself is never overwritten.
        options: What the copy holds, and how its file appears.

    Raises:
        OutputError: The target can't be written, or the source holds a topic or a record of the same name and
            `replace` is off.
        InputError: The source is damaged, or changed while it was read.
        DataError: A new message would be logged before 1970.
        ValueError: A column does not fit its schema, or log times go back.
    """
    channels, metadata = merge_with_in_memory_channels(source, channels, metadata, replace)
    topics = {channel.topic for channel in channels}
    faults = Faults()
    index = index_every_record(source.file, faults, recover=source.recover)
    replaced = {
        each.id: each
        for each in index.channels.values()
        if each.topic in topics or each.id in options.excluded_channel_ids
    }
    raise_for_existing_names(sorted({each.topic for each in replaced.values()}), "channel", source.name, replace)
    raise_for_existing_names(
        sorted(set(metadata).intersection(index.metadata.names)), "metadata record", source.name, replace
    )
    chosen = options.chosen_topics
    new = assign_channel_ids(index, [each for each in channels if chosen is None or each.topic in chosen], replaced)
    kept = profile_that_channels_keep(
        index.profile if options.profile is None else options.profile,
        [*(each for each in index.channels.values() if each.id not in replaced), *(each.channel for each in new)],
        index.schemas | {each.schema.id: each.schema for each in new},
    )
    merge = MessageMerge([feed_from_columns(each.columns, each.channel.id) for each in new])
    copy = SourceCopy(source.file, index, faults, recover=source.recover)
    with open_output(
        target,
        force=force,
        inputs=source.file.disk_files,
        durable=options.durable,
        together=options.together,
    ) as output:
        writer = RecordWriter(output)
        copy.write_beginning(
            writer,
            kept,
            replaced_ids=frozenset(replaced),
            replaced_metadata=options.excluded_metadata_names.union(metadata),
            written_schema_ids=frozenset(each.schema.id for each in new),
        )
        n_added = write_body_and_summary(writer, copy, new, merge, metadata)
        n_bytes = output.position
    return AnnotateReport(
        target=str(target),
        n_bytes=n_bytes,
        n_messages_copied=copy.n_messages,
        n_messages_added=len(merge.log_time_ns),
        n_chunks_copied=copy.n_chunks,
        n_chunks_added=n_added,
        replaced_topics=tuple(sorted({each.topic for each in replaced.values()})),
        n_chunks_lost=faults.chunks_lost,
        n_bytes_lost=faults.bytes_lost,
        dropped_profile=index.profile if kept != index.profile else "",
    )


def write_body_and_summary(
    writer: RecordWriter,
    copy: SourceCopy,
    new: Sequence[NewChannel],
    merge: MessageMerge,
    metadata: Mapping[str, Mapping[str, str]],
    *,
    until_ns: int | None = None,
) -> int:
    """Write new definitions, the source's items with the new messages, new metadata and the summary.

    Args:
        writer: Writes the copy; its beginning is written already.
        copy: The source.
        new: New channels.
        merge: The messages of the new channels.
        metadata: New metadata records by name.
        until_ns: Last log time of new messages to write; None for all.

    Returns:
        The number of new chunks.
    """
    n_added = 0
    for schema in {each.schema.id: each.schema for each in new}.values():
        writer.write_schema(schema)
    for each in new:
        writer.write_channel(each.channel)
    for item in copy.items:
        last_ns = copy.copy_item_and_get_last_log_time(writer, item)
        if last_ns is not None:
            last_ns = last_ns if until_ns is None else min(last_ns, until_ns)
            for payload in merge.iter_chunk_payloads_until(last_ns, min_waiting_bytes=MIN_NEW_CHUNK_BYTES):
                writer.write_chunk(payload)
                n_added += 1
    for payload in merge.iter_chunk_payloads_until(until_ns):
        writer.write_chunk(payload)
        n_added += 1
    for name, values in metadata.items():
        writer.write_metadata(name, values)
    copy.check_source_unchanged()
    writer.finish()
    return n_added


def merge_with_in_memory_channels(
    source: Log, channels: Sequence[OutputChannel], metadata: Mapping[str, Mapping[str, str]], replace: bool
) -> tuple[list[OutputChannel], dict[str, Mapping[str, str]]]:
    """Merge the channels and metadata that the source holds in memory with new ones; new ones win.

    Raises:
        OutputError: A topic or a record is both new and in memory, and `replace` is off.
        DataError: A message would be logged before 1970, because it comes from one that is logged after the year 2262.
    """
    by_topic: dict[str, OutputChannel] = {}
    for channel in (*source.added_channels, *channels):
        if channel.topic in by_topic:
            raise_for_existing_names([channel.topic], "channel", source.name, replace)
        by_topic[channel.topic] = channel
        if len(channel.log_time_ns) and int(channel.log_time_ns.min()) < 0:
            what = f"a message of {channel.topic} would be logged before 1970: its source is logged after 2262"
            raise DataError(what, where=source.name, hint="--start and --end leave such messages out")
    by_name = dict(source.added_metadata)
    raise_for_existing_names(sorted(set(by_name) & set(metadata)), "metadata record", source.name, replace)
    return list(by_topic.values()), {**by_name, **metadata}


def raise_for_existing_names(existing_names: Sequence[str], kind: str, source: str, replace: bool) -> None:
    """Check that the log does not hold these names already, unless they are to be replaced.

    Raises:
        OutputError: It holds one and `replace` is off.
    """
    if existing_names and not replace:
        raise OutputError(
            f"the log holds the {kind} {existing_names[0]} already",
            where=source,
            found=tuple(existing_names[1:]),
            hint="--replace leaves the old one out of the copy",
        )
