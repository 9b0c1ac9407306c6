import numpy as np
import numpy.typing as npt

# The operations: see cdr.pyx.
OP_SKIP: int
OP_FIXED: int
OP_STRING: int
OP_SEQUENCE: int
OP_LOOP: int
OP_REPEAT: int
OP_END: int
OP_APPEND: int
OP_BLOB: int

STATUS_OK: int
STATUS_SHORT: int
STATUS_FOREIGN: int

def walk(
    data: npt.NDArray[np.uint8],
    starts: npt.NDArray[np.int64],
    ends: npt.NDArray[np.int64],
    *,
    program: npt.NDArray[np.int32],
    program_v2: npt.NDArray[np.int32],
    slots: npt.NDArray[np.int64],
    ragged: npt.NDArray[np.int64],
    cursors: npt.NDArray[np.int64],
    cursor_columns: npt.NDArray[np.int64],
    first_row: int,
    status: npt.NDArray[np.uint8],
) -> None: ...
