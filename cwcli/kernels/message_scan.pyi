import numpy as np
import numpy.typing as npt

DONE: int
DAMAGED: int
FULL: int

class Messages:
    n: int
    channel_id: npt.NDArray[np.uint16]
    sequence: npt.NDArray[np.uint32]
    log_time_ns: npt.NDArray[np.int64]
    publish_time_ns: npt.NDArray[np.int64]
    payload_start: npt.NDArray[np.int64]
    payload_end: npt.NDArray[np.int64]
    def __init__(self, capacity: int) -> None: ...

def scan_messages(
    data: npt.NDArray[np.uint8], start: int, end: int, is_wanted: npt.NDArray[np.uint8], found: Messages
) -> tuple[int, int]: ...
def intern_spans(
    data: npt.NDArray[np.uint8],
    spans: npt.NDArray[np.int64],
    codes: npt.NDArray[np.int32],
    known: dict[bytes, int],
    values: list[bytes],
) -> None: ...
