"""Lines of text files of any size: one at a time, each of a bounded length."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from cwcli.errors import InputError

MAX_LINE_CHARACTERS = 1 << 20
"""Greatest number of characters of a line, 1 Mi. Chosen by hand: the lines of a recording have a few thousand."""


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
