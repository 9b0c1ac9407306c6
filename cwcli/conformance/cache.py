"""Repetitions that were run before: a folder with one line for each, so that a second run does only what is new.

A repetition depends on its trial, seed, options and on the code. All of these are in its key; the code counts by its
content. So a change of cwcli makes a file of its own, and what is in the others is not used.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

import cwcli
from cwcli.conformance.results import Repetition
from cwcli.conformance.verdict import Verdict
from cwcli.errors import UsageError

SOURCE_FILE_SUFFIXES = (".py", ".pyx", ".toml", ".csv", ".json")
"""File name endings of what results can depend on; compiled files come from the sources."""
MAX_REPETITIONS_FILE_BYTES = 512 * 2**20
"""Largest file of repetitions that is read. Chosen by hand: a million repetitions."""


@functools.cache
def code_and_numpy_hash() -> str:
    """Hash of the package's files and of NumPy's version."""
    folder = Path(cwcli.__file__).parent
    found = hashlib.sha256(np.__version__.encode())
    for path in sorted(each for each in folder.rglob("*") if each.suffix in SOURCE_FILE_SUFFIXES):
        content = path.read_bytes()
        found.update(f"{path.relative_to(folder).as_posix()} {len(content)} ".encode() + content)
    return found.hexdigest()[:16]


def repetition_key(parts: Mapping[str, Any], seed: int) -> str:
    """Key of a repetition: what it depends on, besides the code, in a fixed order."""
    return hashlib.sha256(json.dumps({**parts, "seed": seed}, sort_keys=True).encode()).hexdigest()[:32]


class RepetitionCache:
    """The repetitions of one version of the code in a folder."""

    def __init__(self, folder: str) -> None:
        """Read what is there; the folder is made where it is missing.

        Raises:
            UsageError: It can't be made or read.
        """
        self.path = Path(folder) / f"conform-{code_and_numpy_hash()}.jsonl"
        self._lines: dict[str, Repetition] = {}
        try:
            Path(folder).mkdir(parents=True, exist_ok=True)
            if not self.path.exists():
                return
            if self.path.stat().st_size > MAX_REPETITIONS_FILE_BYTES:
                raise UsageError(
                    f"{self.path.name} is larger than {MAX_REPETITIONS_FILE_BYTES >> 20} MiB", where=folder
                )
            text = self.path.read_text(encoding="utf-8", errors="replace")
        except OSError as error:
            raise UsageError(
                f"can't be used for finished repetitions: {error.strerror or error}", where=folder
            ) from error
        for line in text.splitlines():
            key, repetition = _read_line(line)
            if repetition is not None:
                self._lines[key] = repetition

    def get_repetition(self, key: str) -> Repetition | None:
        """The repetition of a key; None where it was not run."""
        return self._lines.get(key)

    def add_repetitions(self, keys_and_repetitions: Iterable[tuple[str, Repetition]]) -> None:
        """Keep repetitions.

        Raises:
            UsageError: The file can't be written.
        """
        pairs = list(keys_and_repetitions)
        self._lines.update(pairs)
        lines = "".join(
            json.dumps({"key": key, "label": each.label, "verdict": asdict(each.verdict)}) + "\n"
            for key, each in pairs
            if each.verdict is not None
        )
        try:
            descriptor = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
            with os.fdopen(descriptor, "wb") as file:
                file.write(lines.encode())  # whole lines, so two runs can share a folder
        except OSError as error:
            raise UsageError(
                f"a repetition can't be stored: {error.strerror or error}", where=str(self.path)
            ) from error


def _read_line(line: str) -> tuple[str, Repetition | None]:
    """Key and repetition of a line; None for a line that an interrupted run has cut."""
    try:
        document = json.loads(line)
        verdict = document["verdict"]
        values = {str(name): float(value) for name, value in verdict["values"].items()}
        read = Verdict(
            float(verdict["margin"]), str(verdict["unit"]), str(verdict["text"]), values, bool(verdict["has_failed"])
        )
        return str(document["key"]), Repetition(str(document["label"]), read)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return "", None
