"""The sentence about a drive's length says which part of the log was used."""

from __future__ import annotations

import json
from typing import NamedTuple

import pytest

from cwcli.digest.drive_sentences import drive_length_sentence

S = 1_000_000_000


class Span(NamedTuple):
    start_ns: int
    end_ns: int


LOG = Span(100 * S, 110 * S)


@pytest.mark.parametrize(
    ("start_ns", "end_ns", "said"),
    [
        (None, None, "The log is 10.0 s long."),
        (103 * S, 106 * S, "The log is 10.0 s long, of which 3.0 s to 6.0 s were used."),
        (None, 106 * S, "The log is 10.0 s long, of which 0.0 s to 6.0 s were used."),
        (100 * S, 110 * S, "The log is 10.0 s long."),  # all but the last message
        (0, 500 * S, "The log is 10.0 s long."),
    ],
)
def test_sentence_names_the_used_part(start_ns: int | None, end_ns: int | None, said: str) -> None:
    configuration = json.dumps({"sources": {"start_ns": start_ns, "end_ns": end_ns}})
    assert drive_length_sentence(LOG, None, {"estimate": {"configuration": configuration}}) == said


def test_sentence_of_a_log_without_records_is_of_all() -> None:
    assert drive_length_sentence(LOG, None, {}) == "The log is 10.0 s long."
