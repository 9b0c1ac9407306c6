"""A few commands that are disturbed at random moments, and that what must not be is found."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest

from tests.disturb import COMMANDS, KINDS, Finding, Reference, check_outputs, disturb

SEED = 3
QUICK_KINDS = ("kill", "fill", "change")


@pytest.mark.parametrize(
    "kind", [each if each in QUICK_KINDS else pytest.param(each, marks=pytest.mark.long) for each in KINDS]
)
def test_what_is_left_is_whole(kind: str) -> None:
    with tempfile.TemporaryDirectory() as folder:  # a short path: workers talk through a socket below it
        assert disturb(kind, 2, SEED, Path(folder), COMMANDS[:2]).total() == 2


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_what_any_command_leaves_is_whole(kind: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        assert disturb(kind, len(COMMANDS), SEED, Path(folder)).total() == len(COMMANDS)


@pytest.mark.parametrize(
    ("found", "message"),
    [
        ({"out.mcap": b"AB"}, "not what a run"),
        ({"out.mcap": b"ABC", "out.csv": b"y"}, "not what a run"),
        ({"out.mcap": b"ABC", ".out.csv.1234.part": b""}, "left behind"),
        ({"out.mcap": b"ABC", "out.csv": b"x"}, ""),
        ({"out.csv": b"y"}, ""),
        ({}, ""),
    ],
)
def test_a_part_of_a_file_a_mixture_and_a_leftover_are_found(
    tmp_path: Path, found: dict[str, bytes], message: str
) -> None:
    runs = {"out/out.mcap": b"ABC", "out/out.csv": b"x"}, {"out/out.mcap": b"DEF", "out/out.csv": b"y"}
    (tmp_path / "out").mkdir()
    for name, content in found.items():
        (tmp_path / "out" / name).write_bytes(content)
    if message:
        with pytest.raises(Finding, match=message):
            check_outputs(tmp_path, Reference(runs, 0.0))
    else:
        check_outputs(tmp_path, Reference(runs, 0.0))
