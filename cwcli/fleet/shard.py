"""One part of a run that is spread over many machines: `--shard I/N`."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from typing import TypeVar

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass

T = TypeVar("T")
"""The type of what is shared out."""
MAX_SHARDS = 100_000
"""Greatest number of shards; chosen by hand, above the limits of the schedulers."""
WORD_FOR_SHARD_NUMBER_FROM_ENVIRONMENT = "auto"
"""Word for a number that an array job's scheduler sets."""
FIRST_INDEX_BY_ENVIRONMENT_VARIABLE = {
    "JOB_COMPLETION_INDEX": 0,
    "AWS_BATCH_JOB_ARRAY_INDEX": 0,
    "SLURM_ARRAY_TASK_ID": None,
}
"""Environment variable with a job's number -> the first number; None: `SLURM_ARRAY_TASK_MIN` says it.

Sources: indexed jobs of Kubernetes, array jobs of AWS Batch, sbatch of Slurm."""
SHARD_FORM_HINT = "for example 3/8, or auto/8 in an array job"
"""Advice on the form of a shard."""


@dataclass(frozen=True)
class Shard:
    """Shard `index` (from 1) of `count`."""

    index: int
    count: int

    def select_shard_items(self, every: Sequence[T]) -> list[T]:
        """Return this shard's part of what is shared out: each `count`-th one."""
        return list(every[self.index - 1 :: self.count])


def parse_shard(text: str, environment: Mapping[str, str] = os.environ) -> Shard:
    """Parse `I/N`, or `auto/N` with the number from the environment of an array job.

    Raises:
        UsageError: It is neither, out of range, or the environment has no number.
    """
    index_text, sign, count_text = text.partition("/")
    if not sign or not re.fullmatch(r"[0-9]{1,6}", count_text):
        raise UsageError(f"--shard {text} is not a shard", hint=SHARD_FORM_HINT)
    count = int(count_text)
    if not 1 <= count <= MAX_SHARDS:
        raise UsageError(f"--shard {text}: the number of shards is not from 1 to {MAX_SHARDS}", hint=SHARD_FORM_HINT)
    if index_text == WORD_FOR_SHARD_NUMBER_FROM_ENVIRONMENT:
        index = _index_from_environment(text, environment)
    elif re.fullmatch(r"[0-9]{1,6}", index_text):
        index = int(index_text)
    else:
        raise UsageError(f"--shard {text} is not a shard", hint=SHARD_FORM_HINT)
    if not 1 <= index <= count:
        raise UsageError(f"--shard {text}: shard {index} is not from 1 to {count}", hint=SHARD_FORM_HINT)
    return Shard(index, count)


def _index_from_environment(text: str, environment: Mapping[str, str]) -> int:
    """Return the number, from 1, that a scheduler has set.

    Raises:
        UsageError: None has, or it is no number.
    """
    for name, first in FIRST_INDEX_BY_ENVIRONMENT_VARIABLE.items():
        value = environment.get(name)
        if value is None:
            continue
        start = environment.get("SLURM_ARRAY_TASK_MIN", "0") if first is None else str(first)
        if not (value.isascii() and value.isdigit() and start.isascii() and start.isdigit()):
            raise UsageError(f"--shard {text}: the environment variable {name} is not a number")
        return int(value) - int(start) + 1
    names = ", ".join(FIRST_INDEX_BY_ENVIRONMENT_VARIABLE)
    raise UsageError(f"--shard {text}: no array job has set a number", hint=f"set one of {names}, or name the shard")
