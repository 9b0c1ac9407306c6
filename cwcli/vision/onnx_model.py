"""A user's own lane net: an ONNX file, and beside it a small TOML file that tells what goes in and what comes out.

`net.onnx` is described by `net.toml`. Of a net that marks lane pixels:

    kind = "segmentation"
    size = [640, 360]             # width and height of its input, pixels
    colour = "rgb"                # or "grey"; frames are grey, so all three channels are the same
    mean = [0.485, 0.456, 0.406]  # input = (grey / 255 - mean) / std
    std = [0.229, 0.224, 0.225]
    top = 0.0                     # share of the image's height that is cut off at its top before
    classes = 2                   # channels of the output (1, classes, any height, any width)
    lanes = [1]                   # those that are lane markings
    activation = "softmax"        # "sigmoid", or "none" where the net gives probabilities

Of a net that tells columns at fixed rows (row anchors; Ultra-Fast-Lane-Detection and its kind):

    kind = "row-anchor"
    axes = ["cell", "row", "lane"]  # of the output behind the first axis of length one
    rows = [64, 68, 72, ...]        # of the anchors in the input, pixels from its top
    cells = 100                     # across the input's width; one more channel is "no lane"
    lanes = 4

`output` names the output if there are several. The net runs in OpenCV (`cv2.dnn`); nothing else has to be installed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cwcli.errors import InputError, UsageError
from cwcli.input import read_file
from cwcli.signals.columns import FloatArray
from cwcli.toml_text import parse_toml
from cwcli.vision.method import GreyImage

Float32Array = npt.NDArray[np.float32]

SEGMENTATION, ROW_ANCHOR = "segmentation", "row-anchor"
COLOURS = {"grey": 1, "rgb": 3}
ACTIVATIONS = ("softmax", "sigmoid", "none")
AXES = ("cell", "row", "lane")
MAX_SIDE_PX = 4096
MARKING_PX = 2.0
"""Of the input's width: sigma of the stripe into which a row anchor's column is turned."""
SHARED = {"kind", "size", "colour", "mean", "std", "top", "output"}
KEYS = {
    SEGMENTATION: SHARED | {"classes", "lanes", "activation"},
    ROW_ANCHOR: SHARED | {"axes", "rows", "cells", "lanes"},
}


@dataclass(frozen=True)
class NetShape:
    """What goes into a net and what comes out.

    Attributes:
        kind: `SEGMENTATION` or `ROW_ANCHOR`.
        width_px, height_px: Of the input.
        mean, std: Shape (channels,): the input is (grey / 255 - mean) / std.
        top: Share of the image's height that is cut off at its top.
        output: Name of the output, "" for the only one.
        classes, lane_classes, activation: Of a segmentation.
        axes, rows, cells, n_lanes: Of row anchors.
    """

    kind: str
    width_px: int
    height_px: int
    mean: FloatArray
    std: FloatArray
    top: float
    output: str
    classes: int = 0
    lane_classes: tuple[int, ...] = ()
    activation: str = "none"
    axes: tuple[str, ...] = ()
    rows: tuple[float, ...] = ()
    cells: int = 0
    n_lanes: int = 0

    def search_size(self) -> tuple[int, int]:
        """Width and height of the whole image of which the input is the lower part."""
        return self.width_px, round(self.height_px / (1.0 - self.top))

    def expected(self) -> tuple[int | None, ...]:
        """Shape of the output; None: any length."""
        if self.kind == SEGMENTATION:
            return 1, self.classes, None, None
        lengths = {"cell": self.cells + 1, "row": len(self.rows), "lane": self.n_lanes}
        return 1, *(lengths[axis] for axis in self.axes)


class LaneNet:
    """A net that is loaded.

    Args:
        path: The ONNX file; its description lies beside it, with the suffix `.toml`.

    Raises:
        InputError: One of the files can't be read, or the net takes another input than its description tells.
        UsageError: The description is wrong.
    """

    def __init__(self, path: Path) -> None:
        import cv2

        self.path = path
        self.described = path.with_suffix(".toml")
        self.shape = described(self.described)
        data = _read(path)
        wanted = 1, len(self.shape.mean), self.shape.height_px, self.shape.width_px
        taken = input_shape(data)
        if len(taken) == len(wanted) and any(n not in (None, told) for n, told in zip(taken, wanted, strict=True)):
            what = f"the net takes {_times(taken)}, {self.described.name} tells {_times(wanted)}"
            raise InputError(what, where=str(path), hint=f"correct {self.described}")
        try:
            self._net = cv2.dnn.readNetFromONNX(np.frombuffer(data, np.uint8))
        except cv2.error as error:
            raise InputError("OpenCV can't load the net", where=str(path), found=(_last_line(error),)) from None

    def lane_map(self, grey: GreyImage) -> Float32Array:
        """How much each pixel looks like a lane marking, 0 to 1, shape as `grey`.

        Args:
            grey: An image of the `search_size`.

        Raises:
            InputError: The net does not run on its input, or its output has another shape than the description.
        """
        import cv2

        shape = self.shape
        height, width = grey.shape
        seen = grey[height - shape.height_px :].astype(np.float32) / np.float32(255.0)
        blob = (seen[None] - shape.mean[:, None, None]) / shape.std[:, None, None]
        self._net.setInput(np.ascontiguousarray(blob[None], np.float32))
        try:
            made = self._net.forward(shape.output) if shape.output else self._net.forward()
        except cv2.error as error:
            size = _times((1, len(shape.mean), shape.height_px, shape.width_px))
            what = f"the net does not run on an input of {size}"
            raise InputError(what, where=str(self.path), found=(_last_line(error),)) from None
        output = np.asarray(made, np.float32)
        if len(output.shape) != 4 or any(
            length not in (None, found) for length, found in zip(shape.expected(), output.shape, strict=True)
        ):
            what = f"the output is {_times(output.shape)}, {self.described.name} tells {_times(shape.expected())}"
            raise InputError(what, where=str(self.path), hint=f"correct {self.described}")
        small = _marked(output[0], shape) if shape.kind == SEGMENTATION else _anchored(output[0], shape)
        whole = np.zeros((height, width), np.float32)
        whole[height - shape.height_px :] = cv2.resize(small, (width, shape.height_px), interpolation=cv2.INTER_LINEAR)
        return whole


def _marked(output: Float32Array, shape: NetShape) -> Float32Array:
    """A segmentation's output (classes, h, w) as probabilities of a marking (h, w)."""
    lanes = list(shape.lane_classes)
    if shape.activation == "softmax":
        power = np.exp(output - output.max(axis=0))
        return np.asarray(power[lanes].sum(axis=0) / power.sum(axis=0), np.float32)
    chosen: Float32Array = output[lanes].max(axis=0)
    if shape.activation == "sigmoid":
        chosen = np.float32(1.0) / (np.float32(1.0) + np.exp(-np.clip(chosen, -30.0, 30.0)))
    return np.asarray(np.clip(chosen, 0.0, 1.0), np.float32)


def _anchored(output: Float32Array, shape: NetShape) -> Float32Array:
    """Row anchors' output as an image of the input's size, with a stripe along each lane."""
    cells, rows, lanes = (shape.axes.index(axis) for axis in AXES)
    logits = output.transpose(cells, rows, lanes).astype(np.float64)
    power = np.exp(logits - logits.max(axis=0))
    share = power / power.sum(axis=0)
    is_there = 1.0 - share[-1]
    inside = share[:-1] / np.maximum(share[:-1].sum(axis=0), 1e-12)
    u = np.einsum("crl,c->rl", inside, (np.arange(shape.cells) + 0.5) / shape.cells * shape.width_px - 0.5)
    anchors = np.array(shape.rows)
    order = np.argsort(anchors, kind="stable")
    v = np.arange(shape.height_px)
    is_between = (v >= anchors[order[0]] - 0.5) & (v <= anchors[order[-1]] + 0.5)
    image = np.zeros((shape.height_px, shape.width_px))
    for lane in range(shape.n_lanes):
        column = np.interp(v, anchors[order], u[order, lane])
        height = np.where(is_between, np.interp(v, anchors[order], is_there[order, lane]), 0.0)
        distance = (np.arange(shape.width_px) - column[:, None]) / MARKING_PX
        image = np.maximum(image, height[:, None] * np.exp(-0.5 * distance**2))
    return image.astype(np.float32)


def described(path: Path) -> NetShape:
    """The description of a net.

    Raises:
        InputError: It can't be read.
        UsageError: It is no TOML, or a key is missing, unknown, or not as it must be.
    """
    try:
        table = parse_toml(_read(path).decode())
    except (ValueError, RecursionError) as error:  # TOMLDecodeError is a ValueError; so is a number of 5000 digits
        raise UsageError(f"not TOML: {error}", where=str(path)) from None
    reader = _Reader(path, table)
    kind = reader.choice("kind", tuple(KEYS))
    for key in table:
        if key not in KEYS[kind]:
            raise reader.error(key, f"is unknown for {kind}", f"known: {', '.join(sorted(KEYS[kind]))}")
    width_px, height_px = reader.numbers("size", 2, 8, MAX_SIDE_PX, whole=True)
    channels = COLOURS[reader.choice("colour", tuple(COLOURS))]
    shape = NetShape(
        kind=kind,
        width_px=int(width_px),
        height_px=int(height_px),
        mean=np.array(reader.numbers("mean", channels, -1e3, 1e3)),
        std=np.array(reader.numbers("std", channels, 1e-6, 1e3)),
        top=reader.numbers("top", 1, 0.0, 0.9)[0] if "top" in table else 0.0,
        output=str(table.get("output", "")),
    )
    if kind == SEGMENTATION:
        classes = int(reader.numbers("classes", 1, 1, 1000, whole=True)[0])
        lanes = reader.numbers("lanes", None, 0, classes - 1, whole=True)
        activation = reader.choice("activation", ACTIVATIONS)
        return replace(shape, classes=classes, lane_classes=tuple(map(int, lanes)), activation=activation)
    axes = table.get("axes")
    if not isinstance(axes, list) or sorted(map(str, axes)) != sorted(AXES):
        raise reader.error("axes", f"is {axes!r}", f"permitted: {', '.join(AXES)} in the net's order")
    return replace(
        shape,
        axes=tuple(axes),
        rows=tuple(reader.numbers("rows", None, 0.0, height_px - 1.0)),
        cells=int(reader.numbers("cells", 1, 2, 10_000, whole=True)[0]),
        n_lanes=int(reader.numbers("lanes", 1, 1, 100, whole=True)[0]),
    )


@dataclass(frozen=True)
class _Reader:
    """Values of a description, checked."""

    path: Path
    table: Mapping[str, Any]

    def error(self, key: str, what: str, hint: str) -> UsageError:
        return UsageError(f"{key} {what}", where=str(self.path), hint=hint)

    def choice(self, key: str, known: tuple[str, ...]) -> str:
        value = self.table.get(key)
        if value not in known:
            raise self.error(key, "is missing" if value is None else f"is {value!r}", f"permitted: {', '.join(known)}")
        return str(value)

    def numbers(self, key: str, n: int | None, low: float, high: float, *, whole: bool = False) -> list[float]:
        """n numbers (None: one at least); one number may stand without brackets."""
        value = self.table.get(key)
        listed: list[Any] = value if isinstance(value, list) else [value]
        permitted = int if whole else (int, float)
        are_right = all(
            isinstance(each, permitted) and not isinstance(each, bool) and low <= each <= high for each in listed
        )
        if not are_right or not listed or (n is not None and len(listed) != n):
            many = "one or more" if n is None else str(n)
            what = "is missing" if value is None else f"is {value!r}"
            kind = "whole numbers" if whole else "numbers"
            raise self.error(key, what, f"permitted: {many} {kind}, {low:g} to {high:g}")
        return [float(each) for each in listed]


def _read(path: Path) -> bytes:
    """A file.

    Raises:
        InputError: It can't be read.
    """
    try:
        return read_file(path)
    except (OSError, ValueError) as error:
        raise InputError(f"can't be read: {getattr(error, 'strerror', None) or error}", where=str(path)) from None


def input_shape(data: bytes) -> tuple[int | None, ...]:
    """What an ONNX file says of its net's first input; None: any length, empty: nothing.

    OpenCV reads this too, but neither tells it nor minds an input of another shape. Numbers of the fields: onnx.proto.
    """
    try:
        graph = _fields(data, 7)[0]
        given = {bytes(_fields(tensor, 8)[0]) for tensor in _fields(graph, 5)}  # old files list their weights as inputs
        inputs = [value for value in _fields(graph, 11) if bytes(_fields(value, 1)[0]) not in given]
        dims = _fields(_fields(_fields(_fields(inputs[0], 2)[0], 1)[0], 2)[0], 1)
        return tuple(next(iter(_fields(dim, 1, wire_type=0)), None) or None for dim in dims)
    except (IndexError, ValueError):
        return ()


def _fields(data: bytes, number: int, wire_type: int = 2) -> list[Any]:
    """Values of a field of a protobuf message: whole numbers (wire type 0) or bytes (2); others are left out."""
    made: list[Any] = []
    at = 0
    while at < len(data):
        tag, at = _varint(data, at)
        value: int | bytes
        match tag & 7:
            case 0:
                value, at = _varint(data, at)
            case 1 | 2 | 5 as kind:
                n, at = _varint(data, at) if kind == 2 else (8 if kind == 1 else 4, at)
                value, at = data[at : at + n], at + n
            case _:
                raise ValueError("no protobuf")
        if tag == number << 3 | wire_type:
            made.append(value)
    return made


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while data[at] & 128:
        value, shift, at = value | (data[at] & 127) << shift, shift + 7, at + 1
    return value | data[at] << shift, at + 1


def _times(shape: tuple[int | None, ...]) -> str:
    return " x ".join("any" if length is None else str(length) for length in shape)


def _last_line(error: Exception) -> str:
    return str(error).strip().splitlines()[-1].strip()
