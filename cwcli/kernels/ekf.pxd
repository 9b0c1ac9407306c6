"""The codes that the vehicle-state kernel shares with Python; ekf.pyi says what they mean."""

cdef enum MotionModel:
    DAMPED
    SONG2016

cpdef enum Sensor:
    POSITION
    VELOCITY
    SPEED
    HEADING
    ACCEL
    YAW_RATE

cpdef enum UpdateStatus:
    GATED
    USED
    USED_AFTER_RESET
    USED_IN_MANOEUVRE
