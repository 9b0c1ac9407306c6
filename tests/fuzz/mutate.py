"""Mutators of bytes and of texts: small changes, and some that are not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Rng = np.random.Generator

NUMBERS = tuple(
    value.to_bytes(size, "little")
    for size in (1, 2, 4, 8)
    for value in (0, 1, 0x7F, (1 << 8 * size) - 1, 1 << (8 * size - 1), (1 << (8 * size - 1)) - 1, 1 << (4 * size))
)
MOST_CHANGES = 4
SINGLE = 0.5
MOST_REPEATED = 40


def mutate(rng: Rng, data: bytes, tokens: Sequence[bytes] = NUMBERS) -> bytes:
    """One to four changes: bits, bytes, tokens, and parts that go, come twice, or change their places."""
    changed = bytearray(data)
    for _ in range(1 if rng.random() < SINGLE else int(rng.integers(2, MOST_CHANGES + 1))):
        _CHANGES[int(rng.integers(len(_CHANGES)))](rng, changed, tokens)
    return bytes(changed)


def _flip(rng: Rng, data: bytearray, tokens: Sequence[bytes]) -> None:
    if data:
        data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))


def _set(rng: Rng, data: bytearray, tokens: Sequence[bytes]) -> None:
    if data:
        data[int(rng.integers(len(data)))] = int(rng.integers(256))


def _overwrite(rng: Rng, data: bytearray, tokens: Sequence[bytes]) -> None:
    token = tokens[int(rng.integers(len(tokens)))]
    if len(data) >= len(token):
        at = int(rng.integers(len(data) - len(token) + 1))
        data[at : at + len(token)] = token


def _insert(rng: Rng, data: bytearray, tokens: Sequence[bytes]) -> None:
    at = int(rng.integers(len(data) + 1))
    data[at:at] = tokens[int(rng.integers(len(tokens)))]


def _cut(rng: Rng, data: bytearray, tokens: Sequence[bytes]) -> None:
    del data[int(rng.integers(len(data) + 1)) :]


def _cut_little(rng: Rng, data: bytearray, tokens: Sequence[bytes]) -> None:
    del data[max(0, len(data) - int(rng.integers(1, 10))) :]


def _remove(rng: Rng, data: bytearray, tokens: Sequence[bytes]) -> None:
    start, stop = _part(rng, data)
    del data[start:stop]


def _repeat(rng: Rng, data: bytearray, tokens: Sequence[bytes]) -> None:
    start, stop = _part(rng, data)
    n = 1 if rng.random() < 0.8 else int(rng.integers(2, MOST_REPEATED))
    data[stop:stop] = data[start:stop] * n


def _move(rng: Rng, data: bytearray, tokens: Sequence[bytes]) -> None:
    start, stop = _part(rng, data)
    part = data[start:stop]
    del data[start:stop]
    at = int(rng.integers(len(data) + 1))
    data[at:at] = part


def _part(rng: Rng, data: bytearray) -> tuple[int, int]:
    """A part, most often a short one."""
    start = int(rng.integers(len(data) + 1))
    longest = len(data) - start if rng.random() < 0.2 else min(len(data) - start, 16)
    return start, start + int(rng.integers(longest + 1))


_CHANGES = (_flip, _flip, _set, _overwrite, _overwrite, _insert, _cut, _cut_little, _remove, _repeat, _move)
