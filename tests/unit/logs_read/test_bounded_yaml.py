"""YAML is counted before it is built: an alias as all that it stands for."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from cwcli.logs.read.recording import (
    ExpandedSize,
    RecordingListing,
    load_yaml,
    measure_expanded_size,
    read_recording_listing,
)

BOUNDS = {"max_nodes": 1000, "max_chars": 1000, "max_depth": 10}
MAX_PEAK_BYTES = 20_000_000
"""Of which 16 MB are the buffer into which a metadata.yaml of any size is read."""
NOT_UNDERSTOOD = RecordingListing(faults={"metadata.yaml that can't be understood": 1})


def bomb(levels: int, width: int = 9) -> str:
    """Lists of aliases of lists: `width` ** `levels` values."""
    lines = [f"a0: &a0 [{', '.join(['lol'] * width)}]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * width)}]" for k in range(1, levels)]
    return "\n".join(lines) + "\n"


def size(text: str) -> ExpandedSize:
    return measure_expanded_size(yaml.parse(text, yaml.SafeLoader), max_nodes=10**9, max_chars=10**9, max_depth=64)


@pytest.mark.parametrize(
    ("text", "nodes", "chars"),
    [
        ("abc", 1, 3),
        ("[a, bc]", 3, 3),
        ("{a: &x [b, c], d: *x}", 1 + 2 + 2 + 1 + 3, 1 + 2 + 1 + 2),
        ("[&x abc, *x, *x]", 4, 9),
        ("[&x [a], &x [b, c], *x]", 1 + 2 + 3 + 3, 1 + 2 + 2),
        # keys a0 and a1 count; a0 has 1 + 3 nodes of 3 characters, a1 has 1 and three times those
        (bomb(2, 3), 1 + 2 + 4 + (1 + 3 * 4), 4 + 9 + 27),
    ],
)
def test_size_is_that_of_the_document_with_every_alias_written_out(text: str, nodes: int, chars: int) -> None:
    assert size(text) == ExpandedSize(nodes, chars)


@pytest.mark.parametrize(
    "text",
    [
        bomb(9),
        "[&x [*x]]",
        "[*nowhere]",
        "&x [a, &x [*x]]",
        "[" * 11 + "]" * 11,
        "[" + "a, " * 1000 + "]",
        "a" * 1001,
        "[&x " + "a" * 300 + ", *x, *x, *x]",
    ],
)
def test_what_stands_for_too_much_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"it is nested|an alias names"):
        load_yaml(text.encode(), **BOUNDS)


def test_no_more_events_are_taken_than_the_bounds_allow() -> None:
    taken = 0

    def events() -> Iterator[Any]:
        nonlocal taken
        for event in yaml.parse("[" + "a, " * 100_000 + "]", yaml.SafeLoader):
            taken += 1
            yield event

    with pytest.raises(ValueError, match="too much"):
        measure_expanded_size(events(), **BOUNDS)
    assert taken == 2 + BOUNDS["max_nodes"] + 1  # stream and document begin, and the first node beyond the bound


def test_scalars_stay_text_and_keys_mean_nothing() -> None:
    document = load_yaml(b"{a: 1:1:1, b: 2020-01-01, c: !!python/name:os.system x, <<: {d: 0x10}, e: ~}", **BOUNDS)
    assert document == {"a": "1:1:1", "b": "2020-01-01", "c": "x", "<<": {"d": "0x10"}, "e": "~"}


INFORMATION = "rosbag2_bagfile_information:\n  message_count: 7\n"


def test_an_alias_that_stands_for_little_is_read(tmp_path: Path) -> None:
    """PyYAML writes a list that occurs twice as an anchor and an alias."""
    path = tmp_path / "metadata.yaml"
    path.write_text(f"x: &names [a_0.mcap, a_1.mcap]\n{INFORMATION}  relative_file_paths: *names\n")
    assert read_recording_listing(str(path)) == RecordingListing({"a_0.mcap": None, "a_1.mcap": None}, 7)


@pytest.mark.parametrize(
    "text",
    [
        f"{bomb(9)}{INFORMATION}  relative_file_paths: *a8\n",
        f"{bomb(9)}{INFORMATION}  relative_file_paths: [*a8]\n",
        f"{bomb(5)}{INFORMATION}  relative_file_paths: [a.mcap]\n  files: [{{path: *a4}}]\n",
        f"{INFORMATION}  relative_file_paths: [[a.mcap]]\n",
        f"{INFORMATION}  relative_file_paths: a.mcap\n",
        f"{INFORMATION}  relative_file_paths: [{'a' * 5000}]\n",
    ],
)
def test_a_metadata_that_stands_for_too_much_costs_little_memory(tmp_path: Path, text: str) -> None:
    path = tmp_path / "metadata.yaml"
    path.write_text(text)
    read_recording_listing(str(path))  # imports take memory once
    tracemalloc.start()
    try:
        assert read_recording_listing(str(path)) == NOT_UNDERSTOOD
        assert tracemalloc.get_traced_memory()[1] < MAX_PEAK_BYTES
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(("written", "read"), [("12", 12), ("-1", None), ("1" * 20, None), ("many", None), ("~", None)])
def test_a_count_is_a_number_or_unknown(tmp_path: Path, written: str, read: int | None) -> None:
    path = tmp_path / "metadata.yaml"
    path.write_text(
        f"rosbag2_bagfile_information:\n  relative_file_paths: [a.mcap]\n  message_count: {written}\n  files: null\n"
    )
    assert read_recording_listing(str(path)) == RecordingListing({"a.mcap": None}, read)
