"""Names of logs and topics as names of folders: safe, unique, and the same every time."""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cwcli.fleet.names import safe_file_name, safe_topic_name, unique_log_ids

SAFE = re.compile(r"[^\W_][^\x00-,/:-@\[-^`{-\x7f]{0,99}")
"""It begins with a letter or a digit and holds none of ASCII but letters, digits and `._-`."""


def is_safe(name: str) -> bool:
    """As above; besides no spaces, controls or signs of other scripts, composed, and not too long for a disk."""
    kinds = {unicodedata.category(char)[0] for char in name if char not in "._-"}
    is_composed = unicodedata.is_normalized("NFC", name)
    return bool(SAFE.fullmatch(name)) and kinds <= {"L", "M", "N"} and is_composed and len(name.encode()) < 200


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("drive.mcap", "drive"),
        ("logs/drive-07_b.mcap", "drive-07_b"),
        ("s3://bucket/drives/night.run.mcap", "night.run"),
        ("drive.MCAP", "drive"),
        ("logs/drive/", "drive"),
        ("2026-05-01.mcap", "log-2026-05-01"),
        ("0042.mcap", "log-0042"),
        ("1e5.mcap", "log-1e5"),
        ("straße.mcap", "straße"),
        ("走行-01.mcap", "走行-01"),
        ("проезд.mcap", "проезд"),
    ],
)
def test_plain_names_stay(source: str, expected: str) -> None:
    assert unique_log_ids([source]) == [expected]


@pytest.mark.parametrize(
    "source",
    [
        "../../etc/passwd",
        "..",
        ".mcap",
        "...mcap",
        "a\nb.mcap",
        "<script>alert(1)</script>.mcap",
        "x;rm -rf ~.mcap",
        "\x1b[31mred.mcap",
        "a=b/log=c.mcap",
        "con.mcap",
        "NUL.mcap",
        "nan.mcap",
        "x" * 300 + ".mcap",
        "\u202egnp.mcap",
        "caf\udce9.mcap",
        "a b.mcap",
        "back\\slash.mcap",
        "%2e%2e%2f.mcap",
        "-rf.mcap",
        "\u0301a.mcap",
    ],
)
def test_hostile_names_become_safe(source: str) -> None:
    (name,) = unique_log_ids([source])
    assert is_safe(name)
    assert name.lower() not in ("con", "nul", "nan")
    assert Path("out", name).resolve().parent == Path("out").resolve()


@given(st.text(min_size=1, max_size=120))
def test_any_text_becomes_safe(text: str) -> None:
    assert is_safe(safe_file_name(text))
    assert is_safe(safe_topic_name(text))


@given(st.lists(st.text(alphabet="aA. _/-1é", min_size=1, max_size=8), unique=True, max_size=8))
def test_different_names_stay_different(texts: list[str]) -> None:
    names = [safe_file_name(text) for text in texts]
    plain = {text for text, name in zip(texts, names, strict=True) if text == name}
    assert len(set(names)) == len(texts) or any(f"log-{text}" in plain for text in texts)
    assert len({name.casefold() for name in unique_log_ids(texts)}) == len(texts)


def test_twins_get_their_folders_in_front() -> None:
    ids = unique_log_ids(["day1/drive.mcap", "day2/drive.mcap", "day2/other.mcap"])
    assert ids == ["day1_drive", "day2_drive", "other"]


def test_twins_deeper_down() -> None:
    assert unique_log_ids(["a/x/drive.mcap", "b/x/drive.mcap"]) == ["a_x_drive", "b_x_drive"]


def test_names_that_differ_only_in_case() -> None:
    first, second = unique_log_ids(["Drive.mcap", "drive.mcap"])
    assert first.casefold() != second.casefold()


def test_made_name_against_a_real_one() -> None:
    first, second = unique_log_ids(["7.mcap", "logs/log-7.mcap"])
    assert first != second


def test_topics() -> None:
    assert safe_topic_name("/cwcli/ego/state") == "cwcli.ego.state"
    assert len({safe_topic_name(topic) for topic in ("/a/b", "/a.b", "a/b", "/a//b", "/a/b/")}) == 5
