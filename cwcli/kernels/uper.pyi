import numpy as np
import numpy.typing as npt

# The operations and states: see uper.pyx.
UPER_END: int
UPER_INT: int
UPER_INT_EXT: int
UPER_ENUM_EXT: int
UPER_BIG: int
UPER_SIZED: int
UPER_SEQUENCE: int
UPER_OPTION: int
UPER_SEQUENCE_END: int
UPER_CHOICE: int
UPER_ALTERNATIVE: int
UPER_LIST: int
UPER_LIST_END: int
UPER_OPEN: int
UPER_CASE: int
UPER_OPEN_END: int

UPER_OK: int
UPER_SHORT: int
UPER_RANGE: int
UPER_LENGTH: int
UPER_FRAGMENTED: int
UPER_FULL: int

def decode(
    data: npt.NDArray[np.uint8],
    starts: npt.NDArray[np.int64],
    ends: npt.NDArray[np.int64],
    *,
    program: npt.NDArray[np.int64],
    tables: npt.NDArray[np.int64],
    counts: npt.NDArray[np.int64],
    current: npt.NDArray[np.int64],
    first: int,
    missing: int,
    status: npt.NDArray[np.uint8],
) -> int:
    """Decode messages from row `first` on.

    Args:
        data: Octets of all messages, one behind the other.
        starts, ends: Shape (n,), of each message in `data`.
        program: Shape (m, 8), see uper.pyx; its nesting is checked where it is made.
        tables: Shape (t, 3): address, columns and rows of each int64 table. Table 0 has a row for each message and is
            filled with `missing`; the others take an element a row, the message's row in column 0.
        counts: Shape (t,): rows of each table that are filled; changed.
        current: Shape (t,): work space.
        first: The first row to decode.
        missing: What stands for an absent component.
        status: Shape (n,): UPER_OK for the messages to decode; gets what is wrong with those that can't be.

    Returns:
        How many messages are done: n, or the row of the one for which a table has no room.
    """
