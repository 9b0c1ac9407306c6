"""Independent ways to a quaternion, and exports of cwcli."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from shutil import copyfile
from tempfile import mkdtemp

import numpy as np

from cwcli.cli.main import run_command_line

SAMPLE = Path(__file__).parents[3] / "sample_logs" / "curve.mcap"


def quaternion_of(rotation: np.ndarray) -> list[float]:
    """Return x, y, z, w of a rotation matrix, as scipy has it."""
    from scipy.spatial.transform import Rotation

    return list(Rotation.from_matrix(rotation).as_quat())


@cache
def annotated_log() -> Path:
    """Return a bundled log with the ego's states."""
    target = Path(mkdtemp(prefix="cwcli-test-")) / "annotated.mcap"
    assert run_command_line(["estimate", str(SAMPLE), "-o", str(target), "--quiet"]) == 0
    return target


@cache
def _exported_once(name: str) -> Path:
    target = annotated_log().with_name(name)
    assert run_command_line(["export", str(annotated_log()), "--what", "ego", "-o", str(target), "--quiet"]) == 0
    return target


def exported(folder: Path, name: str) -> Path:
    """Return the ego's states as a file whose format the name selects."""
    return Path(copyfile(_exported_once(name), folder / name))
