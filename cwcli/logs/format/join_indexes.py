"""Joins the indexes of a log's parts to one index of the whole log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from cwcli.logs.format.index import Item, LogIndex, UnchunkedRange, UnchunkedRecord
from cwcli.logs.format.joined_file import UNKNOWN_CHANNEL_ID, ChannelRenumbering, JoinedFile
from cwcli.logs.format.metadata_table import MetadataRun
from cwcli.logs.format.records import (
    AttachmentIndex,
    ChunkIndex,
    Opcode,
    Statistics,
)


def join_indexes(file: JoinedFile, indexes: Sequence[LogIndex]) -> LogIndex:
    """Return the index of a log of parts, as if it were one file.

    It holds the schemas and channels of all parts, but no record that defines one: its ids may differ.

    Args:
        file: The log, its parts in their final order.
        indexes: One per part, in order, all from the same function.

    Raises:
        InputError: The log needs more than 65,534 ids of schemas or channels.
    """
    joined_index = LogIndex(
        profile=indexes[0].profile if len({each.profile for each in indexes}) == 1 else "",
        library=indexes[0].library,
        header_length=indexes[0].header_length,
        has_end=all(each.has_end for each in indexes),
        has_complete_summary=all(each.has_complete_summary for each in indexes),
        has_message_counts=all(each.has_message_counts for each in indexes),
    )
    for k in _parts_with_common_ids_first(indexes):
        file.numbering.assign_schema_and_channel_ids(indexes[k].schemas, indexes[k].channels)
    channel_ids = []
    for k, index in enumerate(indexes):
        schema_ids, ids = file.numbering.assign_schema_and_channel_ids(index.schemas, index.channels)
        channel_ids.append(ids)
        for schema in index.schemas.values():
            new_id = schema_ids[schema.id]
            joined_index.schemas.setdefault(new_id, schema._replace(id=new_id))
        for channel in index.channels.values():
            new_id = ids[channel.id]
            schema_id = schema_ids.get(channel.schema_id, 0)
            joined_index.channels.setdefault(new_id, channel._replace(id=new_id, schema_id=schema_id))
        used = {each for chunk in index.items_of_type(ChunkIndex) for each in chunk.channel_ids}
        start = file.start_byte_of_part(k)
        is_same = all(old == new for each in (schema_ids, ids) for old, new in each.items()) and used <= ids.keys()
        joined_index.renumberings.append((start, None if is_same else ChannelRenumbering(ids)))
        joined_index.items += _shift_items_into_log(file, index, start, ids, joined_index)
        joined_index.cut_chunks |= {at + start for at in index.cut_chunks}
        if index.data_end is not None:
            joined_index.data_sections.append((start, index.data_end + start))
    joined_index.statistics = _sum_statistics(joined_index, indexes, channel_ids)
    return joined_index


def _parts_with_common_ids_first(indexes: Sequence[LogIndex]) -> list[int]:
    """Return the part numbers, those first whose ids most parts share, so that these keep their ids.

    A recorder may give the first part of a recording other ids than all that follow.
    """
    layouts = [tuple(sorted((each.id, each.topic) for each in index.channels.values())) for index in indexes]
    counts = Counter(layouts)
    return sorted(range(len(indexes)), key=lambda k: -counts[layouts[k]])


def _shift_items_into_log(
    file: JoinedFile, index: LogIndex, start: int, ids: Mapping[int, int], joined: LogIndex
) -> list[Item]:
    """Return the items of a part with their offsets and channel ids in the log; `ids`: id in the part -> in the log."""
    items: list[Item] = []
    earlier: dict[tuple[int, str], list[int]] = {}
    for offset, length, name in joined.metadata if len(index.metadata) else ():
        earlier.setdefault((length, name), []).append(offset)
    for item in index.items:
        if isinstance(item, ChunkIndex):
            items.append(
                item._replace(
                    chunk_start=item.chunk_start + start,
                    index_offsets={
                        ids.get(old, UNKNOWN_CHANNEL_ID): at + start for old, at in item.index_offsets.items()
                    },
                    counts=None if item.counts is None else _renumber_counts(item.counts, ids),
                )
            )
        elif isinstance(item, UnchunkedRange):
            items.append(UnchunkedRange(item.start + start, item.end + start))
        elif isinstance(item, UnchunkedRecord):
            if item.opcode not in (Opcode.SCHEMA, Opcode.CHANNEL):
                items.append(item._replace(start=item.start + start))
        elif isinstance(item, AttachmentIndex):
            items.append(item._replace(offset=item.offset + start))
        else:
            items += _iter_new_metadata_runs_shifted_into_log(file, index, item, start, joined, earlier)
    return items


def _renumber_counts(counts: Mapping[int, int], ids: Mapping[int, int]) -> dict[int, int]:
    """Return the message counts by channel id of the log; `ids`: id in the part -> id in the log."""
    renamed: Counter[int] = Counter()
    for old, n in counts.items():
        renamed[ids.get(old, UNKNOWN_CHANNEL_ID)] += n
    return dict(renamed)


def _iter_new_metadata_runs_shifted_into_log(
    file: JoinedFile,
    index: LogIndex,
    run: MetadataRun,
    start: int,
    joined: LogIndex,
    earlier: Mapping[tuple[int, str], list[int]],
) -> Iterator[MetadataRun]:
    """Add a part's metadata records to the joined table and yield their runs, without exact copies of earlier ones."""
    last_run: MetadataRun | None = None
    for row in range(run.first, run.stop):
        offset, length, name = index.metadata[row]
        at = offset + start
        data = file[at : at + length]
        if any(file[each : each + length] == data for each in earlier.get((length, name), ())):
            continue
        joined.metadata.append(at, length, name)
        n = len(joined.metadata)
        if last_run is not None and last_run.end != at:
            yield last_run
            last_run = None
        last_run = (
            MetadataRun(at, at + length, n - 1, n) if last_run is None else last_run._replace(end=at + length, stop=n)
        )
    if last_run is not None:
        yield last_run


def _sum_statistics(
    joined: LogIndex, indexes: Sequence[LogIndex], channel_ids: Sequence[Mapping[int, int]]
) -> Statistics:
    """Return the statistics of the log from those of its parts."""
    counted = [index.statistics for index in indexes]
    counts: Counter[int] = Counter()
    for statistics, ids in zip(counted, channel_ids, strict=True):
        if statistics is not None:
            counts.update({new: statistics.channel_counts.get(old, 0) for old, new in ids.items()})
    filled = [each for each in counted if each is not None and each.n_messages]
    return Statistics(
        n_messages=sum(each.n_messages for each in filled),
        n_schemas=len(joined.schemas),
        n_channels=len(joined.channels),
        n_attachments=len(joined.items_of_type(AttachmentIndex)),
        n_metadata=len(joined.metadata),
        n_chunks=len(joined.items_of_type(ChunkIndex)),
        start_ns=min((each.start_ns for each in filled), default=0),
        end_ns=max((each.end_ns for each in filled), default=0),
        channel_counts=dict(counts) if all(each.channel_counts for each in filled) else {},
    )
