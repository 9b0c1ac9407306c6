import numpy as np
import numpy.typing as npt

STATUS_OK: int
STATUS_ODD: int

def walk(
    data: npt.NDArray[np.uint8],
    starts: npt.NDArray[np.int64],
    ends: npt.NDArray[np.int64],
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
