"""Notes on gaps say where the longest one is."""

from types import SimpleNamespace

import numpy as np
import pytest

from cwcli.stages.summaries.estimate import format_gap_notes

S = 1_000_000_000


@pytest.mark.parametrize(
    ("seconds", "note"),
    [
        ([0, 1, 2, 3, 4], None),
        ([*range(20, 31)], "/a: a gap without messages, 20.0 s before its first message"),
        (
            [*range(11), *range(25, 31)],
            "/a: a gap without messages, 15.0 s from 10.0 s after the first message of any channel",
        ),
        ([*range(9), *range(17, 21)], "/a: 2 gaps without messages; the longest is 10.0 s after its last message"),
    ],
)
def test_note_on_the_longest_gap(seconds: list[int], note: str | None) -> None:
    signal = SimpleNamespace(source="/a", stamp_ns=np.array(seconds, np.int64) * S)
    end_s = 4 if note is None else 30
    assert format_gap_notes([signal], 0, end_s * S) == ([] if note is None else [note])
