# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Observers of lateral speed and yaw rate over a whole log at once.

`blend` is zhang2011's pair of observers with gains computed beforehand (eq. 15, 18, 22). `observe` is one Kalman filter
with the time between events as it is; its parts are in `observer_model.pxd`. The plain NumPy twins are in
tests/unit/dynamics/naive_observer.py.
"""

from libc.math cimport NAN, ceil, fabs, fmax, fmin, isnan
from libc.string cimport memset

import numpy as np

from cwcli.kernels.observer_model cimport Model, move_along, place, predict, start, update


def blend(
    const double[:, :, ::1] phi,
    const double[:, :, ::1] gamma,
    const double[:, :, ::1] gain,
    *,
    const int[::1] low,
    const double[::1] weight,
    const signed char[::1] begin,
    const int[::1] periods,
    const double[:, ::1] inputs,
    const double[:, ::1] measured,
):
    cdef Py_ssize_t n = low.shape[0], i
    cdef int p, c, r, which, s
    cdef bint running = False
    out_array = np.empty((n, 4))
    cdef double[:, ::1] out = out_array
    cdef double x[4], z[2][4]
    cdef double dy, de, w
    with nogil:
        for i in range(n):
            if begin[i] == Begin.STOP:
                running = False
            if begin[i] == Begin.ANEW:
                running = True
                x[0] = 0.0
                x[1] = 0.0
                x[2] = measured[i, 0]
                x[3] = measured[i, 1]
            elif running:
                w = weight[i]
                for p in range(periods[i]):
                    for which in range(2):
                        s = low[i] + which
                        for r in range(4):
                            z[which][r] = gamma[s, r, 0] * inputs[i, 0] + gamma[s, r, 1] * inputs[i, 1]
                            for c in range(4):
                                z[which][r] += phi[s, r, c] * x[c]
                        if p == periods[i] - 1:
                            dy = measured[i, 0] - z[which][2]
                            de = measured[i, 1] - z[which][3]
                            if not isnan(dy) and not isnan(de):
                                for r in range(4):
                                    z[which][r] += gain[s, r, 0] * dy + gain[s, r, 1] * de
                    for r in range(4):
                        x[r] = (1.0 - w) * z[0][r] + w * z[1][r]
            for r in range(4):
                out[i, r] = x[r] if running else NAN
    return out_array


cdef class Events:
    cdef const double[::1] dt_s, speed_mps
    cdef const signed char[::1] kind, begin
    cdef const double[:, ::1] values, sigmas
    cdef const double[::1] preview_m, change_1pm2

    def __init__(self, *, dt_s, speed_mps, kind, begin, values, sigmas, preview_m, change_1pm2):
        self.dt_s, self.speed_mps, self.kind = dt_s, speed_mps, kind
        self.begin, self.values, self.sigmas = begin, values, sigmas
        self.preview_m, self.change_1pm2 = preview_m, change_1pm2


def observe(Events events, Model model):
    cdef const double[::1] dt_s = events.dt_s, speed = events.speed_mps
    cdef const signed char[::1] kind = events.kind, begin = events.begin
    cdef const double[:, ::1] values = events.values, sigmas = events.sigmas
    cdef const double[::1] preview_m = events.preview_m, change_1pm2 = events.change_1pm2
    cdef const Model* m = &model
    cdef Py_ssize_t n = dt_s.shape[0], i
    x_out_array = np.empty((n, N))
    cdef double[:, ::1] x_out = x_out_array
    p_out_array = np.empty((n, N, N))
    cdef double[:, :, ::1] p_out = p_out_array
    status_array = np.zeros(n, np.int8)
    cdef signed char[::1] status = status_array
    preview_array = np.empty(n)
    cdef double[::1] preview_out = preview_array
    cdef double x[N], p[N * N], h[N]
    cdef bint running = False, ever = False
    cdef int j, k, steps, streak = 0, n_used, tried
    cdef double r, gate = m.gate_sigmas, step, gyro_age_s = 1e30, at_m = 0.0, change = 0.0
    memset(x, 0, N * sizeof(double))
    memset(p, 0, N * N * sizeof(double))
    with nogil:
        for i in range(n):
            if begin[i] != Begin.GO_ON:
                running = False
                gyro_age_s = 1e30
            gyro_age_s += dt_s[i]
            if running and dt_s[i] > 0.0:
                steps = <int>ceil(dt_s[i] / m.max_step_s - 1e-9)
                steps = 1 if steps < 1 else steps
                step = dt_s[i] / steps
                for k in range(steps):
                    predict(x, p, step, speed[i], at_m, change, m)
            status[i] = EventStatus.PREDICTED if running else EventStatus.NOT_STARTED
            if kind[i] == EventKind.LANE and begin[i] != Begin.STOP:
                change = 0.0 if isnan(values[i, 1]) else change_1pm2[i]
                if not running:
                    if not isnan(values[i, 0]) and not isnan(values[i, 1]):
                        at_m = preview_m[i]
                        start(x, p, &values[i, 0], &sigmas[i, 0], speed[i], at_m, m, ever)
                        running = True
                        ever = True
                        streak = 0
                        status[i] = EventStatus.STARTED
                else:
                    tried = 0
                    n_used = 0
                    if preview_m[i] != at_m and not isnan(values[i, 1]):
                        move_along(x, p, preview_m[i] - at_m, speed[i], change, m)
                        at_m = preview_m[i]
                    for k in range(1, 3):
                        if isnan(values[i, k]):
                            continue
                        memset(h, 0, N * sizeof(double))
                        if k == 1:
                            h[EL] = 1.0
                            h[CAM] = 1.0
                        else:
                            h[KL] = 1.0
                        tried += 1
                        n_used += update(x, p, h, values[i, k], sigmas[i, k] * sigmas[i, k], gate)
                    if not isnan(values[i, 0]):
                        memset(h, 0, N * sizeof(double))
                        h[YL] = 1.0
                        h[CAM] = at_m
                        tried += 1
                        if update(x, p, h, values[i, 0], sigmas[i, 0] * sigmas[i, 0], gate):
                            n_used += 1
                        else:
                            # Another lane, or a wrong boundary: its place says nothing of the motion; begin it anew.
                            place(x, p, YL, at_m, values[i, 0], sigmas[i, 0])
                    if tried > 0:
                        status[i] = EventStatus.USED if n_used == tried else EventStatus.GATED
                        streak = 0 if n_used == tried else streak + 1
                        if streak >= m.restart_after and not isnan(values[i, 0]) and not isnan(values[i, 1]):
                            if gyro_age_s <= m.gyro_recent_s:
                                # The yaw rate is measured: it is the road that is another one than was thought.
                                place(x, p, EL, 1.0, values[i, 1], sigmas[i, 1])
                                place(x, p, YL, at_m, values[i, 0], sigmas[i, 0])
                                if not isnan(values[i, 2]):
                                    place(x, p, KL, 0.0, values[i, 2], sigmas[i, 2])
                            else:
                                start(x, p, &values[i, 0], &sigmas[i, 0], speed[i], at_m, m, True)
                            streak = 0
                            status[i] = EventStatus.STARTED
            elif running and not isnan(values[i, 0]) and begin[i] != Begin.STOP:
                memset(h, 0, N * sizeof(double))
                r = sigmas[i, 0] * sigmas[i, 0]
                if kind[i] == EventKind.YAW_RATE:
                    h[G] = 1.0
                    h[GYRO] = 1.0
                else:
                    h[STEER] = 1.0
                status[i] = EventStatus.USED if update(x, p, h, values[i, 0], r, gate) else EventStatus.GATED
                if kind[i] == EventKind.YAW_RATE and status[i] == EventStatus.USED:
                    gyro_age_s = 0.0
            if running:
                x[ETA] = fmin(fmax(x[ETA], m.eta_low), m.eta_high)
                if fabs(speed[i]) < m.still_mps:
                    # A car that stands neither slides nor turns.
                    for k in range(2):
                        memset(h, 0, N * sizeof(double))
                        h[k] = 1.0
                        update(x, p, h, 0.0, 1e-6, 0.0)
            preview_out[i] = at_m if running else NAN
            for j in range(N):
                x_out[i, j] = x[j] if running else NAN
                for k in range(N):
                    p_out[i, j, k] = p[j * N + k] if running else NAN
    return x_out_array, p_out_array, status_array, preview_array
