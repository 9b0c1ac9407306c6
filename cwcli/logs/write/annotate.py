"""Writes a log again with more channels.

Chunks, message indexes, attachments and metadata records of the source are copied byte for byte. New messages lie in
chunks of their own, right after the source's chunk of the same time. The summary is rewritten. A ROS profile in the
header is dropped if a channel is not of ROS.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from cwcli.errors import DataError, OutputError, UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.encoders.output_schema import find_output_schema
from cwcli.logs.format.faults import Faults
from cwcli.logs.format.index import LogIndex
from cwcli.logs.format.joined_file import JoinedFile
from cwcli.logs.format.open_index import index_every_record
from cwcli.logs.format.records import Channel, Schema
from cwcli.logs.read.reader import Log
from cwcli.logs.write.message_merge import MessageMerge, feed_from_columns, merges_of_large_and_small_feeds
from cwcli.logs.write.profile import profile_kept_by_channels_or_empty
from cwcli.logs.write.record_writer import RecordWriter
from cwcli.logs.write.source_copy import SourceCopy
from cwcli.output import AtomicGroup, make_folder, open_output
from cwcli.signals.columns import OutputChannel
from cwcli.work_share import report_work

MAX_SCHEMA_OR_CHANNEL_ID = 0xFFFF
"""The greatest id of a schema or a channel: the format has 16 bits for it (MCAP specification)."""


@dataclass(frozen=True)
class NewChannel:
    """A channel that is added, as columns and with its schema and channel records."""

    columns: OutputChannel
    schema: Schema
    channel: Channel


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
    channels, metadata = _merge_with_in_memory_channels(source, channels, metadata, replace)
    topics = {channel.topic for channel in channels}
    faults = Faults()
    index = index_every_record(source.file, faults, recover=source.recover)
    replaced = {
        each.id: each
        for each in index.channels.values()
        if each.topic in topics or each.id in options.excluded_channel_ids
    }
    _raise_for_existing_names(sorted({each.topic for each in replaced.values()}), "channel", source.name, replace)
    _raise_for_existing_names(
        sorted(set(metadata).intersection(index.metadata.names)), "metadata record", source.name, replace
    )
    chosen = options.chosen_topics
    new = _assign_channel_ids(index, [each for each in channels if chosen is None or each.topic in chosen], replaced)
    profile = profile_kept_by_channels_or_empty(
        index.profile if options.profile is None else options.profile,
        [*(each for each in index.channels.values() if each.id not in replaced), *(each.channel for each in new)],
        index.schemas | {each.schema.id: each.schema for each in new},
    )
    merges = merges_of_large_and_small_feeds([feed_from_columns(each.columns, each.channel.id) for each in new])
    copy = SourceCopy(source.file, index, faults, recover=source.recover)
    with open_output(
        target,
        force=force,
        inputs=source.file.disk_files,
        durable=options.durable,
        together=options.together,
    ) as output:
        writer = RecordWriter(output)
        copy.write_header_and_definitions(
            writer,
            profile,
            replaced_ids=frozenset(replaced),
            replaced_metadata=options.excluded_metadata_names.union(metadata),
            written_schema_ids=frozenset(each.schema.id for each in new),
        )
        n_added = _write_body_and_summary(writer, copy, new, merges, metadata)
        n_bytes = output.position
    return AnnotateReport(
        target=str(target),
        n_bytes=n_bytes,
        n_messages_copied=copy.n_messages,
        n_messages_added=sum(map(len, merges)),
        n_chunks_copied=copy.n_chunks,
        n_chunks_added=n_added,
        replaced_topics=tuple(sorted({each.topic for each in replaced.values()})),
        n_chunks_lost=faults.chunks_lost,
        n_bytes_lost=faults.bytes_lost,
        dropped_profile=index.profile if profile != index.profile else "",
    )


def annotate_parts(
    source: Log,
    folder: str | Path,
    *,
    replace: bool = False,
    force: bool = False,
    chosen_topics: Container[str] | None = None,
    together: AtomicGroup,
) -> list[Path]:
    """Write each part of the source with the new messages of its time, and return the file names.

    A part gets the new messages from its first message up to that of the next part; the first part gets earlier ones
    too. Each part has all new metadata records and is a log of its own.

    Args:
        source: A log in parts.
        folder: Folder for the parts, which keep their names; created if it does not exist.
        replace, force, chosen_topics, together: As in `annotate_log`.

    Raises:
        UsageError: The source is one file.
        OutputError: The folder can't be made, or as `annotate_log`.
        InputError: The source is damaged, or changed while it was read.
    """
    file = source.file
    if not isinstance(file, JoinedFile):
        raise UsageError("--split like-input: the log is one file", where=source.name, hint="leave --split away")
    channels, metadata = _merge_with_in_memory_channels(source, (), {}, replace)
    topics = {channel.topic for channel in channels}
    indexes = [index_every_record(part, Faults(), recover=source.recover) for part in file.parts]
    found = {each.topic for index in indexes for each in index.channels.values()}
    _raise_for_existing_names(sorted(topics & found), "channel", source.name, replace)
    records = {name for index in indexes for name in index.metadata.names}
    _raise_for_existing_names(sorted(set(metadata) & records), "metadata record", source.name, replace)
    new = _assign_channel_ids(
        _placeholder_index_with_largest_ids(indexes),
        [each for each in channels if chosen_topics is None or each.topic in chosen_topics],
        {},
    )
    merges = merges_of_large_and_small_feeds([feed_from_columns(each.columns, each.channel.id) for each in new])
    make_folder(folder)
    part_paths = [Path(folder) / name for name in _part_file_names(file)]
    counted = [index.statistics for index in indexes]
    starts = [each.start_ns if each is not None and each.n_messages else None for each in counted]
    for k, (part, index, target) in enumerate(zip(file.parts, indexes, part_paths, strict=True)):
        until = min((start - 1 for start in starts[k + 1 :] if start is not None), default=None)
        replaced = frozenset(each.id for each in index.channels.values() if each.topic in topics)
        remaining_channels = (each for each in index.channels.values() if each.id not in replaced)
        schemas = index.schemas | {each.schema.id: each.schema for each in new}
        profile = profile_kept_by_channels_or_empty(
            index.profile, [*remaining_channels, *(each.channel for each in new)], schemas
        )
        copy = SourceCopy(part, index, Faults(), recover=source.recover)
        with open_output(target, force=force, inputs=file.disk_files, together=together) as output:
            writer = RecordWriter(output)
            copy.write_header_and_definitions(
                writer,
                profile,
                replaced_ids=replaced,
                replaced_metadata=frozenset(metadata),
                written_schema_ids=frozenset(each.schema.id for each in new),
            )
            _write_body_and_summary(writer, copy, new, merges, metadata, until_ns=until)
    return part_paths


def _write_body_and_summary(
    writer: RecordWriter,
    copy: SourceCopy,
    new: Sequence[NewChannel],
    merges: Sequence[MessageMerge],
    metadata: Mapping[str, Mapping[str, str]],
    *,
    until_ns: int | None = None,
) -> int:
    """Write new definitions, the source's items with the new messages, new metadata and the summary.

    Args:
        writer: Writes the copy; its beginning is written already.
        until_ns: Last log time of new messages to write; None for all.

    Returns:
        The number of new chunks.
    """
    n_added = 0
    for schema in {each.schema.id: each.schema for each in new}.values():
        writer.write_schema(schema)
    for each in new:
        writer.write_channel(each.channel)
    for n_copied, item in enumerate(copy.items):
        report_work("items", n_copied, len(copy.items))
        last_ns = copy.copy_item_and_get_last_log_time(writer, item)
        if last_ns is not None:
            last_ns = last_ns if until_ns is None else min(last_ns, until_ns)
            for merge in merges:
                for payload in merge.iter_chunk_payloads_until(last_ns):
                    writer.write_chunk(payload)
                    n_added += 1
    for merge in merges:
        for payload in merge.iter_chunk_payloads_until(until_ns, is_last=True):
            writer.write_chunk(payload)
            n_added += 1
    for name, values in metadata.items():
        writer.write_metadata(name, values)
    copy.check_source_unchanged()
    writer.write_summary_and_footer()
    return n_added


def _merge_with_in_memory_channels(
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
            _raise_for_existing_names([channel.topic], "channel", source.name, replace)
        by_topic[channel.topic] = channel
        if len(channel.log_time_ns) and int(channel.log_time_ns.min()) < 0:
            what = f"a message of {channel.topic} would be logged before 1970: its source is logged after 2262"
            raise DataError(what, where=source.name, hint="--start and --end leave such messages out")
    by_name = dict(source.added_metadata)
    _raise_for_existing_names(sorted(set(by_name) & set(metadata)), "metadata record", source.name, replace)
    return list(by_topic.values()), {**by_name, **metadata}


def _raise_for_existing_names(existing_names: Sequence[str], kind: str, source: str, replace: bool) -> None:
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


def _assign_channel_ids(
    index: LogIndex, channels: Sequence[OutputChannel], replaced: Mapping[int, Channel]
) -> list[NewChannel]:
    """Return schema and channel records for the new channels.

    An equal schema of the source is used again. A new id is larger than all of the source's, even those of channels
    that are left out, because their definitions may be repeated inside chunks that are copied. Only a channel that is
    equal to the one that it replaces keeps its id.

    Raises:
        KeyError: A schema is unknown.
        OutputError: There are no ids left.
    """
    schema_ids = {(each.name, each.encoding, each.data): each.id for each in index.schemas.values()}
    next_schema_id = max(index.schemas, default=0) + 1
    next_channel_id = max(index.channels, default=0) + 1
    new: list[NewChannel] = []
    for columns in channels:
        message = find_output_schema(columns.schema_name)
        key = (message.name, message.encoding, message.data)
        if key not in schema_ids:
            schema_ids[key] = next_schema_id
            next_schema_id += 1
        schema = Schema(schema_ids[key], *key)
        channel = Channel(next_channel_id, schema.id, columns.topic, message.message_encoding, {})
        equal = [old for old in replaced.values() if channel._replace(id=old.id) == old]
        if equal:
            channel = equal[0]
        else:
            next_channel_id += 1
        new.append(NewChannel(columns, schema, channel))
    if max(next_schema_id, next_channel_id) > MAX_SCHEMA_OR_CHANNEL_ID + 1:
        raise OutputError("the log has no room for more channels: their ids end at 65,535")
    return new


def _placeholder_index_with_largest_ids(indexes: list[LogIndex]) -> LogIndex:
    """Return an index whose ids are as large as any part's, so that new ids clash with none."""
    schema_id = max((each for index in indexes for each in index.schemas), default=0)
    channel_id = max((each for index in indexes for each in index.channels), default=0)
    return LogIndex(
        schemas={schema_id: Schema(schema_id, "", "", b"")},
        channels={channel_id: Channel(channel_id, schema_id, "", "", {})},
    )


def _part_file_names(file: JoinedFile) -> list[str]:
    """Return the file name of each written part, with the suffix `.mcap`.

    Raises:
        OutputError: Two parts have the same name.
    """
    stems = [Path(part.name).name for part in file.parts]
    for suffix in (".zstd", ".zst", ".mcap", ".db3", ".bag"):
        stems = [stem.removesuffix(suffix) for stem in stems]
    if repeated := [stem for stem, n in Counter(stems).items() if n > 1]:
        raise OutputError(f"two parts are called {repeated[0]}", where=file.name, hint="rename one, or write one file")
    return [f"{stem}.mcap" for stem in stems]
