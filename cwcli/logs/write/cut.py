"""Writes a part of a log: a span of log time, some topics, or both.

A chunk that lies inside the span and holds wanted channels alone is copied byte for byte with its message indexes; only
the chunks at the edges, and those with further channels, are rewritten from unchanged message records. Latched
messages from before the span, which a reader of the part needs too (static transforms, maps), are in a first chunk of
their own with their own log times. Metadata records are copied, and attachments that were logged before the span ends.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import numpy.typing as npt

from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.format.chunks import stored_chunk_bytes
from cwcli.logs.format.faults import Faults
from cwcli.logs.format.index import LogIndex, UnchunkedRange
from cwcli.logs.format.metadata_table import MetadataRun
from cwcli.logs.format.records import AttachmentIndex, ChunkIndex
from cwcli.logs.read.message_reader import MIN_MESSAGE_BYTES, MessageBatch, MessageReader, find_message_index_entries
from cwcli.logs.read.reader import Log
from cwcli.logs.write.latched import find_latched_messages, latched_channel_ids
from cwcli.logs.write.message_merge import BYTES_OF_FULL_NEW_CHUNK, ChunkPayload
from cwcli.logs.write.profile import profile_kept_by_channels_or_empty
from cwcli.logs.write.record_writer import RecordWriter
from cwcli.logs.write.source_copy import message_index_entries_by_channel
from cwcli.output import open_output

CUT_RECORD_NAME = "cwcli.cut"
"""Name of the metadata record that says what a cut log is a part of."""
MAX_LOG_TIME_NS = (1 << 64) - 1
"""The greatest log time in ns that a message can have (MCAP specification: an unsigned 64-bit number)."""


@dataclass(frozen=True)
class CutSpan:
    """What a cut holds.

    Attributes:
        first_ns, last_ns: First and last log time [ns].
        topics: Topics of the wanted channels; None for all.
        last_of: Topics whose last message before the span is kept, as if they were latched.
        keeps_latched: Keep latched messages from before the span.
    """

    first_ns: int = 0
    last_ns: int = MAX_LOG_TIME_NS
    topics: frozenset[str] | None = None
    last_of: frozenset[str] = frozenset()
    keeps_latched: bool = True


@dataclass(frozen=True)
class CutReport:
    """Sizes and counts of a cut log.

    Attributes:
        target: The file name as given.
        n_messages: Topic -> messages inside the span.
        n_earlier: Topic -> latched messages from before the span.
        n_chunks_copied, n_chunks_rewritten: Chunks that were copied byte for byte, and those that were rewritten.
        n_attachments, n_attachments_left_out: Attachments that were copied, and those that were logged too late.
        faults: Damage of the source, as reason -> how often.
    """

    target: str
    n_bytes: int
    n_messages: Mapping[str, int]
    n_earlier: Mapping[str, int]
    n_chunks_copied: int
    n_chunks_rewritten: int
    n_attachments: int
    n_attachments_left_out: int
    faults: Mapping[str, int]


def cut_log(source: Log, span: CutSpan, target: str | Path, *, force: bool = False) -> CutReport:
    """Write the part of a log that lies in a span.

    Every message keeps its bytes, its log time, its publish time and its sequence number. A metadata record
    `cwcli.cut` says what was cut.

    Args:
        source: The log; one opened with `recover` is copied as far as it is intact.
        target: File name, or `-` for standard output.
        force: Overwrite a file that exists. The source itself is never overwritten.

    Raises:
        OutputError: The target can't be written.
        InputError: The source is damaged, or changed while it was read.
        UsageError: No wanted message lies in the span.
    """
    with open_output(target, force=force, inputs=source.file.disk_files) as output:
        cutter = _Cutter(source, span, RecordWriter(output))
        cutter.write_whole_log()
        source.file.check_unchanged()
        n_bytes = output.position
    return cutter.build_report(str(target), n_bytes)


class _Cutter:
    """Writes the records of one cut log, in the order of the source."""

    def __init__(self, source: Log, span: CutSpan, writer: RecordWriter) -> None:
        self._source = source
        self._span = span
        self._writer = writer
        self._index: LogIndex = source.index
        self._faults = Faults()
        self._reader = MessageReader(source.file, self._index, self._faults, recover=source.recover)
        wanted_topics = span.topics
        self._wanted_ids = frozenset(
            each.id for each in self._index.channels.values() if wanted_topics is None or each.topic in wanted_topics
        )
        if wanted_topics is not None:  # else no chunk of the span is left out because of its index
            self._reader.distrust_indexes_if_miscounted(self._wanted_ids)
        self._defined: set[int] = set()
        self._defined_schemas: set[int] = set()
        self._counts: dict[int, int] = {}
        self._earlier: dict[int, int] = {}
        self._n_copied = self._n_rewritten = self._n_attachments = self._n_attachments_left_out = 0

    def write_whole_log(self) -> None:
        """Write header, latched messages, the items of the source inside the span, the record of the cut, and the end.

        Raises:
            UsageError: No wanted message lies in the span.
        """
        index = self._index
        channels = [index.channels[each] for each in sorted(self._wanted_ids)]
        self._writer.write_header(
            profile_kept_by_channels_or_empty(index.profile, channels, index.schemas), index.library
        )
        self._write_latched_messages()
        for item in index.items:
            self._write_wanted_part_of_item(item)
        if not self._counts:
            hint = "the message times are in `cwcli info`"
            raise UsageError("no message of the chosen topics lies in the span", where=self._source.name, hint=hint)
        self._writer.write_metadata(CUT_RECORD_NAME, self._cut_record_entries())
        self._writer.write_summary_and_footer()

    def build_report(self, target: str, n_bytes: int) -> CutReport:
        """Return the counts of what was written."""
        return CutReport(
            target=target,
            n_bytes=n_bytes,
            n_messages=self._count_by_topic(self._counts),
            n_earlier=self._count_by_topic(self._earlier),
            n_chunks_copied=self._n_copied,
            n_chunks_rewritten=self._n_rewritten,
            n_attachments=self._n_attachments,
            n_attachments_left_out=self._n_attachments_left_out,
            faults=self._faults.counts_by_reason(),
        )

    def _count_by_topic(self, counts: Mapping[int, int]) -> dict[str, int]:
        by_topic: dict[str, int] = {}
        for channel_id, n in counts.items():
            topic = self._index.channels[channel_id].topic
            by_topic[topic] = by_topic.get(topic, 0) + n
        return dict(sorted(by_topic.items()))

    def _cut_record_entries(self) -> dict[str, str]:
        """Return the entries of the record `cwcli.cut`."""
        span = self._span
        return {
            "source": Path(self._source.name).name,  # without its folder, so that the bytes are the same anywhere
            "first_log_time_ns": str(span.first_ns),
            "last_log_time_ns": str(min(span.last_ns, self._source.end_ns)),
            "topics": "all" if span.topics is None else json.dumps(sorted(span.topics)),
            "earlier_messages": json.dumps(self._count_by_topic(self._earlier)),
            "attachments_left_out": str(self._n_attachments_left_out),
        }

    def _write_latched_messages(self) -> None:
        latched = latched_channel_ids(self._index, self._wanted_ids) if self._span.keeps_latched else frozenset()
        named = {each for each in self._wanted_ids if self._index.channels[each].topic in self._span.last_of}
        records = find_latched_messages(self._reader, self._index, latched | named, self._span.first_ns)
        if records:
            for channel_id, entries in self._write_records(records, is_compressed=True).items():
                self._earlier[channel_id] = len(entries)

    def _write_wanted_part_of_item(self, item: object) -> None:
        """Write what the span holds of an item of the source."""
        if isinstance(item, ChunkIndex):
            if item.end_ns >= self._span.first_ns and item.start_ns <= self._span.last_ns:
                self._write_chunk(item)
        elif isinstance(item, UnchunkedRange):
            batches = self._reader.iter_unchunked_batches(self._wanted_ids, [(item.start, item.end)])
            self._write_batches(batches, is_compressed=False)
        elif isinstance(item, AttachmentIndex):
            is_in_time = item.log_time_ns <= self._span.last_ns
            self._n_attachments += is_in_time
            self._n_attachments_left_out += not is_in_time
            if is_in_time:
                self._writer.copy_attachment(self._source.file, item)
        elif isinstance(item, MetadataRun):
            self._writer.copy_metadata(self._source.file, item, self._index.metadata)

    def _write_chunk(self, chunk: ChunkIndex) -> None:
        """Copy a chunk, or write what the span holds of it."""
        if self._wanted_ids.isdisjoint(chunk.channel_ids) and chunk.channel_ids and self._reader.trusts_indexes:
            return
        counts = self._message_counts_if_wholly_wanted(chunk)
        if counts is not None:
            self._write_missing_definitions_of_channels(counts)
            self._writer.copy_chunk(self._source.file, chunk._replace(counts=counts))
            self._add_counts(counts)
            self._n_copied += 1
            return
        for _, payload in self._reader.iter_chunk_payloads([chunk]):
            if payload is None:
                return
            if self._copy_if_wholly_wanted(chunk, payload):
                return
            batches = self._reader.iter_chunk_batches(chunk, payload, self._wanted_ids)
            self._write_batches(batches, is_compressed=bool(chunk.compression))

    def _message_counts_if_wholly_wanted(self, chunk: ChunkIndex) -> dict[int, int] | None:
        """Return channel id -> messages by the message indexes; None if a message is not wanted, or they can't tell."""
        is_plain = (
            self._reader.trusts_indexes
            and not self._source.recover
            and chunk.index_offsets
            and chunk.chunk_start not in self._index.cut_chunks
            and self._index.channel_renumbering_at_offset(chunk.chunk_start) is None
            and chunk.index_offsets.keys() <= self._wanted_ids
            and chunk.start_ns >= self._span.first_ns
            and chunk.end_ns <= self._span.last_ns
        )
        if not is_plain:
            return None
        counts: dict[int, int] = {}
        for channel_id in chunk.index_offsets:
            entries = find_message_index_entries(self._source.file, self._index, chunk, channel_id)
            if entries is None or not self._are_all_log_times_between(entries[:, 0], chunk.start_ns, chunk.end_ns):
                return None
            if len(entries):
                counts[channel_id] = len(entries)
        return counts

    def _are_all_log_times_between(self, log_time_ns: npt.NDArray[np.uint64], first_ns: int, last_ns: int) -> bool:
        return not len(log_time_ns) or (int(log_time_ns.min()) >= first_ns and int(log_time_ns.max()) <= last_ns)

    def _copy_if_wholly_wanted(self, chunk: ChunkIndex, payload: memoryview) -> bool:
        """Copy the stored bytes of an open chunk with new indexes, if every message is wanted; return whether it is."""
        if (
            chunk.chunk_start in self._index.cut_chunks
            or self._index.channel_renumbering_at_offset(chunk.chunk_start) is not None
            or (chunk.index_offsets and not chunk.index_offsets.keys() <= self._wanted_ids)
        ):
            return False
        entries = message_index_entries_by_channel(payload)
        times = [each["log_time"] for each in entries.values()]
        if not entries or not entries.keys() <= self._wanted_ids:
            return False
        if not all(self._are_all_log_times_between(each, self._span.first_ns, self._span.last_ns) for each in times):
            return False
        content = ChunkPayload(
            np.frombuffer(payload, np.uint8),
            min(int(each.min()) for each in times),
            max(int(each.max()) for each in times),
            entries,
        )
        self._write_missing_definitions_of_channels(entries)
        stored = stored_chunk_bytes(self._source.file, chunk)
        self._writer.write_stored_chunk(content, chunk.compression, stored)
        self._add_counts({channel_id: len(rows) for channel_id, rows in entries.items()})
        self._n_copied += 1
        return True

    def _write_batches(self, batches: Iterable[MessageBatch], *, is_compressed: bool) -> None:
        """Write the messages of the span among some, in chunks of about `BYTES_OF_FULL_NEW_CHUNK`."""
        waiting: list[memoryview] = []
        n_bytes = 0
        for batch in batches:
            for piece in iter_records_of_span(batch, self._span.first_ns, self._span.last_ns):
                waiting.append(piece)
                n_bytes += len(piece)
            if n_bytes >= BYTES_OF_FULL_NEW_CHUNK:
                self._write_chunk_and_count_messages(waiting, is_compressed=is_compressed)
                waiting, n_bytes = [], 0
        if waiting:
            self._write_chunk_and_count_messages(waiting, is_compressed=is_compressed)

    def _write_chunk_and_count_messages(self, pieces: list[memoryview], *, is_compressed: bool) -> None:
        entries = self._write_records(pieces, is_compressed=is_compressed)
        self._add_counts({channel_id: len(rows) for channel_id, rows in entries.items()})
        self._n_rewritten += 1

    def _write_records(self, pieces: Collection[memoryview], *, is_compressed: bool) -> dict[int, npt.NDArray[np.void]]:
        """Write message records as a chunk; return its index entries by channel."""
        records = memoryview(b"".join(pieces))
        entries = message_index_entries_by_channel(records)
        times = np.concatenate([each["log_time"] for each in entries.values()])
        payload = ChunkPayload(np.frombuffer(records, np.uint8), int(times.min()), int(times.max()), entries)
        self._write_missing_definitions_of_channels(entries)
        if is_compressed:
            self._writer.write_chunk(payload)
        else:
            self._writer.write_stored_chunk(payload, "", records)
        return entries

    def _write_missing_definitions_of_channels(self, channel_ids: Iterable[int]) -> None:
        """Write the channels and schemas that are not written yet: a copied chunk need not hold its own."""
        for channel_id in channel_ids:
            channel = self._index.channels[channel_id]
            schema = self._index.schemas.get(channel.schema_id)
            if schema is not None and schema.id not in self._defined_schemas:
                self._defined_schemas.add(schema.id)
                self._writer.write_schema(schema)
            if channel_id not in self._defined:
                self._defined.add(channel_id)
                self._writer.write_channel(channel)

    def _add_counts(self, counts: Mapping[int, int]) -> None:
        for channel_id, n in counts.items():
            self._counts[channel_id] = self._counts.get(channel_id, 0) + n


def iter_records_of_span(batch: MessageBatch, first_ns: int, last_ns: int) -> Iterator[memoryview]:
    """Yield the records of a batch's messages from first to last log time [ns], neighbours in one piece."""
    log_time_ns = batch.log_time_ns.view(np.uint64)
    rows = np.flatnonzero((log_time_ns >= np.uint64(first_ns)) & (log_time_ns <= np.uint64(last_ns)))
    if not len(rows):
        return
    starts = batch.payloads.starts[rows] - MIN_MESSAGE_BYTES
    ends = batch.payloads.ends[rows]
    breaks = np.flatnonzero(starts[1:] != ends[:-1])
    first_rows = np.concatenate([[0], breaks + 1])
    last_rows = np.concatenate([breaks, [len(rows) - 1]])
    data = batch.payloads.data.data
    for start, end in zip(starts[first_rows].tolist(), ends[last_rows].tolist(), strict=True):
        yield data[start:end]


def topics_matching_patterns(patterns: str, known_topics: Sequence[str], where: str) -> frozenset[str]:
    """Return the topics that some patterns, separated by commas, name.

    A name that is a topic of the log stands for itself, whatever characters it has.

    Raises:
        UsageError: A pattern names no topic.
    """
    found: set[str] = set()
    for pattern in (each.strip() for each in patterns.split(",")):
        if not pattern:
            raise UsageError(f"the list of topics {patterns!r} has an empty name", where=where)
        own = (
            {pattern}
            if pattern in known_topics
            else {topic for topic in known_topics if _does_topic_match_pattern(topic, pattern)}
        )
        if not own:
            raise UsageError(
                f"no topic is called {pattern}",
                where=where,
                hint=hint_at_closest_or_all_known_names(pattern, known_topics, "topics"),
            )
        found |= own
    return frozenset(found)


def _does_topic_match_pattern(topic: str, pattern: str) -> bool:
    """Tell whether a topic matches a pattern in which `*` alone is special."""
    return fnmatchcase(topic, pattern.replace("[", "[[]").replace("?", "[?]"))
