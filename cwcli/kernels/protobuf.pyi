import numpy as np
import numpy.typing as npt

# Kinds of fields, how a value is stored, columns of the field table: see protobuf.pyx.
VARINT64: int
VARINT32: int
ZIGZAG32: int
ZIGZAG64: int
BOOLEAN: int
FIXED32: int
FIXED64: int
TEXT: int
OCTETS: int
MESSAGE: int
GROUP: int
STORE_NOT: int
STORE_ROW: int
STORE_APPEND: int
STORE_ELEMENT: int
N_COLUMNS: int

STATUS_OK: int
STATUS_ODD: int

def walk(
    data: npt.NDArray[np.uint8],
    starts: npt.NDArray[np.int64],
    ends: npt.NDArray[np.int64],
    *,
    fields: npt.NDArray[np.int32],
    nodes: npt.NDArray[np.int32],
    elements: npt.NDArray[np.int32],
    slots: npt.NDArray[np.int64],
    presence: npt.NDArray[np.int64],
    oneofs: npt.NDArray[np.int64],
    ragged: npt.NDArray[np.int64],
    cursors: npt.NDArray[np.int64],
    cursor_columns: npt.NDArray[np.int64],
    first_row: int,
    status: npt.NDArray[np.uint8],
) -> None: ...
