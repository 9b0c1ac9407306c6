"""A log: an MCAP file, or standard input, with the channels that a run has added in memory.

What counts as damage:

- A file without a footer was cut (the recorder was killed, the copy broke off), even if it ends between two records:
  opening it is an error that names `--recover`, which reads what is left and sets `Faults.truncated`.
- A file with a footer but without a summary, or with an incomplete one as the format allows, is whole. It is read
  record by record, which is slower, and nothing is counted.
- A damaged summary is an error; `--recover` then reads the file record by record.
- A damaged chunk is an error when a message in it is read; `--recover` leaves the chunk out.
- A message index that differs from its chunk is counted, and no error, because messages are found in the chunk itself.
- A message that can't be decoded is counted and left out.

Messages are found by scanning the records of a chunk, not by its index entries: both take the same time, and the scan
also finds messages that an index misses. The indexes show which chunks need not be opened, if the counts of the summary
would reveal an index that leaves a channel out; else every chunk is opened.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import TracebackType
from typing import TYPE_CHECKING, NamedTuple, Self

from cwcli.errors import InputError, MissingSignalError
from cwcli.input import MAX_CHUNK_BYTES, MAX_UNPACKED_TO_STORED_SIZE_RATIO, InputFile
from cwcli.logs.format.faults import Faults
from cwcli.logs.format.index import LogIndex
from cwcli.logs.format.open_index import open_index
from cwcli.logs.format.records import (
    AttachmentIndex,
    ChunkIndex,
    RecordError,
    read_metadata_name_and_entries,
    read_opcode_and_content_range,
)
from cwcli.logs.read.channels import ChannelInfo, channel_infos_from_index
from cwcli.logs.read.read_bounds import DEFAULT_MAX_INPUT_BYTES_OF_PIPE_OR_URL, DEFAULT_TIMEOUT_S, ReadBounds
from cwcli.logs.read.source import Source, open_source

if TYPE_CHECKING:
    from concurrent.futures import Future

    import numpy as np
    import numpy.typing as npt

    from cwcli.logs.read.frames import Frame
    from cwcli.logs.read.message_reader import MessageReader
    from cwcli.signals.columns import Columns, OutputChannel
    from cwcli.signals.transforms import Transform

__all__ = ["ChannelInfo", "Faults", "Log"]
MAX_CACHED_ROWS = 20_000
"""The greatest number of cached rows of a file, all topics together. Topics beyond it are decoded again by each stage,
so that a long log does not stay in memory. Chosen by hand."""


class ColumnCache:
    """The loaded columns of a log's topics; callers must not change them."""

    def __init__(self) -> None:
        self._of_file: dict[tuple[str, frozenset[str]], Columns] = {}
        self._n_rows = 0
        self._of_channel: dict[int, tuple[OutputChannel, Columns]] = {}

    def find_file_columns(self, topic: str, fields: Collection[str] | None) -> Columns | None:
        """Return a cached topic of the file with exactly these fields, else None.

        Other fields may decode another set of messages, if messages are cut off.
        """
        return None if fields is None else self._of_file.get((topic, frozenset(fields)))

    def store_file_columns(self, columns: Columns, fields: Collection[str] | None) -> None:
        """Store a topic of the file, unless it is large or was loaded with all fields (it may hold images)."""
        if fields is not None and self._n_rows + len(columns) <= MAX_CACHED_ROWS:
            self._n_rows += len(columns)
            self._of_file[columns.topic, frozenset(fields)] = columns

    def columns_of_channel(self, channel: OutputChannel, fields: Collection[str] | None) -> Columns:
        """Return the columns of a channel in memory; those of a flat type are cached, because they cost no memory."""
        from cwcli.logs.read.added_channels import columns_of_added_channel, is_flat_message_type
        from cwcli.signals.columns import StreamedChannel

        if fields is not None or isinstance(channel, StreamedChannel) or not is_flat_message_type(channel.schema_name):
            return columns_of_added_channel(channel, fields)
        known = self._of_channel.get(id(channel))
        if known is None:  # the channel is stored too, so that no other object gets its id
            known = self._of_channel[id(channel)] = channel, columns_of_added_channel(channel, None)
        return known[1]


class AddedContents(NamedTuple):
    """What a log holds in memory in addition to its file.

    Attributes:
        owner: The log that has the file open.
    """

    channels: tuple[OutputChannel, ...]
    metadata: Mapping[str, Mapping[str, str]]
    owner: Log


class Log:
    """An opened log. A context manager; returned arrays and frames stay valid after it is closed.

    Attributes:
        name: For messages: the file name as given, or `<stdin>`.
        file: Its bytes; a temporary copy for a pipe.
        recover: Damage is counted instead of raised.
        channels: All channels, those of the file first, then those in memory.
        profile, library: From the header.
        start_ns, end_ns: First and last log time of the file's messages; 0 if there is none.
        n_messages, n_chunks: Numbers of messages and chunks in the file.
        compressions: Compressions of its chunks in order of first use, without "" (none).
        attachments: Places and names of the attachments in the file.
        metadata: Name and entries of each metadata record, those of the file first, then those in memory.
        faults: Counts of faults; they grow while the log is read.
        added_channels, added_metadata: Channels and metadata from `with_channels`.
    """

    def __init__(
        self,
        file: InputFile,
        index: LogIndex,
        faults: Faults,
        *,
        recover: bool,
        added: AddedContents | None = None,
    ) -> None:
        owner = None if added is None else added.owner
        self._index = index
        self._owner = owner
        self._reader: MessageReader | None = None if owner is None else owner._get_message_reader()
        self._column_cache: ColumnCache = ColumnCache() if owner is None else owner._column_cache
        self.recover = recover
        self.faults = faults
        self.added_channels: tuple[OutputChannel, ...] = () if added is None else added.channels
        self.added_metadata: Mapping[str, Mapping[str, str]] = {} if added is None else added.metadata
        self.file = file
        self.name = file.name
        self.profile = index.profile
        self.library = index.library
        counted = index.statistics
        self.start_ns = counted.start_ns if counted else 0
        self.end_ns = counted.end_ns if counted else 0
        self.n_messages = counted.n_messages if counted else 0
        chunks = index.items_of_type(ChunkIndex)
        self.n_chunks = len(chunks)
        used = dict.fromkeys(chunk.compression for chunk in chunks)
        self.compressions: tuple[str, ...] = tuple(name for name in used if name)
        self.attachments: tuple[AttachmentIndex, ...] = tuple(index.items_of_type(AttachmentIndex))
        in_memory = self._infos_of_added_channels()
        hidden = {channel.topic for channel in in_memory}
        self._in_file = channel_infos_from_index(index)
        self._in_file_by_topic: dict[str, list[ChannelInfo]] = {}
        for each in self._in_file:
            self._in_file_by_topic.setdefault(each.topic, []).append(each)
        self.channels: tuple[ChannelInfo, ...] = (
            *(channel for channel in self._in_file if channel.topic not in hidden),
            *in_memory,
        )

    @classmethod
    def open(
        cls,
        source: Source | InputFile,
        *,
        recover: bool = False,
        max_chunk_bytes: int = MAX_CHUNK_BYTES,
        max_pipe_bytes: int = DEFAULT_MAX_INPUT_BYTES_OF_PIPE_OR_URL,
        max_ratio: float = MAX_UNPACKED_TO_STORED_SIZE_RATIO,
        timeout_s: float = DEFAULT_TIMEOUT_S,
    ) -> Log:
        """Open a log.

        Args:
            source: File name, or `-` for standard input (a pipe is copied to a temporary file first); a folder that is
                a log, or the names of its parts; or an open file, which is closed with the log.
            recover: Read what is intact of a damaged file, and count the rest.
            max_chunk_bytes: A chunk that decompresses to more bytes counts as damaged.
            max_pipe_bytes: Greatest number of bytes read from a pipe.
            max_ratio: Greatest total size of all chunks, decompressed, as a multiple of the file's size (plus one
                chunk); further chunks count as damaged.
            timeout_s: Longest time in seconds in which a remote file must go on.

        Raises:
            InputError: It can't be read, is no MCAP file, is damaged, or `recover` finds nothing in it.
            OutputError: The temporary copy of standard input can't be written.
            UsageError: Standard input is a terminal.
            ValueError: `max_ratio` is negative or no number.
        """
        if not max_ratio >= 0.0:
            raise ValueError(f"max_ratio is {max_ratio}: it is a number of times, at least 0")
        bounds = ReadBounds(max_chunk_bytes, max_pipe_bytes, max_ratio, recover, timeout_s)
        file = source if isinstance(source, InputFile) else open_source(source, bounds=bounds)
        file.max_chunk_bytes, file.max_ratio = max_chunk_bytes, max_ratio
        try:
            faults = Faults()
            index = open_index(file, faults, recover=recover)
            return cls(file, index, faults, recover=recover)
        except BaseException as error:
            file.__exit__(type(error), error, None)
            raise

    @property
    def index(self) -> LogIndex:
        return self._index

    @property
    def metadata_names(self) -> tuple[str, ...]:
        """Return the names of the metadata records; the records are not read."""
        return (*self._index.metadata.names, *self.added_metadata)

    @property
    def metadata(self) -> tuple[tuple[str, Mapping[str, str]], ...]:
        """Return name and entries of each metadata record; raises as `metadata_with_prefix` does."""
        return self.metadata_with_prefix("")

    def metadata_with_prefix(self, prefix: str) -> tuple[tuple[str, Mapping[str, str]], ...]:
        """Return name and entries of each metadata record whose name begins with a prefix.

        Raises:
            InputError: One is damaged, and `recover` is off.
        """
        found: list[tuple[str, Mapping[str, str]]] = []
        table = self._index.metadata
        for row, name in enumerate(table.names):
            if name.startswith(prefix):
                offset, length, _ = table[row]
                try:
                    _, start, end = read_opcode_and_content_range(self.file, offset, offset + length)
                    found.append(read_metadata_name_and_entries(self.file, start, end))
                except RecordError as error:
                    if not self.recover:
                        what = f"a metadata record is damaged: {error} (at byte {offset})"
                        raise InputError(what, where=self.name, hint="--recover leaves it out") from error
        return (*found, *(each for each in self.added_metadata.items() if each[0].startswith(prefix)))

    def load_topics(
        self, fields_by_topic: Mapping[str, Collection[str] | None], *, logged: tuple[int, int] | None = None
    ) -> dict[str, Columns]:
        """Load topics as columns, in one pass over the file.

        Messages are in log-time order, in file order where times are equal. Channels of one topic are joined. For the
        columns of a message's fields see `cwcli.signals.columns.Columns` and the decoders in `cwcli.logs.codecs`.

        Args:
            fields_by_topic: Topic -> dotted leaf fields, or None for all. Fields that no message has are left out.
            logged: Only messages logged in [start, end) ns; chunks of the file without any are not opened.

        Raises:
            MissingSignalError: There is no such topic.
            InputError: An encoding or a schema is unknown, or the file is damaged and `recover` is off.
            DataError: A topic has several schemas.
        """
        in_memory = {channel.topic: channel for channel in self.added_channels}
        loaded: dict[str, Columns] = {}
        from_file: dict[str, Collection[str] | None] = {}
        for topic, fields in fields_by_topic.items():
            if topic in in_memory:
                loaded[topic] = self._column_cache.columns_of_channel(in_memory[topic], fields)
            elif (known := self._column_cache.find_file_columns(topic, fields)) is not None:
                loaded[topic] = known
            else:
                from_file[topic] = fields
        if from_file:
            from cwcli.logs.read.columns import load_columns, return_freed_memory_to_system

            channels = {topic: self._file_channels_of_topic(topic) for topic in from_file}
            decoded = load_columns(self._get_message_reader(), channels, from_file, self.faults, self.name, logged)
            return_freed_memory_to_system(decoded)
            for topic, columns in decoded.items() if logged is None else ():
                self._column_cache.store_file_columns(columns, from_file[topic])
            loaded.update(decoded)
        return {topic: loaded[topic].slice_by_log_time(*(logged or (None, None))) for topic in fields_by_topic}

    def columns(self, topic: str, fields: Collection[str] | None = None) -> Columns:
        """Load one topic as columns; see `load`."""
        return self.load_topics({topic: fields})[topic]

    def frames(self, topic: str, spans_ns: Sequence[tuple[int, int]] | None = None) -> Iterator[Frame]:
        """Yield the camera frames of a topic in log-time order.

        Args:
            spans_ns: Chunks without messages logged in one of these times [start, end) are not opened; None: all are.

        Raises:
            MissingSignalError: There is no such topic.
            InputError: It holds no frames, or the file is damaged and `recover` is off.
        """
        from cwcli.logs.read.frames import iter_camera_frames

        return iter_camera_frames(
            self._get_message_reader(), self._file_channels_of_topic(topic), self.faults, self.name, spans_ns
        )

    def log_times_ns(self, topic: str) -> npt.NDArray[np.uint64]:
        """Return the sorted log times in ns of a topic's messages in the file; nothing is decoded.

        Raises:
            MissingSignalError: There is no such topic.
            InputError: The file is damaged and `recover` is off.
        """
        ids = [channel.id for channel in self._file_channels_of_topic(topic)]
        return self._get_message_reader().read_log_times_ns(ids)

    def iter_message_trees(self, topic: str) -> Iterator[tuple[int, object]]:
        """Yield log time in ns and tree (`cwcli.logs.codecs.tree`) of each message of a topic, in file order.

        A message that can't be decoded is yielded as a `UndecodableMessage`.

        Raises:
            MissingSignalError: There is no such topic.
            InputError: Its encoding or schema is unknown, or the file is damaged and `recover` is off.
            DataError: It has several schemas.
        """
        from cwcli.logs.read.trees import iter_message_trees

        return iter_message_trees(self._get_message_reader(), self._file_channels_of_topic(topic), self.name)

    def first_message_trees(self, topic: str, n: int, max_bytes: int) -> list[object]:
        """Return the trees of the first `n` messages of a topic, without undecodable ones and those over `max_bytes`.

        Raises:
            CwcliError: As `iter_message_trees` does.
        """
        from cwcli.logs.read.trees import read_first_message_trees

        return read_first_message_trees(
            self._get_message_reader(), self._file_channels_of_topic(topic), self.name, n, max_bytes
        )

    def transform_channels(self) -> list[ChannelInfo]:
        """Return the file's channels with transforms between frames of reference."""
        from cwcli.logs.read.transforms import is_transform_channel

        return [channel for channel in self._in_file if is_transform_channel(channel)]

    def transforms(self, topic: str) -> Iterator[tuple[Transform, ...] | None]:
        """Yield the transforms of a topic's first messages in log-time order; None for a message that can't be read.

        Raises:
            MissingSignalError: There is no such topic.
            InputError: The file is damaged and `recover` is off.
        """
        from cwcli.logs.read.transforms import iter_transforms

        for channel in self._file_channels_of_topic(topic):
            yield from iter_transforms(self._get_message_reader(), channel)

    @contextmanager
    def keep_chunks_unpacked(self) -> Iterator[None]:
        """Keep chunks unpacked inside the block, as far as memory allows: for callers that read topic by topic."""
        reader = self._get_message_reader()
        reader.keep_chunks_unpacked()
        try:
            yield
        finally:
            reader.drop_unpacked_chunks()

    def begin_sha256(self) -> Future[str]:
        """Return the hash of the file in hexadecimal; it is computed once, in a thread."""
        return self.file.begin_sha256()

    def with_channels(
        self, channels: Sequence[OutputChannel], metadata: Mapping[str, Mapping[str, str]] | None = None
    ) -> Log:
        """Return the same log with more channels, as if the file held them; they hide channels of the same topic.

        Close the original log, not the returned one.

        Args:
            channels: New channels; they replace channels of an earlier call on the same topic.
        """
        by_topic = {channel.topic: channel for channel in (*self.added_channels, *channels)}
        return Log(
            self.file,
            self._index,
            self.faults,
            recover=self.recover,
            added=AddedContents(
                tuple(by_topic.values()),
                {**self.added_metadata, **(metadata or {})},
                self if self._owner is None else self._owner,
            ),
        )

    def close(self) -> None:
        """Close the file, and remove the temporary copy of a pipe."""
        self._reader = None
        if self._owner is None:
            self.file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the log.

        Raises:
            InputError: The file changed while it was read, which may also be the reason of an error.
        """
        self._reader = None
        if self._owner is None:
            self.file.__exit__(kind, error, trace)

    def _get_message_reader(self) -> MessageReader:
        if self._reader is None:
            from cwcli.logs.read.message_reader import MessageReader

            self._reader = MessageReader(self.file, self._index, self.faults, recover=self.recover)
        return self._reader

    def _infos_of_added_channels(self) -> tuple[ChannelInfo, ...]:
        if not self.added_channels:
            return ()
        from cwcli.logs.read.added_channels import info_of_added_channel

        return tuple(info_of_added_channel(channel, -1 - k) for k, channel in enumerate(self.added_channels))

    def _file_channels_of_topic(self, topic: str) -> list[ChannelInfo]:
        """Return the file's channels of a topic.

        Raises:
            MissingSignalError: There is none.
        """
        found = self._in_file_by_topic.get(topic)
        if not found:
            names = sorted({channel.topic for channel in self.channels})
            raise MissingSignalError(f"there is no channel {topic}", where=self.name, found=tuple(names))
        return found
