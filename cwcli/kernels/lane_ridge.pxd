"""The numbers of a lane and the columns of their prior, for Python too; cwcli.vision.lane_model says what they are."""

cpdef enum:
    VANISHING = 0
    MIDDLE = 1
    WIDTH = 2
    BEND = 3
    HORIZON = 4
    SPIRAL = 5
    N = 6

cpdef enum:
    MEAN = 0
    SIGMA = 1
    LOW = 2
    HIGH = 3
