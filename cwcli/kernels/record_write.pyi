def write_records(
    pieces: list[bytes | tuple[int, int, bytes]],
    counts: dict[int, int],
    entries: dict[int, bytearray],
    out: bytearray,
) -> tuple[int, int]:
    """Write the records of a chunk.

    Args:
        pieces: Encoded records, and messages: channel id, log time in ns, payload.
        counts: Channel id -> the number of its messages before; those of the pieces are added.
        entries: Channel id -> its message index; the entries of the pieces are appended.
        out: Filled, and of exactly the size of all records.

    Returns:
        The first and the last log time in ns.

    Raises:
        ValueError: `out` has another size.
        OverflowError: A channel id or a log time does not fit into a record.
        TypeError: A payload is not `bytes`.

        What was written until then stays in `counts`, `entries` and `out`.
    """
