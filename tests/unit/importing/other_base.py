"""What the makers of `other_tables` and `other_files` share: the drive as printed columns, and a phone in its holder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from tests.unit.importing.drive import START_S, digits
from tests.unit.importing.other_drive import DRIVE

D = DRIVE
N = len(D.t_s)
NS = START_S * 10**9
SLOW = slice(0, None, 10)
"""Rows of a receiver of 1 Hz."""


@dataclass(frozen=True)
class OtherCase:
    """Files that belong together.

    Attributes:
        make: Folder -> files.
        holds: What the log must hold, with the greatest error of each (95th percentile): m, m/s, rad, rad/s, m/s^2.
        start: Stamp of the drive's first moment, ns.
        asks: Words of the refusal, "" where the files need no answer.
    """

    make: Callable[[Path], list[Path]]
    holds: dict[str, float]
    start: int = NS
    asks: str = ""


def stamps(pattern: str, rows: slice = slice(None), hours: float = 0.0, cut: int = 0) -> list[str]:
    """Return the times of rows, printed; `cut` removes characters from their ends (microseconds to milliseconds)."""
    start = datetime.fromtimestamp(START_S, UTC) + timedelta(hours=hours)
    texts = [(start + timedelta(seconds=round(t, 3))).strftime(pattern) for t in D.t_s[rows].tolist()]
    return [text[:-cut] if cut else text for text in texts]


def table(
    folder: Path, name: str, head: str, columns: Sequence[Sequence[str]], mark: str = ",", **kw: str
) -> list[Path]:
    """Write separated text; `decimal=","` writes decimal commas, `encoding` sets the encoding."""
    comma = kw.get("decimal", ".")
    rows = [
        mark.join(
            cell.replace(".", comma) if comma == "," and "." in cell and cell.count(".") == 1 else cell for cell in row
        )
        for row in zip(*columns, strict=True)
    ]
    (folder / name).write_bytes(
        (kw.get("end", "\n").join([head, *rows]) + kw.get("end", "\n")).encode(kw.get("encoding", "utf-8"))
    )
    return [folder / name]


LAT, LON = digits(D.lat_deg, 8), digits(D.lon_deg, 8)
COURSE = digits(D.course_deg, 2)
FILL = ["1"] * N
HOLDER = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Axes of the car -> axes of a phone in landscape, its screen to the driver."""


def phone_vectors() -> tuple[np.ndarray, np.ndarray]:
    """Return the specific force and the turn rate in the phone's axes."""
    force = np.stack([D.accel_mps2, D.speed_mps * D.yaw_rate_radps, np.full(N, 9.80665)], axis=1)
    turn = np.stack([np.zeros(N), np.zeros(N), D.yaw_rate_radps], axis=1)
    return force @ HOLDER.T, turn @ HOLDER.T


P, V, R = {"fix": 0.3}, {"velocity": 0.15}, {"speed": 0.15}
"""What a log holds, with the greatest error: fixes, velocities, speeds of the car."""
