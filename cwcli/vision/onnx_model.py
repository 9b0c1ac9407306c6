"""A user's own lane net: an ONNX file, and beside it a small TOML file that describes its input and output.

`net.onnx` is described by `net.toml`. A net that marks lane pixels:

    kind = "segmentation"
    size = [640, 360]             # width and height of its input, pixels
    colour = "rgb"                # or "grey"; frames are grey, so all three channels are the same
    mean = [0.485, 0.456, 0.406]  # input = (grey / 255 - mean) / std
    std = [0.229, 0.224, 0.225]
    top = 0.0                     # share of the image's height that is cut off at its top before
    classes = 2                   # channels of the output (1, classes, any height, any width)
    lanes = [1]                   # those that are lane markings
    activation = "softmax"        # "sigmoid", or "none" where the net gives probabilities

A net that gives columns at fixed rows (row anchors; Ultra-Fast-Lane-Detection and its kind):

    kind = "row-anchor"
    axes = ["cell", "row", "lane"]  # of the output behind the first axis of length one
    rows = [64, 68, 72, ...]        # of the anchors in the input, pixels from its top
    cells = 100                     # across the input's width; one more channel is "no lane"
    lanes = 4

`output` names the output if there are several. The net runs in OpenCV (`cv2.dnn`); nothing else has to be installed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cwcli.bounded_process import Limits, cpu_limit_for_file_size_s, run_bounded
from cwcli.errors import InputError, UsageError
from cwcli.input import MAX_NET_OR_TABLE_FILE_BYTES, read_file
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray
from cwcli.toml_text import parse_toml
from cwcli.vision.camera import WidthHeightPx
from cwcli.vision.method import GreyImage

Float32Array = npt.NDArray[np.float32]

SEGMENTATION, ROW_ANCHOR = "segmentation", "row-anchor"
"""The kinds of nets: one marks lane pixels, the other gives columns at fixed rows."""
N_CHANNELS_BY_COLOUR = {"grey": 1, "rgb": 3}
"""Number of input channels of each colour setting."""
ACTIVATION_NAMES = ("softmax", "sigmoid", "none")
"""The values of `activation` in a net's description: what turns a segmentation's output into probabilities; `none`, if
it gives them already."""
ROW_ANCHOR_AXES = ("cell", "row", "lane")
"""The axes of a row-anchor output."""
PATH_OF_FUNCTION_THAT_CHECKS_NET_IN_BOUNDED_PROCESS = "cwcli.vision.onnx_model:load_and_run_net_on_black_image"
"""The function that the bounded process runs before the net is used."""
MEMORY_LIMIT_OF_NET_CHECK_PROCESS_BYTES, MEMORY_LIMIT_OF_NET_CHECK_BYTES_PER_NET_BYTE = 700_000_000, 8
"""Memory of that process, and more for each byte of the net. Chosen by hand: OpenCV reserves 240 MB that it does not
use, and a net is held as numbers, once more while it is optimised."""
MAX_INPUT_SIDE_PX = 4096
"""Greatest width and height of a net's input in pixels. Chosen by hand; not fitted."""
SIGMA_OF_STRIPE_DRAWN_FOR_ROW_ANCHOR_COLUMN_PX = 2.0
"""Sigma in pixels of the input of the stripe that replaces a row anchor's column. Chosen by hand; not fitted."""
DESCRIPTION_KEYS_OF_BOTH_MODEL_KINDS = {"kind", "size", "colour", "mean", "std", "top", "output"}
"""Keys that the descriptions of both kinds may have."""
DESCRIPTION_KEYS_BY_MODEL_KIND = {
    SEGMENTATION: DESCRIPTION_KEYS_OF_BOTH_MODEL_KINDS | {"classes", "lanes", "activation"},
    ROW_ANCHOR: DESCRIPTION_KEYS_OF_BOTH_MODEL_KINDS | {"axes", "rows", "cells", "lanes"},
}
"""Keys that the description of each kind may have."""


@dataclass(frozen=True)
class NetDescription:
    """Description of a net's input and output.

    Attributes:
        kind: `SEGMENTATION` or `ROW_ANCHOR`.
        width_px, height_px: Size of the input.
        mean, std: Shape (channels,): the input is (grey / 255 - mean) / std.
        top: Share of the image's height that is cut off at its top.
        output: Name of the output, "" for the only one.
        classes, lane_classes, activation: Output of a segmentation.
        axes, rows, cells, n_lanes: Output of row anchors.
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

    def search_size(self) -> WidthHeightPx:
        """Width and height of the whole image, of which the input is the lower part."""
        return self.width_px, round(self.height_px / (1.0 - self.top))

    def expected_output_shape(self) -> tuple[int | None, ...]:
        """Shape that the output must have; None stands for any length."""
        if self.kind == SEGMENTATION:
            return 1, self.classes, None, None
        lengths = {"cell": self.cells + 1, "row": len(self.rows), "lane": self.n_lanes}
        return 1, *(lengths[axis] for axis in self.axes)


class LaneNet:
    """A lane net that is loaded.

    Args:
        path: The ONNX file; its description lies beside it, with the suffix `.toml`.

    Raises:
        InputError: One of the files can't be read, or the net takes another input than its description says.
        UsageError: The description is wrong.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.description_path = path.with_suffix(".toml")
        self.description = read_net_description(self.description_path)
        data = _read_net_file(path)
        described_shape = 1, len(self.description.mean), self.description.height_px, self.description.width_px
        net_shape = read_onnx_input_shape(data)
        if len(net_shape) == len(described_shape) and any(
            n not in (None, own) for n, own in zip(net_shape, described_shape, strict=True)
        ):
            what = (
                f"the net expects {_format_shape(net_shape)}, but {self.description_path.name} describes "
                f"{_format_shape(described_shape)}"
            )
            raise InputError(what, where=str(path), hint=f"correct {self.description_path}")
        limits = Limits(
            cpu_limit_for_file_size_s(len(data)),
            0,
            data_bytes=MEMORY_LIMIT_OF_NET_CHECK_PROCESS_BYTES
            + MEMORY_LIMIT_OF_NET_CHECK_BYTES_PER_NET_BYTE * len(data),
            has_threads=True,
        )
        run_bounded(
            PATH_OF_FUNCTION_THAT_CHECKS_NET_IN_BOUNDED_PROCESS,
            {"path": str(path), "shape": described_shape, "output": self.description.output},
            limits,
            str(path),
        )
        self._net = _load_net(path, data)

    def compute_marking_map(self, grey: GreyImage) -> Float32Array:
        """How much each pixel looks like a lane marking, 0 to 1, of the shape of `grey`.

        Args:
            grey: An image of the `search_size`.

        Raises:
            InputError: The net does not run on its input, or its output has another shape than the description.
        """
        import cv2

        shape = self.description
        height, width = grey.shape
        network_input = grey[height - shape.height_px :].astype(np.float32) / np.float32(255.0)
        blob = (network_input[None] - shape.mean[:, None, None]) / shape.std[:, None, None]
        output = _run_net(self.path, self._net, np.ascontiguousarray(blob[None], np.float32), shape.output)
        if len(output.shape) != 4 or any(
            length not in (None, found)
            for length, found in zip(shape.expected_output_shape(), output.shape, strict=True)
        ):
            what = (
                f"the output is {_format_shape(output.shape)}, but {self.description_path.name} describes "
                f"{_format_shape(shape.expected_output_shape())}"
            )
            raise InputError(what, where=str(self.path), hint=f"correct {self.description_path}")
        small = (
            _segmentation_to_marking_map(output[0], shape)
            if shape.kind == SEGMENTATION
            else _row_anchors_to_marking_map(output[0], shape)
        )
        whole = np.zeros((height, width), np.float32)
        whole[height - shape.height_px :] = cv2.resize(small, (width, shape.height_px), interpolation=cv2.INTER_LINEAR)
        return whole


def load_and_run_net_on_black_image(request: dict[str, Any]) -> dict[str, Any]:
    """Load a net and run it on a black image, in a process of its own; a net that takes too much ends that process.

    Raises:
        InputError: It can't be loaded, or does not run on such an image.
    """
    path = Path(request["path"])
    _run_net(path, _load_net(path, _read_net_file(path)), np.zeros(request["shape"], np.float32), request["output"])
    return {}


def _load_net(path: Path, data: bytes) -> Any:
    import cv2

    try:
        return cv2.dnn.readNetFromONNX(np.frombuffer(data, np.uint8))
    except cv2.error as error:
        raise InputError("OpenCV can't load the net", where=str(path), found=(_last_line_of_error(error),)) from None


def _run_net(path: Path, net: Any, blob: Float32Array, output: str) -> Float32Array:
    import cv2

    try:
        net.setInput(blob)
        return np.asarray(net.forward(output) if output else net.forward(), np.float32)
    except (cv2.error, ValueError, TypeError) as error:  # the last two: an output that is no array
        what = f"the net does not run on an input of {_format_shape(blob.shape)}"
        raise InputError(what, where=str(path), found=(_last_line_of_error(error),)) from None


def _segmentation_to_marking_map(output: Float32Array, shape: NetDescription) -> Float32Array:
    """Turn a segmentation's output (classes, h, w) into probabilities of a marking (h, w)."""
    lanes = list(shape.lane_classes)
    if shape.activation == "softmax":
        power = np.exp(output - output.max(axis=0))
        return np.asarray(power[lanes].sum(axis=0) / power.sum(axis=0), np.float32)
    chosen: Float32Array = output[lanes].max(axis=0)
    if shape.activation == "sigmoid":
        chosen = np.float32(1.0) / (np.float32(1.0) + np.exp(-np.clip(chosen, -30.0, 30.0)))
    return np.asarray(np.clip(chosen, 0.0, 1.0), np.float32)


def _row_anchors_to_marking_map(output: Float32Array, shape: NetDescription) -> Float32Array:
    """Turn the output of row anchors into an image of the input's size, with a stripe along each lane."""
    cells, rows, lanes = (shape.axes.index(axis) for axis in ROW_ANCHOR_AXES)
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
        distance = (np.arange(shape.width_px) - column[:, None]) / SIGMA_OF_STRIPE_DRAWN_FOR_ROW_ANCHOR_COLUMN_PX
        image = np.maximum(image, height[:, None] * np.exp(-0.5 * distance**2))
    return image.astype(np.float32)


def read_net_description(path: Path) -> NetDescription:
    """Read the description of a net.

    Raises:
        InputError: The file can't be read.
        UsageError: The file is no TOML, or a key is missing, unknown or has a wrong value.
    """
    try:
        table = parse_toml(_read_net_file(path).decode())
    except ValueError as error:  # TOMLDecodeError is a ValueError; so is a number of 5000 digits
        raise UsageError(f"not TOML: {error}", where=str(path)) from None
    reader = _DescriptionReader(path, table)
    kind = reader.read_choice("kind", tuple(DESCRIPTION_KEYS_BY_MODEL_KIND))
    for key in table:
        if key not in DESCRIPTION_KEYS_BY_MODEL_KIND[kind]:
            raise reader.error_about_key(
                key, f"is unknown for {kind}", f"known: {', '.join(sorted(DESCRIPTION_KEYS_BY_MODEL_KIND[kind]))}"
            )
    width_px, height_px = reader.read_numbers("size", 2, 8, MAX_INPUT_SIDE_PX, whole=True)
    channels = N_CHANNELS_BY_COLOUR[reader.read_choice("colour", tuple(N_CHANNELS_BY_COLOUR))]
    shape = NetDescription(
        kind=kind,
        width_px=int(width_px),
        height_px=int(height_px),
        mean=np.array(reader.read_numbers("mean", channels, -1e3, 1e3)),
        std=np.array(reader.read_numbers("std", channels, 1e-6, 1e3)),
        top=reader.read_numbers("top", 1, 0.0, 0.9)[0] if "top" in table else 0.0,
        output=str(table.get("output", "")),
    )
    if kind == SEGMENTATION:
        classes = int(reader.read_numbers("classes", 1, 1, 1000, whole=True)[0])
        lanes = reader.read_numbers("lanes", None, 0, classes - 1, whole=True)
        activation = reader.read_choice("activation", ACTIVATION_NAMES)
        return replace(shape, classes=classes, lane_classes=tuple(map(int, lanes)), activation=activation)
    axes = table.get("axes")
    if not isinstance(axes, list) or sorted(map(str, axes)) != sorted(ROW_ANCHOR_AXES):
        raise reader.error_about_key(
            "axes", f"is {axes!r}", f"permitted: {', '.join(ROW_ANCHOR_AXES)} in the net's order"
        )
    return replace(
        shape,
        axes=tuple(axes),
        rows=tuple(reader.read_numbers("rows", None, 0.0, height_px - 1.0)),
        cells=int(reader.read_numbers("cells", 1, 2, 10_000, whole=True)[0]),
        n_lanes=int(reader.read_numbers("lanes", 1, 1, 100, whole=True)[0]),
    )


@dataclass(frozen=True)
class _DescriptionReader:
    """Reads and checks the values of a description."""

    path: Path
    table: Mapping[str, Any]

    def error_about_key(self, key: str, what: str, hint: str) -> UsageError:
        """An error about the value of a key."""
        return UsageError(f"{key} {what}", where=str(self.path), hint=hint)

    def read_choice(self, key: str, choices: tuple[str, ...]) -> str:
        """Read a value that must be one of the known ones."""
        value = self.table.get(key)
        if value not in choices:
            raise self.error_about_key(
                key, "is missing" if value is None else f"is {value!r}", f"permitted: {', '.join(choices)}"
            )
        return str(value)

    def read_numbers(
        self, key: str, wanted_count: int | None, low: float, high: float, *, whole: bool = False
    ) -> list[float]:
        """Read n numbers, or one or more if n is None, within limits; a single number may stand without brackets."""
        value = self.table.get(key)
        listed: list[Any] = value if isinstance(value, list) else [value]
        permitted = int if whole else (int, float)
        are_right = all(
            isinstance(each, permitted) and not isinstance(each, bool) and low <= each <= high for each in listed
        )
        if not are_right or not listed or (wanted_count is not None and len(listed) != wanted_count):
            many = "one or more" if wanted_count is None else str(wanted_count)
            what = "is missing" if value is None else f"is {value!r}"
            kind = "whole numbers" if whole else "numbers"
            raise self.error_about_key(key, what, f"permitted: {many} {kind}, {low:g} to {high:g}")
        return [float(each) for each in listed]


def _read_net_file(path: Path) -> bytes:
    """Read a file.

    Raises:
        InputError: The file can't be read.
    """
    try:
        return read_file(path, limit=MAX_NET_OR_TABLE_FILE_BYTES)
    except (OSError, ValueError) as error:
        raise InputError(f"can't be read: {getattr(error, 'strerror', None) or error}", where=str(path)) from None


def read_onnx_input_shape(data: bytes) -> tuple[int | None, ...]:
    """Read the shape of a net's first input from an ONNX file; None stands for any length, an empty shape for an
    unknown one.

    OpenCV reads this too, but neither exposes it nor refuses an input of another shape. Field numbers: onnx.proto.
    """
    try:
        graph = _protobuf_field_values(data, 7)[0]
        stated_shape = {
            bytes(_protobuf_field_values(tensor, 8)[0]) for tensor in _protobuf_field_values(graph, 5)
        }  # old files list their weights as inputs
        inputs = [
            value
            for value in _protobuf_field_values(graph, 11)
            if bytes(_protobuf_field_values(value, 1)[0]) not in stated_shape
        ]
        dims = _protobuf_field_values(
            _protobuf_field_values(_protobuf_field_values(_protobuf_field_values(inputs[0], 2)[0], 1)[0], 2)[0], 1
        )
        return tuple(next(iter(_protobuf_field_values(dim, 1, wire_type=0)), None) or None for dim in dims)
    except (IndexError, ValueError):
        return ()


def _protobuf_field_values(data: bytes, field_number: int, wire_type: int = 2) -> list[Any]:
    """Values of one field of a protobuf message: whole numbers (wire type 0) or bytes (2)."""
    values: list[Any] = []
    position = 0
    while position < len(data):
        tag, position = _varint_and_next_place(data, position)
        value: int | bytes
        match tag & 7:
            case 0:
                value, position = _varint_and_next_place(data, position)
            case 1 | 2 | 5 as kind:
                n, position = _varint_and_next_place(data, position) if kind == 2 else (8 if kind == 1 else 4, position)
                value, position = data[position : position + n], position + n
            case _:
                raise ValueError("no protobuf")
        if tag == field_number << 3 | wire_type:
            values.append(value)
    return values


def _varint_and_next_place(data: bytes, position: int) -> tuple[int, int]:
    """Read a protobuf varint; returns its value and the place after it."""
    value = shift = 0
    while data[position] & 128:
        value, shift, position = value | (data[position] & 127) << shift, shift + 7, position + 1
    return value | data[position] << shift, position + 1


def _format_shape(shape: tuple[int | None, ...]) -> str:
    """A shape as text, such as 1 x 3 x any x 640."""
    return " x ".join("any" if length is None else str(length) for length in shape)


def _last_line_of_error(error: Exception) -> str:
    """The last line of an error's text."""
    return str(error).strip().splitlines()[-1].strip()
