"""Moving rows of bytes, against plain loops and the official varint encoder."""

from __future__ import annotations

import numpy as np
import pytest
from google.protobuf.internal.encoder import _VarintBytes

from cwcli.logs.encoders.byte_rows import copy_rows, encode_varint, encode_varints, join_rows, offsets_from_sizes


@pytest.mark.parametrize("max_size", [0, 1, 5, 300])
@pytest.mark.parametrize("n", [0, 1, 7, 500])
def test_copy_rows_equals_a_loop(n: int, max_size: int) -> None:
    rng = np.random.default_rng(n + max_size)
    sizes = rng.integers(0, max_size + 1, n)
    source = rng.integers(0, 256, int(sizes.sum()) + 3, dtype=np.uint8)
    source_starts = offsets_from_sizes(sizes)[:-1]
    order = rng.permutation(n)
    target_starts = np.zeros(n, np.int64)
    target_starts[order] = offsets_from_sizes(sizes[order])[:-1]
    target = np.zeros(int(sizes.sum()), np.uint8)
    copy_rows(target, target_starts, source, source_starts, sizes)
    expected = b"".join(source[source_starts[i] : source_starts[i] + sizes[i]].tobytes() for i in order)
    assert target.tobytes() == expected


def test_copy_rows_of_equal_size() -> None:
    source = np.arange(12, dtype=np.uint8)
    target = np.zeros(12, np.uint8)
    copy_rows(target, np.array([8, 0, 4]), source, np.array([0, 4, 8]), np.array([4, 4, 4]))
    assert target.tolist() == [4, 5, 6, 7, 8, 9, 10, 11, 0, 1, 2, 3]


def test_varints_equal_the_official_encoder() -> None:
    edges = [0, 1, 127, 128, 16383, 16384, 2**21, 2**28 - 1, 2**28, 2**35, 2**63, 2**64 - 1]
    rows = encode_varints(np.array(edges, np.uint64))
    encoded = [rows.data[rows.offsets[i] : rows.offsets[i + 1]].tobytes() for i in range(len(edges))]
    assert encoded == [_VarintBytes(value) for value in edges]
    assert [encode_varint(value) for value in edges] == encoded


def test_varints_of_nothing() -> None:
    assert len(encode_varints(np.zeros(0, np.uint64))) == 0


def test_join_rows_keeps_empty_rows() -> None:
    rows = join_rows([b"ab", b"", b"c"])
    assert rows.sizes.tolist() == [2, 0, 1]
    assert rows.slice_rows(1, 3).sizes.tolist() == [0, 1]
