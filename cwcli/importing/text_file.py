"""Text files of any size: their encoding and first lines, and all lines one at a time, each of a bounded length."""

from __future__ import annotations

import codecs
import stat
from collections.abc import Iterator
from pathlib import Path

from cwcli.errors import InputError
from cwcli.input import read_file
from cwcli.lazy_dataclass import dataclass

MAX_INSPECTED_HEAD_BYTES = 256 << 10
"""Bytes of a file that are looked at before it is read; chosen by hand."""
BYTES_UNDEFINED_IN_CODE_PAGE_1252 = frozenset(b"\x81\x8d\x8f\x90\x9d")
"""Bytes that code page 1252 does not define."""
MAX_CONTROL_CHARACTER_SHARE_OF_TEXT = 0.02
"""Largest share of control characters in a text; chosen by hand."""
MAX_LINE_CHARACTERS = 1 << 20
"""Greatest number of characters of a line, 1 Mi. Chosen by hand: the lines of a recording have a few thousand."""


@dataclass(frozen=True)
class TextHead:
    """The beginning of a text file.

    Attributes:
        encoding: Name of the encoding for Python and Arrow.
        bom_bytes: Length of the mark at the start.
        lines: The first lines without their ends; the last one may be cut and is left out, unless it is the only one.
        is_whole: The lines are the whole file.
    """

    encoding: str
    bom_bytes: int
    lines: tuple[str, ...]
    is_whole: bool


def read_head(path: str | Path, n_bytes: int = MAX_INSPECTED_HEAD_BYTES) -> bytes:
    """Return the first bytes of a file.

    Raises:
        InputError: It can't be read.
    """
    try:
        mode = Path(path).stat().st_mode
        if stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode):  # it is read twice
            raise InputError("it is a pipe", where=str(path), hint="write it to a file, and import that")
        return read_file(path, n_bytes)
    except (OSError, ValueError) as error:
        what = getattr(error, "strerror", None) or str(error)
        raise InputError(f"it can't be read: {what}", where=str(path)) from error


def decode_text_head(data: bytes) -> TextHead | None:
    """Decode the beginning of a file; None if it is no text."""
    is_whole = len(data) < MAX_INSPECTED_HEAD_BYTES
    encoding, bom = "utf-8", 0
    for mark, name in (
        (codecs.BOM_UTF8, "utf-8"),
        (codecs.BOM_UTF16_LE, "utf-16-le"),
        (codecs.BOM_UTF16_BE, "utf-16-be"),
    ):
        if data.startswith(mark):
            encoding, bom = name, len(mark)
            break
    body = data[bom:]
    if encoding == "utf-8" and b"\0" in body:
        return None
    try:
        text = codecs.getincrementaldecoder(encoding)().decode(body, final=is_whole)
    except UnicodeDecodeError:
        if encoding != "utf-8":
            return None
        encoding = "latin-1" if BYTES_UNDEFINED_IN_CODE_PAGE_1252 & set(body) else "cp1252"
        text = body.decode(encoding, "replace")
    if not text:
        return TextHead(encoding, bom, (), is_whole)
    n_control = sum(
        1 for character in text if (ord(character) < 32 and character not in "\t\r\n\f\v") or character == "\ufffd"
    )
    if n_control > MAX_CONTROL_CHARACTER_SHARE_OF_TEXT * len(text):
        return None
    lines = text.splitlines()
    if not is_whole and len(lines) > 1:
        lines = lines[:-1]
    return TextHead(encoding, bom, tuple(lines), is_whole)


def iter_text_lines(path: str, encoding: str = "utf-8-sig") -> Iterator[str]:
    """Yield the lines of a text file with their ends; bytes that are no text become the replacement character.

    Raises:
        InputError: The file can't be read, or a line is longer than `MAX_LINE_CHARACTERS`.
    """
    try:
        with Path(path).open(encoding=encoding, errors="replace") as file:
            number = 0
            while line := file.readline(MAX_LINE_CHARACTERS + 1):
                number += 1
                if len(line) > MAX_LINE_CHARACTERS:
                    raise InputError(
                        f"line {number} has more than {MAX_LINE_CHARACTERS:,} characters",
                        where=path,
                        hint="the file is damaged, or no text",
                    )
                yield line
    except OSError as error:
        raise InputError(f"it can't be read: {error.strerror}", where=path) from error


def no_text_error(name: str) -> InputError:
    """Return the error that a file is no text."""
    return InputError(
        "its bytes are no text and no format that is known",
        where=name,
        hint="`cwcli import --help` lists what can be read",
    )
