# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Inline parts of the vehicle-state kernel: what contradicts the state is a manoeuvre, or a position that jumped.

A message (position, speed and heading of one sender at one time) that the gate rejects is wrong, or the first of a
manoeuvre that the state has not followed. The message itself tells which: a car cannot be where its own speeds and
headings since the last believed message have not brought it, and its speed and course cannot change faster than its
tyres allow. A position that jumped once and then moves as speed and heading say is more likely wrong than they are.
The plain twin is tests/unit/estimation/naive_messages.py.
"""

from libc.math cimport M_PI, cos, fabs, remainder, sin, sqrt

from cwcli.kernels.ekf cimport Sensor
from cwcli.kernels.ekf_motion cimport (
    ACCEL, HEADING, JERK, N_MOTION, SPEED, X, Y, YAW_ACCEL, YAW_RATE, add_sym
)

cdef extern from *:
    """
    // The most that tyres carry on a dry road, m/s^2: full braking of cars is 8 to 11 (docs/references.md, UN R13-H).
    #define MAX_TYRE_ACCEL_MPS2 12.0
    // The fastest that a car turns, rad/s: 5 m/s on a circle of 5 m, the smallest turning circle of a car.
    #define MAX_TURN_RATE_RADPS 1.0
    // Differences beyond this many of their sigmas do not agree; chosen, as one message in 16,000 of a normal error.
    #define MAX_MESSAGE_SIGMAS 4.0
    // A message is compared with one that is at most this old, s. Chosen: later, a stop and a start fit into the time.
    #define MAX_MESSAGE_GAP_S 2.0
    // Sigmas of acceleration, jerk, yaw rate and yaw acceleration when a manoeuvre has begun: of full braking and of a turn
    // into a junction. Chosen by hand; not fitted.
    #define MANOEUVRE_ACCEL_MPS2 4.0
    #define MANOEUVRE_JERK_MPS3 5.0
    #define MANOEUVRE_YAW_RATE_RADPS 0.3
    #define MANOEUVRE_YAW_ACCEL_RADPS2 0.5
    // A position counts as denied while speed and turn were measured at most this long ago, s: slow senders send once a second.
    #define MAX_ODOMETRY_AGE_S 1.5
    // A denied position is believed at the latest after this time, s. Chosen by hand; not fitted: dead reckoning of cars
    // strays by some metres in it, which is the size of the jumps that multipath makes.
    #define MAX_DENIAL_S 15.0
    """
    const double MAX_TYRE_ACCEL_MPS2
    const double MAX_TURN_RATE_RADPS
    const double MAX_MESSAGE_SIGMAS
    const double MAX_MESSAGE_GAP_S
    const double MANOEUVRE_ACCEL_MPS2
    const double MANOEUVRE_JERK_MPS3
    const double MANOEUVRE_YAW_RATE_RADPS
    const double MANOEUVRE_YAW_ACCEL_RADPS2
    const double MAX_ODOMETRY_AGE_S
    const double MAX_DENIAL_S

cdef enum:
    N_MESSAGE = 9  # numbers of a `Message`
    N_MEMORY = 15  # numbers of a `Memory`
    N_JUMP = 4     # numbers of a `Jump`


cdef struct Message:
    # What one message of a sender says; variances beside the values, of a position the larger of its two.
    double n_kinds     # rows of position, speed and heading
    double n_used      # how many of them the filter used
    double x
    double y
    double speed
    double heading
    double position_variance
    double speed_variance
    double heading_variance


cdef struct Memory:
    # What is known of a sender's messages: the last believed one, the newest one, and the way between them.
    double is_known    # 1 after a believed message
    double time_s      # of the believed message, and what it said
    double x
    double y
    double speed
    double heading
    double position_variance
    double speed_variance
    double heading_variance
    double newest_s    # of the newest message, and what it said
    double newest_speed
    double newest_heading
    double way_x       # from the believed message to the newest by speeds and headings alone, m
    double way_y
    double slack       # by how much the way may be longer or shorter, m


cdef struct Jump:
    # What is known of a source of positions while the gate rejects it.
    double trusted_since_s  # since when the source has agreed with the others, s
    double silence_s        # how long before the first rejected row it was used last, s
    double x                # innovation of the first rejected row, m
    double y


cdef inline void add_row(Message* message, int sensor, const double* value, const double* noise) noexcept nogil:
    """Take a row of a message into it."""
    if sensor == Sensor.POSITION:
        message.n_kinds += 1
        message.x, message.y = value[0], value[1]
        message.position_variance = noise[0] if noise[0] > noise[2] else noise[2]
    elif sensor == Sensor.SPEED:
        message.n_kinds += 1
        message.speed, message.speed_variance = value[0], noise[0]
    elif sensor == Sensor.HEADING:
        message.n_kinds += 1
        message.heading, message.heading_variance = value[0], noise[0]


cdef inline void advance(Memory* memory, const Message* message, double time_s) noexcept nogil:
    """Continue the way to a new message: the mean of two velocities, and what an acceleration between them can add."""
    cdef double dt = time_s - memory.newest_s
    if memory.is_known == 0.0:
        return
    memory.way_x += 0.5 * dt * (
        memory.newest_speed * cos(memory.newest_heading) + message.speed * cos(message.heading)
    )
    memory.way_y += 0.5 * dt * (
        memory.newest_speed * sin(memory.newest_heading) + message.speed * sin(message.heading)
    )
    memory.slack += 0.25 * MAX_TYRE_ACCEL_MPS2 * dt * dt
    memory.newest_s, memory.newest_speed, memory.newest_heading = time_s, message.speed, message.heading


cdef inline void believe(Memory* memory, const Message* message, double time_s) noexcept nogil:
    memory.is_known = 1.0
    memory.time_s, memory.x, memory.y = time_s, message.x, message.y
    memory.speed, memory.heading = message.speed, message.heading
    memory.position_variance = message.position_variance
    memory.speed_variance, memory.heading_variance = message.speed_variance, message.heading_variance
    memory.newest_s, memory.newest_speed, memory.newest_heading = time_s, message.speed, message.heading
    memory.way_x, memory.way_y, memory.slack = 0.0, 0.0, 0.0


cdef inline bint agrees(const Memory* memory, const Message* message, double time_s) noexcept nogil:
    """Whether a car that was where the believed message said can be where this one says; after `advance`."""
    cdef double gap_s = time_s - memory.time_s, limit, turn_rate, faster
    if memory.is_known == 0.0 or not gap_s <= MAX_MESSAGE_GAP_S:
        return False
    limit = MAX_TYRE_ACCEL_MPS2 * gap_s
    limit += MAX_MESSAGE_SIGMAS * sqrt(memory.speed_variance + message.speed_variance)
    if not fabs(message.speed - memory.speed) <= limit:
        return False
    faster = fabs(message.speed) if fabs(message.speed) > fabs(memory.speed) else fabs(memory.speed)
    turn_rate = MAX_TURN_RATE_RADPS
    if faster * turn_rate > MAX_TYRE_ACCEL_MPS2:
        turn_rate = MAX_TYRE_ACCEL_MPS2 / faster
    limit = turn_rate * gap_s
    limit += MAX_MESSAGE_SIGMAS * sqrt(memory.heading_variance + message.heading_variance)
    if not fabs(remainder(message.heading - memory.heading, 2.0 * M_PI)) <= limit:
        return False
    limit = memory.slack + MAX_MESSAGE_SIGMAS * sqrt(
        memory.position_variance + message.position_variance
        + gap_s * gap_s * 0.5 * (memory.speed_variance + message.speed_variance)
    )
    cdef double off_x = message.x - memory.x - memory.way_x, off_y = message.y - memory.y - memory.way_y
    return off_x * off_x + off_y * off_y <= limit * limit


cdef inline void widen_for_manoeuvre(double* p, int sensor, double nu2, int n) noexcept nogil:
    """Widen what a row measures by the square of its innovation, and the rates that have brought it there."""
    if sensor == Sensor.POSITION:
        add_sym(p, X, X, nu2)
        add_sym(p, Y, Y, nu2)
    elif sensor == Sensor.SPEED:
        add_sym(p, SPEED, SPEED, nu2)
        add_sym(p, ACCEL, ACCEL, MANOEUVRE_ACCEL_MPS2 * MANOEUVRE_ACCEL_MPS2)
        if n >= N_MOTION:
            add_sym(p, JERK, JERK, MANOEUVRE_JERK_MPS3 * MANOEUVRE_JERK_MPS3)
    elif sensor == Sensor.HEADING:
        add_sym(p, HEADING, HEADING, nu2)
        add_sym(p, YAW_RATE, YAW_RATE, MANOEUVRE_YAW_RATE_RADPS * MANOEUVRE_YAW_RATE_RADPS)
        if n >= N_MOTION:
            add_sym(p, YAW_ACCEL, YAW_ACCEL, MANOEUVRE_YAW_ACCEL_RADPS2 * MANOEUVRE_YAW_ACCEL_RADPS2)


cdef inline void gather(int begin, int end, const int* source, const int* sensor, const int* sender,
                        const double* values, const double* noise, double time_s, double* messages,
                        double* memories) noexcept nogil:
    """Put the rows of a step into the messages of their senders, and continue the ways of those that are whole."""
    cdef int u, g
    cdef Message* message
    for u in range(begin, end):
        if sender[source[u]] >= 0:
            message = <Message*>(messages + sender[source[u]] * N_MESSAGE)
            add_row(message, sensor[source[u]], values + 2 * u, noise + 3 * u)
    for u in range(begin, end):
        g = sender[source[u]]
        if g >= 0 and sensor[source[u]] == Sensor.POSITION:
            message = <Message*>(messages + g * N_MESSAGE)
            if message.n_kinds == 3.0:
                advance(<Memory*>(memories + g * N_MEMORY), message, time_s)


cdef inline void settle(int begin, int end, const int* source, const int* sender, double time_s, double* messages,
                        double* memories) noexcept nogil:
    """Remember the whole messages of a step whose rows were all used, and empty all of them."""
    cdef int u
    cdef Message* message
    for u in range(begin, end):
        if sender[source[u]] >= 0:
            message = <Message*>(messages + sender[source[u]] * N_MESSAGE)
            if message.n_kinds == 3.0 and message.n_used == 3.0:
                believe(<Memory*>(memories + sender[source[u]] * N_MEMORY), message, time_s)
            message.n_kinds, message.n_used = 0.0, 0.0


cdef inline bint is_denied_jump(const Jump* jump, const double* nu, double s00, double s11, double odometry_s,
                                double time_s) noexcept nogil:
    """Whether speed and turn, measured until `odometry_s`, deny a position that jumped once.

    Since the first rejected row its innovation is the same within half of it and its noise (variances s00, s11): the
    position moves as the others say. Where it goes on straying, they may be wrong.
    """
    cdef double x = nu[0] - jump.x, y = nu[1] - jump.y
    if not time_s - odometry_s <= MAX_ODOMETRY_AGE_S:
        return False
    return x * x + y * y <= 0.25 * (jump.x * jump.x + jump.y * jump.y) + MAX_MESSAGE_SIGMAS * (s00 + s11)


cdef inline double denial_s(const Jump* jump, double used_s, double least_s) noexcept nogil:
    """For how long a denied position is not believed, s: as long as it agreed before, between `least_s` and the bound."""
    cdef double agreed_s = used_s - jump.trusted_since_s
    if agreed_s < least_s:
        return least_s
    return agreed_s if agreed_s < MAX_DENIAL_S else MAX_DENIAL_S
