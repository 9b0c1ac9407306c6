"""A result file, `docs/results/NAME.json`: what a study measured, with its command, seeds, date and version."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).parents[2] / "docs" / "results"
"""Folder of the result files."""
RELATIVE_TOLERANCE = 0.005
"""A number without an interval is the same on another machine within this share of it. Chosen by hand: three digits
are shown at most where nothing is random."""
ABSOLUTE_TOLERANCE = 1e-6
"""Numbers nearer than this are the same. Chosen by hand: rounding of numbers that are zero."""
MAX_INTERVALS_OFF = 3.0
"""A small seed set may be off by this many half intervals, each widened to its own number of seeds: six sigmas."""


@dataclass(frozen=True)
class Value:
    """One measured number.

    Attributes:
        value: Of the whole study; None where there is none, or where it is a text.
        low, high: Its 95 % interval; None where nothing in it is random.
        small: The same number of the small seed set, measured when the file was written.
        text: A text instead of a number, "" else.
    """

    value: float | None = None
    low: float | None = None
    high: float | None = None
    small: float | None = None
    text: str = ""


@dataclass(frozen=True)
class ResultFile:
    """What a study measured.

    Attributes:
        name: Of the study.
        command: The command that measures it.
        seeds, small_seeds: Numbers of seeds of the whole and of the small set; 0 where nothing is random.
        date: When it was measured.
        version: Of cwcli.
        values: By key.
        more: What a page needs besides numbers.
    """

    name: str
    command: str
    seeds: int
    small_seeds: int
    date: str
    version: str
    values: Mapping[str, Value]
    more: Mapping[str, Any] = field(default_factory=dict)


def read_result_file(name: str, folder: Path = RESULTS) -> ResultFile:
    """Read a result file.

    Raises:
        FileNotFoundError: There is none of this name.
    """
    document = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    values = {key: Value(**fields) for key, fields in document.pop("values").items()}
    return ResultFile(**document, values=values)


def write_result_file(result: ResultFile, folder: Path = RESULTS) -> Path:
    """Write a result file, one value a line; returns its path."""
    document = asdict(result)
    values = document.pop("values")
    more = document.pop("more")
    lines = [f" {json.dumps(key)}: {json.dumps(value)}" for key, value in document.items()]
    rows = ",\n".join(
        f"  {json.dumps(key)}: {json.dumps({k: v for k, v in value.items() if v not in (None, '')} or {'value': None})}"
        for key, value in values.items()
    )
    lines.append(f' "values": {{\n{rows}\n }}')
    if more:
        lines.append(f' "more": {json.dumps(more)}')
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"{result.name}.json"
    target.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    return target


def faults_of_small_run(stored: ResultFile, now: Mapping[str, float | str | None]) -> list[str]:
    """Compare a rerun of the small seed set with the file: one sentence for each number that moved.

    A number may move by half of its stated interval: the seeds are the same, so less is no difference that the page
    would show. The stored number of the small set must also agree with that of the whole set.
    """
    faults = []
    of_small_set = {key for key, value in stored.values.items() if value.small is not None or value.text}
    if lost := sorted(of_small_set - set(now)):
        faults.append(f"{stored.name}: '{lost[0]}' is not measured any more")
    for key, value in stored.values.items():
        found = now.get(key)
        if isinstance(found, str):
            if found != value.text:
                faults.append(f"{stored.name}: '{key}' is '{found}', and the file has '{value.text}'")
            continue
        if value.small is None or found is None or math.isnan(found):
            if key in now and (value.small is None) != (found is None or math.isnan(found)):
                faults.append(f"{stored.name}: '{key}' is {found}, and the file has {value.small}")
            continue
        allowed = max(ABSOLUTE_TOLERANCE, RELATIVE_TOLERANCE * abs(value.small), _half_interval(value))
        if abs(found - value.small) > allowed:
            faults.append(f"{stored.name}: '{key}' moved from {value.small:.6g} to {found:.6g} (+-{allowed:.3g})")
        if value.value is not None and _half_interval(value) > 0.0 and stored.small_seeds:
            widened = MAX_INTERVALS_OFF * _half_interval(value) * math.sqrt(1.0 + stored.seeds / stored.small_seeds)
            if abs(value.value - value.small) > max(widened, ABSOLUTE_TOLERANCE):
                faults.append(f"{stored.name}: '{key}' has {value.value:.6g}, which the small set does not support")
    return faults


def _half_interval(value: Value) -> float:
    """Return half of the stated interval; 0 where there is none."""
    return 0.0 if value.low is None or value.high is None else 0.5 * (value.high - value.low)
