# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Extended Kalman filter and smoother of one vehicle, over a whole log at once.

State (first 8 of n): x, y, v, heading, a, yaw rate, jerk, yaw acceleration; behind them any number of slowly varying
parameters (sensor biases, latencies, ...) up to n = 24: random walks, or Gauss-Markov processes that fade. The model
SONG2016 has the first six (eq. 2, 6).

Measurements are applied one scalar at a time; a correlated pair is decorrelated first, which equals the joint update.
The smoother is the two-filter form (Fraser and Potter, 1969) about the forward pass: backward runs the information
(Y, y) that the later measurements give of the state's difference from the filtered one, and at an output

    P_s = (P^-1 + Y)^-1 = L (I + L' Y L)^-1 L',  P = L L',     x_s = x + P_s y.

No covariance is subtracted from another, so that what is left of a variance of 1e8 m^2 by fixes of a centimetre keeps its
digits. It gives the same result as Rauch-Tung-Striebel. The plain NumPy twin is in tests/unit/estimation/naive_ekf.py.
"""

from libc.math cimport M_PI, log, remainder, sqrt
from libc.string cimport memset

import numpy as np

from cwcli.kernels.ekf_information cimport forget, is_lossy, smooth_output, take_in
from cwcli.kernels.ekf_messages cimport (
    N_JUMP, N_MEMORY, N_MESSAGE, Jump, Memory, Message, agrees, denial_s, gather, is_denied_jump, settle,
    widen_for_manoeuvre
)
from cwcli.kernels.ekf_motion cimport (
    NH,
    NMAX,
    N_MOTION,
    DampedMotion,
    Model,
    Step,
    add_noise,
    astray,
    begin_again,
    decay_of_yaw_rate,
    flip_sign,
    is_reversed,
    linearise,
    pointed,
    propagate,
    speed_squared,
    times_f,
    times_ft,
    turn_round,
    yaw_rate_of,
)
from cwcli.kernels.ekf_sensors cimport (
    Parameters, Place, add_stamp_noise, along_excess, count_slots, expect, inflate, tells_heading
)

# The gate widens with the time since a source was last used: the model's errors grow over an outage in ways that
# its covariance does not know of, and the first position after a tunnel must not be taken for an outlier.
cdef double GATE_WIDENS_S = 2.0

# A burst of messages that were held back can be long in rows and short in time: a source must stay elsewhere for this
# long before it is used again. For the inertial sensors the rows alone count.
cdef double PATIENCE_S = 2.0


cdef class ProcessModel:
    cdef Model model

    @staticmethod
    def damped(DampedMotion numbers, const double[::1] walk_noise, const double[::1] turn_noise,
               const double[::1] time_constant_s):
        if walk_noise.shape[0] > NMAX:
            raise ValueError(f"{walk_noise.shape[0]} states, more than {NMAX}")
        cdef ProcessModel motion = ProcessModel()
        cdef int i
        motion.model.kind = MotionModel.DAMPED
        motion.model.n = <int>walk_noise.shape[0]
        motion.model.damped = numbers
        for i in range(N_MOTION, motion.model.n):
            motion.model.walk_noise[i] = walk_noise[i]
            motion.model.turn_noise[i] = turn_noise[i]
            if time_constant_s[i] > 0.0:
                motion.model.fading[motion.model.n_fading] = i
                motion.model.fade_rate[motion.model.n_fading] = 1.0 / time_constant_s[i]
                motion.model.n_fading += 1
        return motion

    @staticmethod
    def song2016(const double[:, ::1] step_noise):
        cdef ProcessModel motion = ProcessModel()
        cdef int i
        motion.model.kind = MotionModel.SONG2016
        motion.model.n = 6
        for i in range(36):
            motion.model.step_noise[i] = step_noise[i // 6, i % 6]
        return motion


cdef class Events:
    cdef const double[::1] time_s
    cdef const int[::1] first, out_row, source
    cdef const double[:, ::1] values, noise

    def __init__(self, *, time_s, first, out_row, source, values, noise):
        self.time_s, self.first, self.out_row = time_s, first, out_row
        self.source, self.values, self.noise = source, values, noise


cdef class Restarts:
    cdef const int[::1] step
    cdef const double[:, ::1] state, variance

    def __init__(self, *, step, state, variance):
        self.step, self.state, self.variance = step, state, variance


cdef class SourceTable:
    cdef const int[::1] sensor, patience, sender
    cdef const int[:, ::1] parameters
    cdef const double[::1] stamp_sigma_s, gate_nis
    cdef const double[:, ::1] place_m

    def __init__(self, *, sensor, parameters, place_m, stamp_sigma_s, gate_nis, patience, sender):
        self.sensor, self.parameters, self.place_m, self.sender = sensor, parameters, place_m, sender
        self.stamp_sigma_s, self.gate_nis, self.patience = stamp_sigma_s, gate_nis, patience


NO_RESTARTS = Restarts(step=np.zeros(0, np.int32), state=np.zeros((0, N_MOTION)), variance=np.zeros((0, N_MOTION)))


cdef class Pass:
    cdef readonly object state, covariance, last_state, last_covariance, nis, status
    cdef readonly double log_likelihood
    # What `backward` needs of each step and of each row of an update.
    # `offset` is the filtered state less the predicted one; `residual` that of a row at the predicted state, and its
    # weight 1 / r; `noise_speed2`, `noise_astray` and `noise_across` are what `add_noise` took.
    cdef double[:, ::1] x_post, offset, partials, residual
    cdef signed char[::1] flip
    cdef double[::1] yaw_decay, noise_speed2, noise_astray, noise_across

    def __init__(self, Events events, ProcessModel motion, int n_output, bint keep):
        cdef int n = motion.model.n, n_updates = <int>events.source.shape[0]
        self.state, self.covariance = np.empty((n_output, n)), np.empty((n_output, n, n))
        self.nis, self.status = np.zeros((n_updates, 5)), np.zeros(n_updates, np.int8)
        if keep:
            self.x_post = np.empty((events.time_s.shape[0], n))
            self.flip = np.zeros(events.time_s.shape[0], np.int8)
            self.yaw_decay = np.empty(events.time_s.shape[0])
            self.noise_speed2 = np.empty(events.time_s.shape[0])
            self.noise_astray = np.empty(events.time_s.shape[0])
            self.noise_across = np.empty(events.time_s.shape[0])
            self.offset = np.empty((events.time_s.shape[0], n))
            self.partials = np.empty((2 * n_updates, NH))
            self.residual = np.empty((2 * n_updates, 2))


def run(Events events, SourceTable sources, ProcessModel motion, start_state, start_covariance, int n_output, *,
        bint smooth, Restarts restarts=None):
    if len(start_state) != motion.model.n:
        raise ValueError(f"a start of {len(start_state)} states for a motion model of {motion.model.n}")
    cdef Pass result = Pass(events, motion, n_output, smooth)
    result.last_state, result.last_covariance = start_state.copy(), np.array(start_covariance, order="C")
    forward(events, sources, &motion.model, result, smooth, restarts or NO_RESTARTS)
    if smooth and n_output:
        backward(events, sources, &motion.model, result)
    return result


cdef int forward(
    Events events, SourceTable sources, const Model* model, Pass result, bint keep, Restarts restarts
) except -1:
    """Run the filter over all steps; `last_state` and `last_covariance` are those of the start first."""
    cdef const double[::1] time_s = events.time_s, gate_nis = sources.gate_nis, stamp_sigma_s = sources.stamp_sigma_s
    cdef const int[::1] first = events.first, out_row = events.out_row, source = events.source
    cdef const double[:, ::1] values = events.values, noise = events.noise
    cdef const int[::1] sensor = sources.sensor, patience = sources.patience, sender = sources.sender
    cdef const int[:, ::1] parameters = sources.parameters
    cdef const double[:, ::1] place_m = sources.place_m
    cdef const Parameters* own
    cdef const Place* at
    cdef Message* message
    cdef Jump* jump
    cdef double[::1] state = result.last_state, yaw_decay = result.yaw_decay
    cdef double[:, ::1] covariance = result.last_covariance, nis = result.nis, out_x = result.state
    cdef double[:, :, ::1] out_p = result.covariance
    cdef signed char[::1] status = result.status, flip = result.flip
    cdef const int[::1] restart_step = restarts.step
    cdef const double[:, ::1] restart_state = restarts.state, restart_variance = restarts.variance
    cdef int next_restart = 0, n_restarts = <int>restarts.step.shape[0]
    cdef double[::1] noise_speed2 = result.noise_speed2, noise_astray = result.noise_astray
    cdef double[::1] noise_across = result.noise_across
    cdef double[:, ::1] x_post = result.x_post, offset = result.offset
    cdef double[:, ::1] partials = result.partials, residual = result.residual
    cdef int[::1] streak = np.zeros(len(sensor), np.int32)  # updates gated in a row so far
    cdef double[::1] last_used_s = np.full(len(sensor), time_s[0])
    cdef int n_senders = 1 + max(sender, default=-1)
    cdef double[:, ::1] messages = np.zeros((n_senders, N_MESSAGE)), memories = np.zeros((n_senders, N_MEMORY))
    cdef double[:, ::1] jumps = np.tile([time_s[0], 0.0, 0.0, 0.0], (len(sensor), 1))
    cdef int n = model.n, n_steps = <int>time_s.shape[0]
    cdef double x[NMAX], p[NMAX * NMAX], x_prior[NMAX], cached[14]
    cdef double h[2], nu[2], e[2], r[3], hx[2 * NH], ph[2 * NMAX], g[NMAX]
    cdef int idx[NH]
    cdef Step f
    cdef int i, j, k, u, s, width, axis, row, m
    cdef double dt, s00, s01, s11, det, d2, corr, var, inv, acc, quiet, decay, root, speed2, lost, across, jittered
    cdef double total = 0.0, volume = 1.0, told_s = time_s[0]    # when a heading was told last
    cdef double speed_s = -1e30, turn_s = -1e30, silence_s, wait_s    # when speed and turn were measured last
    cdef bint fresh
    with nogil:
        cached[0] = -1.0
        s11 = 0.0
        memset(p, 0, sizeof(p))
        memset(x, 0, sizeof(x))    # song2016's six states have no jerk, but `expect` multiplies it by a latency of 0
        for i in range(n):
            x[i] = state[i]
            for j in range(n):
                p[i * NMAX + j] = covariance[i, j]
        for k in range(n_steps):
            if k > 0:
                dt = time_s[k] - time_s[k - 1]
                if dt > 0.0:
                    decay = decay_of_yaw_rate(speed_squared(x, p), model)
                    if keep:
                        yaw_decay[k] = decay
                    linearise(x, dt, decay, model, &f, cached)
                    times_f(p, &f, n, NMAX, 1)
                    times_f(p, &f, n, 1, NMAX)
                    speed2 = speed_squared(x, p)
                    lost = astray(speed2, p, time_s[k] - told_s, model)
                    across = pointed(p)
                    if keep:
                        noise_across[k] = across
                        noise_speed2[k] = speed2
                        noise_astray[k] = lost
                    add_noise(p, speed2, lost, across, yaw_rate_of(x), &f, model)
                    propagate(x, &f)
                    for i in range(n):                        # round-off makes the two products differ in the last bit
                        for j in range(i):
                            p[j * NMAX + i] = p[i * NMAX + j]
            for i in range(n):
                x_prior[i] = x[i]
            if next_restart < n_restarts and restart_step[next_restart] == k:
                begin_again(x, p, &restart_state[next_restart, 0], &restart_variance[next_restart, 0], n)
                next_restart += 1
                told_s = time_s[k]
            if n_senders and first[k] < first[k + 1]:
                gather(first[k], first[k + 1], &source[0], &sensor[0], &sender[0], &values[0, 0], &noise[0, 0],
                       time_s[k], &messages[0, 0], &memories[0, 0])
            for u in range(first[k], first[k + 1]):
                s = source[u]
                own = <const Parameters*>&parameters[s, 0]
                at = <const Place*>&place_m[s, 0]
                width = expect(x, sensor[s], own, at, values[u, 1], h, hx, idx)
                m = count_slots(sensor[s], own, at)
                for axis in range(width):
                    nu[axis] = values[u, axis] - h[axis]
                if sensor[s] == Sensor.HEADING:
                    nu[0] = remainder(nu[0], 2.0 * M_PI)
                r[0], r[1], r[2] = noise[u, 0], noise[u, 1], noise[u, 2]
                jittered = 0.0
                if stamp_sigma_s[s] > 0.0 and sensor[s] == Sensor.POSITION:
                    jittered = add_stamp_noise(x, p, stamp_sigma_s[s], r)
                for axis in range(width):
                    for i in range(n):
                        acc = 0.0
                        for j in range(m):
                            acc += p[i * NMAX + idx[j]] * hx[axis * NH + j]
                        ph[axis * NMAX + i] = acc
                fresh = True
                s00 = 0.0
                for j in range(m):
                    s00 += hx[j] * ph[idx[j]]
                if width == 1:
                    nis[u, 1] = nu[0] * nu[0]
                    nis[u, 2] = s00
                    nis[u, 3] = s00 + r[0]
                    d2 = nu[0] * nu[0] / (s00 + r[0])
                else:
                    s01 = 0.0
                    s11 = 0.0
                    for j in range(m):
                        s01 += hx[j] * ph[NMAX + idx[j]]
                        s11 += hx[NH + j] * ph[NMAX + idx[j]]
                    nis[u, 1] = 0.5 * (nu[0] * nu[0] + nu[1] * nu[1])
                    nis[u, 2] = 0.5 * (s00 + s11) + jittered
                    s00 += r[0]
                    s01 += r[1]
                    s11 += r[2]
                    det = s00 * s11 - s01 * s01
                    d2 = (s11 * nu[0] * nu[0] - 2.0 * s01 * nu[0] * nu[1] + s00 * nu[1] * nu[1]) / det
                    nis[u, 3] = det
                    if sensor[s] == Sensor.POSITION:
                        nis[u, 4] = along_excess(x, nu, s00, s01, s11, det)
                nis[u, 0] = d2
                message = <Message*>&messages[sender[s], 0] if sender[s] >= 0 else NULL
                silence_s, wait_s = time_s[k] - last_used_s[s], PATIENCE_S
                if streak[s] > 0 and sensor[s] == Sensor.POSITION:
                    jump = <Jump*>&jumps[s, 0]
                    if is_denied_jump(jump, nu, s00, s11, speed_s if speed_s < turn_s else turn_s, time_s[k]):
                        silence_s, wait_s = jump.silence_s, denial_s(jump, last_used_s[s], PATIENCE_S)
                quiet = 1.0 + silence_s / GATE_WIDENS_S
                if gate_nis[s] > 0.0 and not d2 <= gate_nis[s] * quiet * quiet:
                    if message != NULL and message.n_kinds == 3.0 and agrees(
                        <Memory*>&memories[sender[s], 0], message, time_s[k]
                    ):
                        widen_for_manoeuvre(p, sensor[s], width * nis[u, 1], n)
                        status[u] = UpdateStatus.USED_IN_MANOEUVRE
                    else:
                        if streak[s] == 0 and width == 2:
                            jumps[s, 1], jumps[s, 2], jumps[s, 3] = silence_s, nu[0], nu[1]
                        streak[s] += 1
                        if streak[s] <= patience[s] or (
                            time_s[k] - last_used_s[s] < wait_s
                            and sensor[s] != Sensor.ACCEL and sensor[s] != Sensor.YAW_RATE
                        ):
                            status[u] = UpdateStatus.GATED
                            continue
                        inflate(p, sensor[s], width * nis[u, 1], model)
                        status[u] = UpdateStatus.USED_AFTER_RESET
                        jumps[s, 0] = time_s[k]
                    fresh = False
                else:
                    status[u] = UpdateStatus.USED
                if message != NULL:
                    message.n_used += 1.0
                if sensor[s] == Sensor.SPEED or sensor[s] == Sensor.VELOCITY:
                    speed_s = time_s[k]
                if sensor[s] == Sensor.HEADING or sensor[s] == Sensor.VELOCITY or sensor[s] == Sensor.YAW_RATE:
                    turn_s = time_s[k]
                streak[s] = 0
                last_used_s[s] = time_s[k]
                if tells_heading(sensor[s]):
                    told_s = time_s[k]
                # Decorrelate the second axis from the first: z1 - corr z0 has noise r11 - corr r01.
                corr = 0.0
                if width == 2 and r[1] != 0.0:
                    corr = r[1] / r[0]
                    nu[1] -= corr * nu[0]
                    r[2] -= corr * r[1]
                    for j in range(m):
                        hx[NH + j] -= corr * hx[j]
                if keep:
                    for axis in range(width):
                        e[axis] = nu[axis]
                        for j in range(m):
                            e[axis] += hx[axis * NH + j] * (x[idx[j]] - x_prior[idx[j]])
                for axis in range(width):
                    row = 2 * u + axis
                    if fresh:                                 # the gate has computed it
                        for i in range(n):
                            g[i] = ph[i]
                        fresh = False
                    else:
                        for i in range(n):
                            acc = 0.0
                            for j in range(m):
                                acc += p[i * NMAX + idx[j]] * hx[axis * NH + j]
                            g[i] = acc
                    var = r[0] if axis == 0 else r[2]
                    for j in range(m):
                        var += hx[axis * NH + j] * g[idx[j]]
                    inv = 1.0 / var
                    acc = nu[axis]
                    total -= 0.5 * acc * acc * inv
                    volume *= 2.0 * M_PI * var                # one logarithm for many updates
                    if volume > 1e200 or volume < 1e-200:
                        total -= 0.5 * log(volume)
                        volume = 1.0
                    if keep:
                        for j in range(m):
                            partials[row, j] = hx[axis * NH + j]
                        residual[row, 0] = e[axis]
                        residual[row, 1] = 1.0 / (r[0] if axis == 0 else r[2])
                    if axis == 0 and width == 2:          # the second innovation about the state after the first update
                        for j in range(m):
                            nu[1] -= hx[NH + j] * g[idx[j]] * inv * acc
                    for i in range(n):
                        x[i] += g[i] * inv * acc
                    if is_lossy(var, r[0] if axis == 0 else r[2]):
                        for i in range(n):
                            g[i] *= inv
                        take_in(p, g, r[0] if axis == 0 else r[2], hx + axis * NH, idx, m, n)
                    else:
                        root = sqrt(inv)
                        for i in range(n):
                            g[i] *= root
                        for i in range(n):                    # symmetric to the last bit
                            for j in range(n):
                                p[i * NMAX + j] -= g[i] * g[j]
            if n_senders and first[k] < first[k + 1]:
                settle(first[k], first[k + 1], &source[0], &sender[0], time_s[k], &messages[0, 0], &memories[0, 0])
            if keep:
                flip[k] = 0
                for i in range(n):
                    offset[k, i] = x[i] - x_prior[i]
            if is_reversed(x, p, model):
                turn_round(x, p, n)
                if keep:
                    flip[k] = 1
            if keep:
                for i in range(n):
                    x_post[k, i] = x[i]
            row = out_row[k]
            if row >= 0:
                for i in range(n):
                    out_x[row, i] = x[i]
                    for j in range(n):
                        out_p[row, i, j] = p[i * NMAX + j]
        for i in range(n):
            state[i] = x[i]
            for j in range(n):
                covariance[i, j] = p[i * NMAX + j]
    result.log_likelihood = total - 0.5 * log(volume)
    return 0


include "ekf_smoother.pxi"
