"""The lens in `cwcli.v1.Lanes`: with it a reader turns a, b, c of a rectified image into pixels of the camera's own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cwcli.signals.columns import Columns, Field, Int64Array, Strings, absent_strings
from cwcli.signals.leaf_fields import numbers_of_row, read_numbers
from cwcli.vision.camera import Camera, Mounting, pad_distortion_coefficients

UNRECTIFIED_CAMERA_FIELD = "rectified_from"
"""Field of the message that holds the camera before rectification."""
INTRINSIC_NAMES = ("fx", "fy", "cx", "cy")
"""Names of the intrinsic parameters, px."""

_Key = tuple[tuple[float, ...], float, str, tuple[float, ...], tuple[int, int]]


def lens_message_fields(camera_of: Callable[[int, int], Camera], image_size: Int64Array) -> dict[str, Field]:
    """Make the fields that describe the camera before rectification.

    Args:
        camera_of: (width_px, height_px) -> the camera of such images.
        image_size: Shape (n, 2): width and height, px.
    """
    sizes, of_size = np.unique(image_size, axis=0, return_inverse=True)
    cameras = [camera_of(*size) for size in sizes.tolist()]
    at = of_size.reshape(-1)
    fields: dict[str, Field] = {
        f"{UNRECTIFIED_CAMERA_FIELD}.{name}": np.array([getattr(camera, name) for camera in cameras])[at]
        for name in INTRINSIC_NAMES
    }
    model = cameras[0].distortion_model
    return fields | {
        f"{UNRECTIFIED_CAMERA_FIELD}.distortion_model": Strings(
            np.full(len(at), 0 if model else -1, np.int32), (model,)
        ),
        f"{UNRECTIFIED_CAMERA_FIELD}.distortion": np.tile(np.array(cameras[0].distortion, np.float64), (len(at), 1)),
        f"{UNRECTIFIED_CAMERA_FIELD}.roll_rad": np.array([camera.mounting.roll_rad for camera in cameras])[at],
    }


class Lenses:
    """The lenses of a channel of `cwcli.v1.Lanes`, by row.

    Args:
        columns: n messages; messages of older versions hold no lens.
    """

    def __init__(self, columns: Columns) -> None:
        n = len(columns)
        self._intrinsics = np.stack(
            [read_numbers(columns, f"{UNRECTIFIED_CAMERA_FIELD}.{name}") for name in INTRINSIC_NAMES], axis=1
        )
        self._roll_rad = read_numbers(columns, f"{UNRECTIFIED_CAMERA_FIELD}.roll_rad")
        model = columns.fields.get(f"{UNRECTIFIED_CAMERA_FIELD}.distortion_model")
        self._model = model if isinstance(model, Strings) else absent_strings(n)
        self._distortion = columns.fields.get(f"{UNRECTIFIED_CAMERA_FIELD}.distortion")
        self._size = np.stack([read_numbers(columns, f"image_{side}_px") for side in ("width", "height")], axis=1)
        self._made: dict[_Key, Camera] = {}

    def camera_before_rectification(self, row: int) -> Camera | None:
        """The camera of the original image of a frame, or None if the frame was not rectified before the search."""
        fx, fy, cx, cy = self._intrinsics[row].tolist()
        intrinsics_and_size = (*self._intrinsics[row], *self._size[row])
        if not (np.isfinite(intrinsics_and_size).all() and fx > 0.0 and fy > 0.0 and (self._size[row] > 0.0).all()):
            return None
        width_px, height_px = (int(side) for side in self._size[row])
        roll_rad = float(np.nan_to_num(self._roll_rad[row]))
        model = self._model.text_of_row(row)
        distortion = pad_distortion_coefficients(model, numbers_of_row(self._distortion, row))
        key = (fx, fy, cx, cy), roll_rad, model, distortion, (width_px, height_px)
        if key not in self._made:
            mounting = Mounting(roll_rad=roll_rad)
            self._made[key] = Camera(width_px, height_px, fx, fy, cx, cy, model, distortion, mounting)
        return self._made[key]
