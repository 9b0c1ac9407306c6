# The second half of ekf.pyx, which it includes: the pass backward.

cdef int backward(Events events, SourceTable sources, const Model* model, Pass result) except -1:
    """Smooth what `forward` kept: state and covariance at the output rows become the smoothed ones."""
    cdef const double[::1] time_s = events.time_s, yaw_decay = result.yaw_decay, noise_speed2 = result.noise_speed2
    cdef const double[::1] noise_astray = result.noise_astray, noise_across = result.noise_across
    cdef const int[::1] first = events.first, out_row = events.out_row, source = events.source
    cdef const int[::1] sensor = sources.sensor
    cdef const int[:, ::1] parameters = sources.parameters
    cdef const double[:, ::1] place_m = sources.place_m
    cdef const Parameters* own
    cdef const Place* at
    cdef const signed char[::1] status = result.status, flip = result.flip
    cdef const double[:, ::1] x_post = result.x_post, offset = result.offset, nis = result.nis
    cdef const double[:, ::1] partials = result.partials, residual = result.residual
    cdef double[:, ::1] out_x = result.state
    cdef double[:, :, ::1] out_p = result.covariance
    cdef int n = model.n, n_steps = <int>time_s.shape[0]
    cdef double y[NMAX], big[NMAX * NMAX], q[NMAX * NMAX], cached[14]
    cdef double h[2], hx[2 * NH]
    cdef int idx[NH]
    cdef Step f
    cdef int i, j, l, k, u, s, width, axis, row, m
    cdef double acc, weight, dt
    cdef const double* hv
    with nogil:
        cached[0] = -1.0
        memset(y, 0, sizeof(y))
        memset(big, 0, sizeof(big))
        memset(q, 0, sizeof(q))
        for k in range(n_steps - 1, -1, -1):
            row = out_row[k]
            if row >= 0:
                smooth_output(&out_x[row, 0], &out_p[row, 0, 0], y, big, n)
            if flip[k]:
                flip_sign(y, big, n)
            # From here on y is of the difference from the predicted state.
            for i in range(n):
                acc = 0.0
                for j in range(n):
                    acc += big[i * NMAX + j] * offset[k, j]
                y[i] += acc
            for u in range(first[k + 1] - 1, first[k] - 1, -1):
                if status[u] == UpdateStatus.GATED:
                    continue
                s = source[u]
                # Only the indices are wanted here; the values were stored.
                own = <const Parameters*>&parameters[s, 0]
                at = <const Place*>&place_m[s, 0]
                width = expect(&x_post[k, 0], sensor[s], own, at, 0.0, h, hx, idx)
                m = count_slots(sensor[s], own, at)
                for axis in range(width):
                    hv = &partials[2 * u + axis, 0]
                    weight = residual[2 * u + axis, 1]
                    for j in range(m):
                        acc = weight * hv[j]
                        y[idx[j]] += acc * residual[2 * u + axis, 0]
                        for l in range(m):
                            big[idx[j] * NMAX + idx[l]] += acc * hv[l]
                if status[u] == UpdateStatus.USED_AFTER_RESET:
                    inflate(q, sensor[s], width * nis[u, 1], model)
                    forget(y, big, q, n)
                elif status[u] == UpdateStatus.USED_IN_MANOEUVRE:
                    widen_for_manoeuvre(q, sensor[s], width * nis[u, 1], n)
                    forget(y, big, q, n)
            if k > 0:
                dt = time_s[k] - time_s[k - 1]
                if dt > 0.0:
                    linearise(&x_post[k - 1, 0], dt, yaw_decay[k], model, &f, cached)
                    add_noise(q, noise_speed2[k], noise_astray[k], noise_across[k], yaw_rate_of(&x_post[k - 1, 0]), &f,
                              model)
                    forget(y, big, q, n)
                    times_ft(y, &f, n, 1, 0, 1)
                    times_ft(big, &f, n, NMAX, 1, n)
                    times_ft(big, &f, n, 1, NMAX, n)
                    for i in range(n):
                        for j in range(i):
                            acc = 0.5 * (big[j * NMAX + i] + big[i * NMAX + j])
                            big[j * NMAX + i] = acc
                            big[i * NMAX + j] = acc
    return 0
