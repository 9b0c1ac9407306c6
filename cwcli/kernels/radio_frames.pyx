# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Finds the messages inside what radios hand over: security headers, frames, ports; many at once."""

from cwcli.kernels.bit_reader cimport READ_OK, Reader, skip, take, take_length

cpdef enum:
    FRAME_OK
    FRAME_SHORT
    FRAME_ENCRYPTED
    FRAME_NO_PAYLOAD    # signed data without data, a request for a certificate
    FRAME_UNKNOWN       # no message of the format

cpdef enum:
    FORMAT_J2735 = 0    # IEEE 1609.2 or not, then a MessageFrame
    FORMAT_BTP = 1      # port (2 octets), 2 octets, then the message
    FORMAT_ITS = 2      # the message: version, message id, ...

cpdef enum:
    SECURITY_NONE = 0
    SECURITY_UNSECURED = 1
    SECURITY_SIGNED = 2


def frames(
    const unsigned char[::1] data,
    const long long[::1] starts,
    const long long[::1] ends,
    *,
    int form,
    long long[::1] begins,
    long long[::1] stops,
    int[::1] message,
    unsigned char[::1] security,
    unsigned char[::1] status,
) -> None:
    """Find the message inside what a radio handed over. See the `.pyi`."""
    cdef Py_ssize_t row
    cdef Reader reader
    cdef long long size
    if not len(data):
        for row in range(len(starts)):
            status[row] = FRAME_SHORT
        return
    with nogil:
        for row in range(len(starts)):
            reader.data = &data[0]
            reader.at = 8 * starts[row]
            reader.end = 8 * ends[row]
            reader.status = READ_OK
            security[row] = SECURITY_NONE
            message[row] = -1
            status[row] = FRAME_OK
            if form == FORMAT_J2735:
                status[row] = unwrap(&reader, &security[row])
                if status[row] == FRAME_OK:
                    skip(&reader, 1)  # extensible: what is behind the value is later than the type
                    message[row] = <int>take(&reader, 15)
                    size = take_length(&reader)
                    if reader.status == READ_OK and 8 * size <= reader.end - reader.at:
                        reader.end = reader.at + 8 * size
                    else:
                        status[row] = FRAME_SHORT
            elif form == FORMAT_BTP:
                message[row] = <int>take(&reader, 16)
                skip(&reader, 16)
            else:
                skip(&reader, 8)
                message[row] = <int>take(&reader, 8)
                reader.at = 8 * starts[row]
            if reader.status != READ_OK and status[row] == FRAME_OK:
                status[row] = FRAME_SHORT
            begins[row] = reader.at // 8 if status[row] != FRAME_OK or reader.at % 8 == 0 else reader.at // 8 + 1
            stops[row] = reader.end // 8


cdef int unwrap(Reader* r, unsigned char* security) noexcept nogil:
    """Step over the IEEE 1609.2 headers, canonical OER, if there are any; a status. Nothing is verified."""
    cdef int k
    cdef long long content, size, preamble
    for k in range(4):
        if r.end - r.at < 16:
            return FRAME_SHORT
        if r.data[r.at >> 3] != 3:
            return FRAME_OK
        skip(r, 8)
        content = take(r, 8)
        if content == 0x80:
            if security[0] == SECURITY_NONE:
                security[0] = SECURITY_UNSECURED
            size = take(r, 8)
            if size > 0x7F:
                if size == 0x81:
                    size = take(r, 8)
                elif size == 0x82:
                    size = take(r, 16)
                else:
                    return FRAME_UNKNOWN
            if r.status != READ_OK or 8 * size > r.end - r.at:
                return FRAME_SHORT
            r.end = r.at + 8 * size
        elif content == 0x81:
            security[0] = SECURITY_SIGNED
            skip(r, 8)  # hash algorithm
            preamble = take(r, 8)
            if r.status != READ_OK:
                return FRAME_SHORT
            if not preamble & 0x40:
                return FRAME_NO_PAYLOAD
        elif content == 0x82:
            return FRAME_ENCRYPTED
        elif content == 0x83:
            return FRAME_NO_PAYLOAD
        else:
            return FRAME_UNKNOWN
    return FRAME_UNKNOWN
