"""Camera calibrations: `sensor_msgs/CameraInfo`, `foxglove.CameraCalibration`. Frames are streamed by the reader."""

from __future__ import annotations

import numpy as np

from cwcli.signals.builders.base import Reading
from cwcli.signals.canonical import CameraInfoSignal
from cwcli.signals.columns import Columns, FloatArray, Strings
from cwcli.signals.leaf_fields import find_field, numbers_of_row, read_frame_id, read_numbers
from cwcli.signals.quality import Quality, RowLedger

MAX_IMAGE_SIDE_PX = 100_000
"""The largest width or height of an image that is plausible, in pixels; chosen by hand."""
FOCAL_LENGTH_TO_IMAGE_SIDE_RANGE = (0.02, 200.0)
"""The smallest and largest ratio (1) of a focal length in pixels to the larger image side, from fisheye to telescope;
chosen by hand."""
MAX_PRINCIPAL_POINT_TO_IMAGE_SIDE = 10.0
"""The largest ratio (1) of the principal point's coordinates to the larger image side; chosen by hand."""
MAX_RATIO_BETWEEN_X_AND_Y_FOCAL_LENGTHS = 3.0
"""The largest ratio (1) between both focal lengths; chosen by hand."""


def build_camera_info(columns: Columns, reading: Reading) -> tuple[CameraInfoSignal, Quality]:
    """Build the calibration from the first message with an image size and a focal length; later ones must agree.

    A focal length, principal point, size or distortion beyond what any lens has (`FOCAL_LENGTH_TO_IMAGE_SIDE_RANGE` and
    so on) is rejected.
    ROS names its matrices `d`, `k`, `r`, `p` (ROS 1 and some JSON in capitals), foxglove `D`, `K`, `R`, `P`. An R or P
    of all zeros or of no length, or a P that no lens has, is not given: R becomes the identity, P is K with a fourth
    column of zeros.
    """
    ledger = RowLedger(columns, reading.role)
    width_px, height_px = read_numbers(columns, "width"), read_numbers(columns, "height")
    k = [numbers_of_row(find_field(columns, "k", "K"), row) for row in range(len(columns))]
    has_focal_length = np.array([len(matrix) == 9 and matrix[0] > 0.0 for matrix in k], dtype=np.bool_)
    ledger.reject(~has_focal_length | ~(width_px > 0) | ~(height_px > 0), "calibration without size or focal length")
    d = [numbers_of_row(find_field(columns, "d", "D"), row) for row in range(len(columns))]
    sides = np.column_stack([width_px, height_px]).astype(np.float64)
    known: dict[bytes, bool] = {}  # most logs repeat one message
    is_lens = np.zeros(len(columns), dtype=np.bool_)
    for row, (matrix, size, each) in enumerate(zip(k, sides, d, strict=True)):
        key = matrix.tobytes() + size.tobytes() + each.tobytes()
        if key not in known:
            known[key] = _has_plausible_intrinsics(matrix, size) and bool(np.isfinite(each).all())
        is_lens[row] = known[key]
    ledger.reject(~is_lens, "implausible calibration")
    rows = ledger.kept_rows
    first = int(rows[0]) if len(rows) else -1
    differs = np.zeros(len(columns), dtype=np.bool_)
    for row in rows:
        differs[row] = not np.array_equal(k[row], k[first]) or width_px[row] != width_px[first]
    ledger.reject(differs, "calibration differs from the first one, not used")
    ledger.quality.used = len(ledger.kept_rows)
    intrinsic = k[first].reshape(3, 3) if first >= 0 else np.full((3, 3), np.nan)
    r, p = numbers_of_row(find_field(columns, "r", "R"), first), numbers_of_row(find_field(columns, "p", "P"), first)
    has_projection = len(p) == 12 and _has_plausible_intrinsics(p, sides[first])
    model = find_field(columns, "distortion_model")
    named = isinstance(model, Strings) and first >= 0 and model.codes[first] >= 0
    signal = CameraInfoSignal(
        source=columns.topic,
        frame_id=read_frame_id(columns),
        width_px=int(width_px[first]) if first >= 0 else 0,
        height_px=int(height_px[first]) if first >= 0 else 0,
        distortion_model=model.values[model.codes[first]] if isinstance(model, Strings) and named else "",
        distortion=d[first] if first >= 0 else np.zeros(0),
        intrinsic=intrinsic,
        rectification=r.reshape(3, 3) if len(r) == 9 and np.any(r) else np.eye(3),
        projection=p.reshape(3, 4) if has_projection else np.hstack([intrinsic, np.zeros((3, 1))]),
    )
    return signal, ledger.quality


def _has_plausible_intrinsics(matrix: FloatArray, size: FloatArray) -> bool:
    """Whether a lens may have the intrinsics in K (9 numbers) or P (12) for images of (width, height)."""
    if len(matrix) not in (9, 12) or not np.isfinite(matrix).all() or not (size <= MAX_IMAGE_SIDE_PX).all():
        return False
    table, longer = matrix.reshape(3, -1), float(size.max())
    focal, centre = np.array([table[0, 0], table[1, 1]]), table[:2, 2]
    has_focal = bool(
        (focal >= FOCAL_LENGTH_TO_IMAGE_SIDE_RANGE[0] * longer).all()
        and (focal <= FOCAL_LENGTH_TO_IMAGE_SIDE_RANGE[1] * longer).all()
    )
    return (
        has_focal
        and bool(focal.max() <= MAX_RATIO_BETWEEN_X_AND_Y_FOCAL_LENGTHS * focal.min())
        and bool((np.abs(centre) <= MAX_PRINCIPAL_POINT_TO_IMAGE_SIDE * longer).all())
    )
