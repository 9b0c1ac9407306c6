"""ONNX files of one convolution, written by hand: the fields of onnx.proto that it takes, and no more."""

from __future__ import annotations

import struct

import numpy as np
import numpy.typing as npt

from tests.protobuf_bytes import encode_varint

FLOAT = 1


def _field(number: int, value: int | str | bytes) -> bytes:
    if isinstance(value, int):
        return encode_varint(number << 3) + encode_varint(value)
    data = value.encode() if isinstance(value, str) else value
    return encode_varint(number << 3 | 2) + encode_varint(len(data)) + data


def _tensor(name: str, values: npt.NDArray[np.float32]) -> bytes:
    dims = b"".join(_field(1, n) for n in values.shape)
    data = struct.pack(f"<{values.size}f", *values.ravel().tolist())
    return dims + _field(2, FLOAT) + _field(8, name) + _field(9, data)


def _value(name: str, shape: tuple[int, ...]) -> bytes:
    dims = b"".join(_field(1, _field(1, n)) for n in shape)
    return _field(1, name) + _field(2, _field(1, _field(1, FLOAT) + _field(2, dims)))


def _ints(name: str, values: tuple[int, ...]) -> bytes:
    return _field(1, name) + b"".join(_field(8, value) for value in values) + _field(20, 7)


def convolution(
    weights: npt.NDArray[np.float32],
    bias: npt.NDArray[np.float32],
    size: tuple[int, int],
    *,
    stride: tuple[int, int] = (1, 1),
    pad: tuple[int, int] = (0, 0),
) -> bytes:
    """A net that is one convolution.

    Args:
        weights: Shape (out, in, rows, columns).
        bias: Shape (out,).
        size: Width and height of the input.
        stride, pad: Rows, columns; the padding is the same on both sides.
    """
    out, channels, rows, columns = weights.shape
    width, height = size
    made = (height + 2 * pad[0] - rows) // stride[0] + 1, (width + 2 * pad[1] - columns) // stride[1] + 1
    node = b"".join(_field(1, name) for name in ("image", "weights", "bias")) + _field(2, "lanes") + _field(4, "Conv")
    attributes = ("kernel_shape", (rows, columns)), ("strides", stride), ("pads", (*pad, *pad))
    node += b"".join(_field(5, _ints(name, values)) for name, values in attributes)
    graph = (
        _field(1, node) + _field(2, "net") + _field(5, _tensor("weights", weights)) + _field(5, _tensor("bias", bias))
    )
    graph += _field(11, _value("image", (1, channels, height, width))) + _field(12, _value("lanes", (1, out, *made)))
    return _field(1, 8) + _field(7, graph) + _field(8, _field(1, "") + _field(2, 13))
