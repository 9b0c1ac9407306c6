"""The states and codes that the observers share with Python; observer.pyi says what the codes mean."""

cpdef enum:
    VY = 0              # lateral speed, left positive
    G = 1               # yaw rate
    YL = 2              # lateral deviation at the preview point
    EL = 3              # heading deviation
    STEER = 4           # steering angle
    KL = 5              # road curvature, right positive
    ETA = 6             # nominal mass / mass
    GYRO = 7            # bias of the measured yaw rate
    CAM = 8             # yaw of the camera against its declared mounting
    N = 9               # number of states

cpdef enum EventKind:
    LANE
    YAW_RATE
    STEERING_ANGLE

cpdef enum Begin:
    GO_ON
    ANEW
    STOP

cpdef enum EventStatus:
    NOT_STARTED
    USED
    PREDICTED
    GATED
    STARTED
