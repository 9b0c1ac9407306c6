"""The codes that the target-tracking kernels share with Python; track.pyi says what they mean."""

cpdef enum Model:
    CV
    CA
    CTRV

cpdef enum RowKind:
    NOTHING = -1
    POSITION = 0
    RADAR_WITHOUT_RATE = 1
    RADAR = 2

cpdef enum RowStatus:
    USED
    GATED
    STARTED
    SINGULAR
    PREDICTED
    EMPTY
