"""Writes a log of parts again with more channels, part by part."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container
from pathlib import Path
from typing import TYPE_CHECKING

from cwcli.errors import OutputError, UsageError
from cwcli.logs.format.faults import Faults
from cwcli.logs.format.index import LogIndex
from cwcli.logs.format.joined_file import JoinedFile
from cwcli.logs.format.open_index import index_every_record
from cwcli.logs.format.records import Channel, Schema
from cwcli.logs.write.annotate import merge_with_in_memory_channels, raise_for_existing_names, write_body_and_summary
from cwcli.logs.write.channel_ids import assign_channel_ids
from cwcli.logs.write.message_merge import MessageMerge
from cwcli.logs.write.new_messages import feed_from_columns
from cwcli.logs.write.profile import profile_that_channels_keep
from cwcli.logs.write.record_writer import RecordWriter
from cwcli.logs.write.source_copy import SourceCopy
from cwcli.output import AtomicGroup, make_folder, open_output

if TYPE_CHECKING:
    from cwcli.logs.read.reader import Log


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
        replace, force, chosen_topics, together: As in `cwcli.logs.write.annotate.annotate_log`.

    Raises:
        UsageError: The source is one file.
        OutputError: The folder can't be made, or as `annotate`.
        InputError: The source is damaged, or changed while it was read.
    """
    file = source.file
    if not isinstance(file, JoinedFile):
        raise UsageError("--split like-input: the log is one file", where=source.name, hint="leave --split away")
    channels, metadata = merge_with_in_memory_channels(source, (), {}, replace)
    topics = {channel.topic for channel in channels}
    indexes = [index_every_record(part, Faults(), recover=source.recover) for part in file.parts]
    found = {each.topic for index in indexes for each in index.channels.values()}
    raise_for_existing_names(sorted(topics & found), "channel", source.name, replace)
    records = {name for index in indexes for name in index.metadata.names}
    raise_for_existing_names(sorted(set(metadata) & records), "metadata record", source.name, replace)
    new = assign_channel_ids(
        _index_with_largest_ids(indexes),
        [each for each in channels if chosen_topics is None or each.topic in chosen_topics],
        {},
    )
    merge = MessageMerge([feed_from_columns(each.columns, each.channel.id) for each in new])
    make_folder(folder)
    written = [Path(folder) / name for name in _part_file_names(file)]
    counted = [index.statistics for index in indexes]
    starts = [each.start_ns if each is not None and each.n_messages else None for each in counted]
    for k, (part, index, target) in enumerate(zip(file.parts, indexes, written, strict=True)):
        until = min((start - 1 for start in starts[k + 1 :] if start is not None), default=None)
        replaced = frozenset(each.id for each in index.channels.values() if each.topic in topics)
        kept = (each for each in index.channels.values() if each.id not in replaced)
        schemas = index.schemas | {each.schema.id: each.schema for each in new}
        profile = profile_that_channels_keep(index.profile, [*kept, *(each.channel for each in new)], schemas)
        copy = SourceCopy(part, index, Faults(), recover=source.recover)
        with open_output(target, force=force, inputs=file.disk_files, together=together) as output:
            writer = RecordWriter(output)
            copy.write_beginning(
                writer,
                profile,
                replaced_ids=replaced,
                replaced_metadata=frozenset(metadata),
                written_schema_ids=frozenset(each.schema.id for each in new),
            )
            write_body_and_summary(writer, copy, new, merge, metadata, until_ns=until)
    return written


def _index_with_largest_ids(indexes: list[LogIndex]) -> LogIndex:
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
