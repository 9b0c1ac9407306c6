import numpy as np
import numpy.typing as npt

# States, formats and kinds of security: see radio_frames.pyx.
FRAME_OK: int
FRAME_SHORT: int
FRAME_ENCRYPTED: int
FRAME_NO_PAYLOAD: int
FRAME_UNKNOWN: int

FORMAT_J2735: int
FORMAT_BTP: int
FORMAT_ITS: int

SECURITY_NONE: int
SECURITY_UNSECURED: int
SECURITY_SIGNED: int

def frames(
    data: npt.NDArray[np.uint8],
    starts: npt.NDArray[np.int64],
    ends: npt.NDArray[np.int64],
    *,
    form: int,
    begins: npt.NDArray[np.int64],
    stops: npt.NDArray[np.int64],
    message: npt.NDArray[np.int32],
    security: npt.NDArray[np.uint8],
    status: npt.NDArray[np.uint8],
) -> None:
    """Find the message inside what a radio handed over.

    Args:
        data: Octets of all messages, one behind the other.
        starts, ends: Shape (n,), of each message in `data`.
        form: FORMAT_J2735, FORMAT_BTP or FORMAT_ITS.
        begins, stops: Shape (n,): gets where the message lies in `data`.
        message: Shape (n,): gets J2735's message id, the BTP port or the ITS message id.
        security: Shape (n,): gets SECURITY_*.
        status: Shape (n,): gets FRAME_*.
    """
