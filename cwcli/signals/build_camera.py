"""Camera calibrations: `sensor_msgs/CameraInfo`, `foxglove.CameraCalibration`. Frames are streamed by the reader."""

from __future__ import annotations

import numpy as np

from cwcli.signals.canonical import CameraInfoSignal
from cwcli.signals.codec import Reading
from cwcli.signals.columns import Columns, Field, FloatArray, Ragged, Strings
from cwcli.signals.leaves import find, frame_id, numbers
from cwcli.signals.quality import Quality, RowLedger

CHANGED = "calibration differs from the first one, not used"


def build_camera_info(columns: Columns, reading: Reading) -> tuple[CameraInfoSignal, Quality]:
    """Build the calibration from the first message with an image size and a focal length; later ones must agree.

    ROS names its matrices `d`, `k`, `r`, `p` (ROS 1 and some JSON in capitals), foxglove `D`, `K`, `R`, `P`. An R or P
    of all zeros or of no length is not given: R becomes the identity, P is K with a fourth column of zeros.
    """
    ledger = RowLedger(columns, reading.role)
    width_px, height_px = numbers(columns, "width"), numbers(columns, "height")
    k = [_row(find(columns, "k", "K"), row) for row in range(len(columns))]
    has_focal_length = np.array([len(matrix) == 9 and matrix[0] > 0.0 for matrix in k], dtype=np.bool_)
    ledger.reject(~has_focal_length | ~(width_px > 0) | ~(height_px > 0), "calibration without size or focal length")
    rows = ledger.rows
    first = int(rows[0]) if len(rows) else -1
    differs = np.zeros(len(columns), dtype=np.bool_)
    for row in rows:
        differs[row] = not np.array_equal(k[row], k[first]) or width_px[row] != width_px[first]
    ledger.reject(differs, CHANGED)
    ledger.quality.used = len(ledger.rows)
    intrinsic = k[first].reshape(3, 3) if first >= 0 else np.full((3, 3), np.nan)
    r, p = _row(find(columns, "r", "R"), first), _row(find(columns, "p", "P"), first)
    model = find(columns, "distortion_model")
    named = isinstance(model, Strings) and first >= 0 and model.codes[first] >= 0
    signal = CameraInfoSignal(
        source=columns.topic,
        frame_id=frame_id(columns),
        width_px=int(width_px[first]) if first >= 0 else 0,
        height_px=int(height_px[first]) if first >= 0 else 0,
        distortion_model=model.values[model.codes[first]] if isinstance(model, Strings) and named else "",
        distortion=_row(find(columns, "d", "D"), first),
        intrinsic=intrinsic,
        rectification=r.reshape(3, 3) if len(r) == 9 and np.any(r) else np.eye(3),
        projection=p.reshape(3, 4) if len(p) == 12 and np.any(p) else np.hstack([intrinsic, np.zeros((3, 1))]),
    )
    return signal, ledger.quality


def _row(field: Field | None, row: int) -> FloatArray:
    """One row of a repeated numeric field, () when there is none."""
    if row < 0 or field is None or isinstance(field, Strings):
        return np.zeros(0)
    if isinstance(field, Ragged):
        return field.values[field.offsets[row] : field.offsets[row + 1]].astype(np.float64)
    return np.atleast_1d(field[row].astype(np.float64))
