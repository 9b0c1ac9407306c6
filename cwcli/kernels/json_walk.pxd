"""The codes that the JSON kernel shares with Python."""

# Kinds of values.
cpdef enum:
    T_ABSENT = 0
    T_NULL = 1
    T_BOOL = 2
    T_INT = 3
    T_FLOAT = 4
    T_STRING = 5        # value: offset in the message << 32 | size
    T_ARRAY = 6         # with at least one value in it that is neither an object nor an array
    T_ESCAPED = 7       # as T_STRING, with escapes in it

cpdef enum:
    STATUS_OK
    STATUS_ODD
    STATUS_UNKNOWN_KEY
    STATUS_NOT_ASCII
