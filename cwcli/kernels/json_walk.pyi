import numpy as np
import numpy.typing as npt

# Kinds of values: see json_walk.pxd.
T_ABSENT: int
T_NULL: int
T_BOOL: int
T_INT: int
T_FLOAT: int
T_STRING: int
T_ARRAY: int
T_ESCAPED: int

STATUS_OK: int
STATUS_ODD: int
STATUS_UNKNOWN_KEY: int
STATUS_NOT_ASCII: int

def walk(
    data: npt.NDArray[np.uint8],
    starts: npt.NDArray[np.int64],
    ends: npt.NDArray[np.int64],
    *,
    keys: npt.NDArray[np.uint8],
    entries: npt.NDArray[np.int32],
    nodes: npt.NDArray[np.int32],
    tags: npt.NDArray[np.int64],
    values: npt.NDArray[np.int64],
    element_tags: npt.NDArray[np.int64],
    element_values: npt.NDArray[np.int64],
    cursors: npt.NDArray[np.int64],
    cursor_columns: npt.NDArray[np.int64],
    learns: bool,
    begin: int,
    first_row: int,
    status: npt.NDArray[np.uint8],
) -> int: ...
