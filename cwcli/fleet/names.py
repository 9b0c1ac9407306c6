"""Safe, unique names for logs and topics, which become names of folders and values of table partitions."""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections.abc import Sequence

from cwcli.url import HIDDEN_URL_PART_TEXT

MAX_FILE_NAME_CHARACTERS = 80
"""Longest name in characters; chosen by hand."""
MAX_FILE_NAME_BYTES = 160
"""Longest name in bytes of UTF-8; chosen: file systems take 255, and a digest and a suffix follow."""
NAME_DIGEST_HEX_DIGITS = 8
"""Hexadecimal digits of the hash that makes a changed name unique; chosen by hand."""
UNICODE_CATEGORIES_OF_LETTERS_MARKS_AND_DIGITS = frozenset({"Lu", "Ll", "Lt", "Lm", "Lo", "Mn", "Mc", "Nd"})
"""Unicode categories of letters, their marks, and digits."""
_LETTER_NEVER_IN_NUMBER_TEXT_PATTERN = re.compile(r"[A-DF-SU-Ya-df-su-y]|[^\W\d_a-zA-Z]")
"""A letter that no number in text holds."""
_WORD_READ_AS_VALUE_PATTERN = re.compile(r"(?i)nan|inf|infinity|null|true|false|none")
"""Words that readers of tables take for a number, a missing value or a truth value."""
_WINDOWS_DEVICE_NAMES = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")
"""Names of devices, which Windows allows for no file."""


def safe_file_name(text: str) -> str:
    """A name that is a file name on every system, can't leave its folder, and reads as text in every table.

    Letters of all scripts stay. Text that is such a name already stays as it is. What is changed gets eight hexadecimal
    digits of the text's hash at its end, so that two texts never get one name. `2026-05-01` becomes `log-2026-05-01`: a
    reader of partitioned tables would take it for a date.
    """
    composed = unicodedata.normalize("NFC", text)  # some file systems do so too: an accent is part of its letter
    with_gaps = "".join(char if _is_plain_character(char) else "\0" for char in composed)
    name = _cut_to_max_length(re.sub(r"^[\W_]+", "", re.sub("\0+", "_", with_gaps))).rstrip(".")
    if (
        not _LETTER_NEVER_IN_NUMBER_TEXT_PATTERN.search(name)
        or _WORD_READ_AS_VALUE_PATTERN.fullmatch(name)
        or _WINDOWS_DEVICE_NAMES.fullmatch(name)
    ):
        name = f"log-{name}".rstrip("-.")
        if name == f"log-{text}":
            return name
    if name == text:
        return name
    digest = hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()[:NAME_DIGEST_HEX_DIGITS]
    return f"{name}-{digest}"


def _is_plain_character(char: str) -> bool:
    """Whether a character is a letter, a digit or a mark of any script, or one of `._-`."""
    return char in "._-" or (
        char.isalnum()
        if char.isascii()
        else unicodedata.category(char) in UNICODE_CATEGORIES_OF_LETTERS_MARKS_AND_DIGITS
    )


def _cut_to_max_length(name: str) -> str:
    return name[:MAX_FILE_NAME_CHARACTERS].encode()[:MAX_FILE_NAME_BYTES].decode(errors="ignore")


def safe_topic_name(topic: str) -> str:
    """A topic as a safe name: `/cwcli/ego/state` is `cwcli.ego.state`."""
    name = topic.removeprefix("/")
    dotted = name.replace("/", ".")
    is_plain = topic == f"/{name}" and "." not in name
    return safe_file_name(dotted) if is_plain else safe_file_name(f"{dotted} {topic}")


def unique_log_ids(sources: Sequence[str]) -> list[str]:
    """A safe, unique name for each source, from its file name.

    A name does not depend on the other sources unless several have the same file name; those get as many of their
    folders in front as it takes. Upper and lower case do not count as different, because some disks know no difference.

    Args:
        sources: Names of files or URLs, all different.
    """
    parts = [_folders_and_stem(source) for source in sources]
    depth = [1] * len(sources)
    while True:
        names = ["_".join(path[-n:]) for path, n in zip(parts, depth, strict=True)]
        safe_names = [*map(safe_file_name, names)]
        seen: dict[str, list[int]] = {}
        for i, name in enumerate(safe_names):
            seen.setdefault(name.casefold(), []).append(i)
        twins = [i for same in seen.values() if len(same) > 1 for i in same]
        longer = [i for i in twins if depth[i] < len(parts[i])]
        if not longer:
            break
        for i in longer:
            depth[i] += 1
    unresolved = set(twins)
    return [
        safe_file_name(f"{names[i]} {source}") if i in unresolved else safe_names[i] for i, source in enumerate(sources)
    ]


def _folders_and_stem(source: str) -> list[str]:
    """Split a source into its folders and stem, without empty parts and hidden secrets."""
    digest = ""
    if "://" in source:  # as `display_name_of_url` shows it: user and signature are no part of the name
        source, _, rest = (
            source.replace(f"{HIDDEN_URL_PART_TEXT}@", "")
            .replace(f"#{HIDDEN_URL_PART_TEXT}", "")
            .partition(f"?{HIDDEN_URL_PART_TEXT}")
        )
        digest = f"-{rest[2:-1]}" if rest else ""
    *folders, name = source.replace("\\", "/").rstrip("/").split("/")
    stem = name[: -len(".mcap")] if name.lower().endswith(".mcap") and len(name) > len(".mcap") else name
    stem += digest
    return [*(folder for folder in folders if folder not in ("", ".", "..")), stem]
