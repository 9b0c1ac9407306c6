"""Short names of warnings and conflicts that survive a rerun, so that a link to one still finds it."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable

MIN_NAME_DIGITS = 4
"""The least number of hexadecimal digits in an anchor's name. Chosen by hand; not fitted."""


def stable_anchor_names(log: str, kind: str, distinguishing_keys: Iterable[tuple[str, ...]]) -> list[str]:
    """Return a name such as `warning-3f2a` for each item that a rerun keeps.

    It is made of the log's name, of whom and by which rule, and of how many such came before it in the log: not of
    times, which another version or option moves by some milliseconds. Names that agree by chance get more digits.

    Args:
        kind: `warning` or `conflict`.
        distinguishing_keys: What tells them apart (rule, other vehicle), in order of time.
    """
    before: Counter[tuple[str, ...]] = Counter()
    digests = []
    for key in distinguishing_keys:
        text = "\0".join((log, kind, *key, str(before[key])))
        before[key] += 1
        digests.append(hashlib.blake2s(text.encode("utf-8", "surrogateescape")).hexdigest())
    short: dict[str, None] = {}  # in their order
    for digest in digests:
        length = next(n for n in range(MIN_NAME_DIGITS, len(digest) + 1) if digest[:n] not in short)
        short[digest[:length]] = None
    return [f"{kind}-{name}" for name in short]
