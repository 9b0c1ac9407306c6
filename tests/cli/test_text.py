"""Text for a terminal: nothing that a file name can smuggle in, and numbers that read well."""

import math

import pytest

from cwcli.cli.text import (
    escape_control_characters,
    format_byte_size,
    format_duration,
    format_number,
    terminal_cells_of_text,
    wrap_paragraph,
    wrap_text,
)
from cwcli.text import escape_surrogates


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("/gps/fix", "/gps/fix"),
        ("a b", "a b"),
        ("red\x1b[31m", "red\\x1b[31m"),
        ("two\nlines\r", "two\\nlines\\r"),
        ("bell\x07 nul\x00 c1\x9b", "bell\\x07 nul\\x00 c1\\x9b"),
        ("right\u202eleft", "right\\u202eleft"),
        ("line\u2028separator", "line\\u2028separator"),
        ("bad\udcffbyte", "bad\\xffbyte"),
        ("Straße 東京", "Straße 東京"),
    ],
    ids=["plain", "space", "colour", "newline", "bell", "bidi", "separator", "not-utf8", "letters"],
)
def test_printable_escapes_what_moves_the_cursor(text: str, shown: str) -> None:
    assert escape_control_characters(text) == shown


@pytest.mark.parametrize(
    ("text", "encoded"),
    [
        ("Straße 東京 \x1b", "Straße 東京 \x1b".encode()),
        ("bad\udcffbyte", rb"bad\xffbyte"),
        ("half\ud800", rb"half\ud800"),
        ("\U0001f600", b"\xf0\x9f\x98\x80"),
    ],
    ids=["letters", "not-utf8", "half a pair", "whole pair"],
)
def test_replaced_surrogates_can_be_encoded(text: str, encoded: bytes) -> None:
    assert escape_surrogates(text).encode() == encoded


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.0, "0"),
        (12.3456, "12.35"),
        (0.6, "0.6000"),
        (-0.012345, "-0.01235"),
        (123456.7, "123457"),
        (0.00001234, "1.234e-05"),
        (1.5e9, "1.500e+09"),
        (math.nan, "-"),
        (math.inf, "-"),
    ],
)
def test_number_has_four_digits(value: float, shown: str) -> None:
    assert format_number(value) == shown


@pytest.mark.parametrize(
    ("seconds", "shown"),
    [
        (0.0, "0.0 s"),
        (33.04, "33.0 s"),
        (240.4, "4 min 0 s"),
        (3725.0, "1 h 2 min 5 s"),
        (86_400.0 * 9, "9.0 days"),
        (47.0 * 365.25 * 86_400.0, "47.0 years"),
    ],
)
def test_duration_is_in_words(seconds: float, shown: str) -> None:
    assert format_duration(seconds) == shown


@pytest.mark.parametrize(("n_bytes", "shown"), [(512, "512 B"), (81_300, "81.3 kB"), (2_500_000_000_000, "2500.0 GB")])
def test_size_is_in_powers_of_1000(n_bytes: int, shown: str) -> None:
    assert format_byte_size(n_bytes) == shown


def test_wrap_breaks_at_spaces_then_slashes_then_anywhere() -> None:
    assert wrap_text("one two three", 8) == ["one two", "three"]
    assert wrap_text("/camera/front/image", 10) == ["/camera/", "front/", "image"]
    assert wrap_text("abcdefgh", 3) == ["abc", "def", "gh"]
    assert wrap_text("hard-brake-other", 12) == ["hard-brake-", "other"]
    assert wrap_text("BasicSafetyMessage", 17) == ["BasicSafety", "Message"]


def test_wide_characters_count_two_cells() -> None:
    assert terminal_cells_of_text("東京 e\u0301") == 6
    assert all(terminal_cells_of_text(line) <= 5 for line in wrap_text("東京都東京都", 5))


def test_paragraph_indents_its_other_lines() -> None:
    lines = wrap_paragraph("word " * 40, first="note: ", rest="      ").split("\n")
    assert lines[0].startswith("note: word")
    assert all(line.startswith("      word") for line in lines[1:])
    assert max(map(len, lines)) <= 80
