"""CAN frames (`can_msgs/Frame`) as signals, decoded by the DBC files that describe the bus.

cantools reads the files (an extra, `cwcli-drive[can]`); the bits are taken out of all frames at once.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from cwcli.errors import UsageError, install_hint
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.columns import BoolArray, Columns, FloatArray, Int64Array, Ragged
from cwcli.signals.leaf_fields import read_numbers
from cwcli.signals.mapping import MAPPED_QUANTITIES_BY_ROLE, SI_FACTORS_BY_UNIT_BY_KIND, FieldMapping, Term

DbcMessage = Any
"""A message of a DBC file, as cantools describes it."""
DbcSignal = Any
"""A signal of a DBC file, as cantools describes it."""

MAX_FRAME_BYTES = 64
"""The largest number of data bytes in a frame (CAN FD)."""
Octets = npt.NDArray[np.uint8]
OTHER_MESSAGE_REASON = "frame of another message"
"""The reason for setting aside a frame of another message."""
FRAME_TOO_SHORT_REASON = "frame shorter than in the DBC file"
"""The reason for rejecting a frame that is shorter than its message."""
NOT_AVAILABLE_REASON = "signal not available"
"""The reason for rejecting a frame whose signal says that it has no value."""
OUT_OF_RANGE_REASON = "value out of the DBC's range"
"""The reason for rejecting a value outside the range of the DBC file."""
NO_VALUE_NAME_PATTERN = re.compile(
    r"\b(sna|n/?a|not available|invalid|error|init|initiali[sz]ing|unknown|reserved)\b", re.I
)
"""The pattern of value names in DBC files that mean that there is no value."""
UNIT_NAMES_BY_DBC_SPELLING = {
    **{"km/h": "kmh", "kph": "kmh", "kmph": "kmh", "m/s": "mps", "mi/h": "mph", "knot": "knots", "kn": "knots"},
    **{"°": "deg", "degree": "deg", "degrees": "deg", "rad/s": "radps", "deg/s": "degps", "°/s": "degps"},
    **{"degree/s": "degps", "deg/sec": "degps", "m/s2": "mps2", "m/s^2": "mps2", "m/s²": "mps2", "m/s/s": "mps2"},
}
"""The unit names of mappings, by their spelling in DBC files."""

BYTES_OF_DBC_WORDS = b"abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.-+"
"""The bytes of words and numbers in DBC files."""
MAX_DBC_TEXT_BYTES, MAX_DBC_MESSAGE_BYTES, MAX_DBC_BIT = 100_000, 2_048, 16_384
"""The greatest length of a text and of a message in bytes, and the greatest place and length of a signal in bits: the
parser takes 200 bytes a character, and as long as there are bits. Chosen by hand: a message of SAE J1939 has 1,785."""
MAX_DBC_TOKENS = 1_000_000
"""The largest number of words, numbers and marks in a DBC file: cantools holds each as an object of about 100 bytes.
Chosen by hand: a signal has about 25, so that 25,000 signals with their names of values are read, in some 4 s."""
MAX_MULTIPLEXER_VALUES = 100_000
"""The largest number of values in the ranges of the multiplexers of a DBC file: cantools lists each. Chosen by hand."""
MAX_SIGNAL_BITS = 64
"""The largest number of bits of a signal that is read: that of the integers in which it is decoded (uint64)."""
FLOAT_TYPES_BY_BITS = {16: (np.uint16, np.float16), 32: (np.uint32, np.float32), 64: (np.uint64, np.float64)}
"""The unsigned and the floating-point type of a real number, by its number of bits."""


@dataclass(frozen=True)
class DecodedFrames:
    """The decoded frames of one CAN message.

    Attributes:
        columns: Those whose signals can be used, with a field for each.
        set_aside: Reason -> sound frames that are none of them.
        rejected: Reason -> frames of the message that can't be used.
        notes: Notes for the user.
    """

    columns: Columns
    set_aside: dict[str, int]
    rejected: dict[str, int]
    notes: tuple[str, ...]


def decode_can_signals_and_add_units(columns: Columns, mapping: FieldMapping) -> tuple[DecodedFrames, FieldMapping]:
    """Decode the CAN signals that a mapping names, and add the DBC files' units to the mapping.

    Raises:
        UsageError: No file, one that can't be read, a message or signal that none has, or a unit that measures
            something else; or cantools is not installed.
    """
    names = {term.path.partition(".")[0] for term in mapping.terms}
    if len(names) > 1:
        raise _error_about_mapping(
            columns, mapping, f"{' and '.join(sorted(names))} are different CAN messages: one --map for each"
        )
    message = _find_dbc_message(columns, mapping, names.pop())
    signals = [_find_dbc_signal(columns, mapping, message, term) for term in mapping.terms]
    all_signals = [
        *signals,
        *(_find_multiplexer_signal(message, signal) for signal in signals if signal.multiplexer_ids),
    ]
    for signal in all_signals:
        if signal.length > MAX_SIGNAL_BITS or (signal.is_float and signal.length not in FLOAT_TYPES_BY_BITS):
            raise _error_about_mapping(
                columns, mapping, f"the signal {signal.name} has {signal.length} bits, which is not read"
            )
    identifier, is_extended = read_numbers(columns, "id"), read_numbers(columns, "is_extended")
    is_it = (identifier == message.frame_id) & ((is_extended == 1) == message.is_extended_frame)
    is_it &= ~(read_numbers(columns, "is_rtr") == 1) & ~(read_numbers(columns, "is_error") == 1)
    octets, n_octets = _frame_bytes_and_lengths(columns)
    needed = _count_bytes_needed(all_signals)
    octets = np.pad(octets, ((0, 0), (0, max(needed - octets.shape[1], 0))))
    is_whole = n_octets >= needed
    rejected = {FRAME_TOO_SHORT_REASON: int(np.count_nonzero(is_it & ~is_whole))}
    rows = np.flatnonzero(is_it & is_whole)
    values, is_present, faults = _decode_physical_values(octets[rows], message, signals)
    for reason, is_bad in faults.items():
        rejected[reason] = int(np.count_nonzero(is_bad & is_present))
        is_present &= ~is_bad
    present_rows = rows[is_present]
    others = len(columns) - len(present_rows) - sum(rejected.values())
    fields: dict[str, Any] = {
        name: field[present_rows]
        for name, field in columns.fields.items()
        if "stamp" in name and isinstance(field, np.ndarray)
    }
    fields |= {term.path: value[is_present] for term, value in zip(mapping.terms, values, strict=True)}
    decoded = replace(
        columns,
        log_time_ns=columns.log_time_ns[present_rows],
        publish_time_ns=columns.publish_time_ns[present_rows],
        sequence=columns.sequence[present_rows],
        fields=fields,
    )
    terms, notes = _terms_with_dbc_units(columns, mapping, signals)
    aside = {OTHER_MESSAGE_REASON: others} if others else {}
    counts = {reason: n for reason, n in rejected.items() if n}
    return DecodedFrames(decoded, aside, counts, notes), replace(mapping, terms=terms)


def _find_dbc_message(columns: Columns, mapping: FieldMapping, name: str) -> DbcMessage:
    if not mapping.files:
        raise _error_about_mapping(columns, mapping, "CAN frames need the file that describes them", "--dbc FILE")
    known: list[str] = []
    for file in mapping.files:
        for message in _load_dbc_file(file).messages:
            if message.name == name:
                return message
            known.append(message.name)
    where = ", ".join(mapping.files)
    raise _error_about_mapping(columns, mapping, f"{where} has no message {name}", f"messages: {', '.join(known[:20])}")


def list_dbc_signal_names(files: Sequence[str]) -> list[str]:
    """The signals of DBC files as `MESSAGE.SIGNAL`, in the order of the files.

    Raises:
        UsageError: A file can't be read, or cantools is not installed.
    """
    return [
        f"{message.name}.{signal.name}"
        for file in files
        for message in _load_dbc_file(file).messages
        for signal in message.signals
    ]


def _load_dbc_file(file: str) -> Any:
    from cwcli.input import read_file

    try:
        from cantools import database
        from cantools.database.errors import Error
    except ImportError as error:
        raise UsageError("CAN frames need cantools", hint=install_hint("can")) from error
    logging.getLogger("cantools").setLevel(logging.ERROR)  # it prints a line for each message that is there twice
    try:
        data = read_file(file)
        try:
            text = data.decode("utf-8")
        except UnicodeDecodeError:
            text = data.decode("cp1252", "replace")  # what the format's own editors write: a degree sign is one byte
        _require_bounded_dbc(data, text)
        loaded: Any = database.load_string(text, database_format="dbc", strict=False)
        for message in loaded.messages:
            for signal in message.signals:
                for value in (signal.scale, signal.offset, signal.minimum or 0, signal.maximum or 0):
                    float(value)  # a whole number may be too large for one
        return loaded
    except OSError as error:
        raise UsageError(f"can't read the DBC file: {error.strerror}", where=file) from error
    except (Error, ValueError, KeyError, RecursionError, OverflowError) as error:
        first = (str(error).splitlines() or [type(error).__name__])[0]
        raise UsageError(f"the DBC file can't be read: {first}", where=file) from error


def _require_bounded_dbc(data: bytes, text: str) -> None:
    """Check that a DBC file is not larger for its parser than any that describes a bus.

    Raises:
        ValueError: It has too many words and marks, a text that is too long, signals beyond any message, or
            multiplexers with too many values.
    """
    octets = np.frombuffer(data, np.uint8)
    quotes = np.flatnonzero(octets == ord('"'))
    n_text = int(np.diff(quotes, append=len(octets))[::2].max(initial=0))
    if n_text > MAX_DBC_TEXT_BYTES:
        raise ValueError(f"it has a text of {n_text:,} bytes; at most {MAX_DBC_TEXT_BYTES:,} are read")
    for pattern, limit in (
        (r"(?<!\d)(\d++)\s*+\|\s*+(\d++)\s*+@", MAX_DBC_BIT),
        (r"\bBO_\s++\d++\s++\w++\s*+:\s*+(\d++)", MAX_DBC_MESSAGE_BYTES),
    ):
        for found in re.finditer(pattern, text):
            if any(len(each) > len(str(limit)) or int(each) > limit for each in found.groups()):
                raise ValueError(f"{found.group()[:80]!r} is beyond every message")
    is_in_text = np.logical_xor.accumulate(octets == ord('"')) if len(octets) else np.zeros(0, np.bool_)
    is_blank = (octets <= ord(" ")) | is_in_text
    is_word = np.isin(octets, np.frombuffer(BYTES_OF_DBC_WORDS, np.uint8)) | (octets >= 128)
    begins = is_word & ~np.concatenate([[False], (is_word & ~is_blank)[:-1]])
    n_tokens = int(np.count_nonzero((begins | ~is_word) & ~is_blank))
    if n_tokens > MAX_DBC_TOKENS:
        raise ValueError(f"it has {n_tokens:,} words and marks; at most {MAX_DBC_TOKENS:,} are read")
    n_values = 0
    for statement in re.finditer(r"^[ \t]*SG_MUL_VAL_\s([^;]*)", text, re.MULTILINE):
        for first, last in re.findall(r"\b(\d{1,20})\s*-\s*(\d{1,20})\b", statement.group(1)):
            n_values += max(int(last) - int(first), 0) + 1
    if n_values > MAX_MULTIPLEXER_VALUES:
        what = f"its multiplexers have {n_values:,} values; at most {MAX_MULTIPLEXER_VALUES:,} are read"
        raise ValueError(what)


def _find_dbc_signal(columns: Columns, mapping: FieldMapping, message: DbcMessage, term: Term) -> DbcSignal:
    name = term.path.partition(".")[2]
    for signal in message.signals:
        if signal.name == name:
            return signal
    known = ", ".join(signal.name for signal in message.signals)
    raise _error_about_mapping(
        columns, mapping, f"the message {message.name} has no signal {name or '(none)'}", f"signals: {known}"
    )


def _frame_bytes_and_lengths(columns: Columns) -> tuple[Octets, FloatArray]:
    """Return the data of each frame (n, k), and how many of its bytes are valid (n,)."""
    field = columns.fields.get("data")
    n = len(columns)
    length = read_numbers(columns, "dlc", "len")
    if isinstance(field, np.ndarray) and field.ndim == 2:
        return field.astype(np.uint8), np.where(np.isnan(length), field.shape[1], np.minimum(length, field.shape[1]))
    out = np.zeros((n, MAX_FRAME_BYTES), np.uint8)
    if not isinstance(field, Ragged):
        return out, np.zeros(n)
    counts = np.minimum(np.diff(field.offsets), MAX_FRAME_BYTES)
    inside = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    source = np.repeat(field.offsets[:-1], counts) + inside
    out[np.repeat(np.arange(n), counts), inside] = field.values[source].astype(np.uint8)
    return out, np.where(np.isnan(length), counts, np.minimum(length, counts))


def _bit_positions_of_signal(signal: DbcSignal) -> list[int]:
    """Return the positions of a signal's bits, most significant first: 8 * byte + bit, the bit counted from the least
    significant."""
    if signal.byte_order == "little_endian":
        return [signal.start + k for k in reversed(range(signal.length))]
    bits, at = [], signal.start
    for _ in range(signal.length):
        bits.append(at)
        at = at + 15 if at % 8 == 0 else at - 1  # on to the most significant bit of the next byte
    return bits


def _count_bytes_needed(signals: Sequence[Any]) -> int:
    return max(max(_bit_positions_of_signal(signal)) for signal in signals) // 8 + 1


def _raw_signal_values(octets: Octets, signal: DbcSignal) -> Any:
    """Return the raw numbers of a signal, (n,)."""
    bits = np.unpackbits(octets, axis=1, bitorder="little")[:, _bit_positions_of_signal(signal)].astype(np.uint64)
    raw = np.zeros(len(octets), np.uint64)
    for column in bits.T:
        raw = (raw << np.uint64(1)) | column
    if signal.is_float:
        width, real = FLOAT_TYPES_BY_BITS[signal.length]
        return raw.astype(width).view(real)
    if not signal.is_signed:
        return raw
    shift = np.uint64(64 - signal.length)
    return (raw << shift).view(np.int64) >> np.int64(64 - signal.length)


def _find_multiplexer_signal(message: DbcMessage, signal: DbcSignal) -> DbcSignal:
    """Return the signal that says whether a multiplexed one is in a frame."""
    selector = next(each for each in message.signals if each.name == signal.multiplexer_signal)
    if selector.multiplexer_ids:
        raise UsageError(f"the signal {signal.name} is multiplexed twice, which is not read")
    return selector


def _decode_physical_values(
    octets: Octets, message: DbcMessage, signals: Sequence[Any]
) -> tuple[list[FloatArray], BoolArray, dict[str, BoolArray]]:
    """Decode physical values; return them, which frames hold all signals, and by reason which frames have no value."""
    n = len(octets)
    is_present, is_none, is_beyond = np.ones(n, np.bool_), np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    values = []
    for signal in signals:
        raw = _raw_signal_values(octets, signal)
        if signal.multiplexer_ids:
            is_present &= np.isin(
                _raw_signal_values(octets, _find_multiplexer_signal(message, signal)), signal.multiplexer_ids
            )
        choices = {code: str(name).replace("_", " ") for code, name in (signal.choices or {}).items()}
        is_none |= np.isin(
            raw.astype(np.float64), [code for code, name in choices.items() if NO_VALUE_NAME_PATTERN.search(name)]
        )
        physical = raw.astype(np.float64) * float(signal.scale) + float(signal.offset)
        low, high = signal.minimum, signal.maximum
        if low is not None and high is not None and float(low) < float(high):
            slack = 0.5 * abs(float(signal.scale))
            is_beyond |= ~((physical >= float(low) - slack) & (physical <= float(high) + slack))
        values.append(physical)
    return values, is_present, {NOT_AVAILABLE_REASON: is_none, OUT_OF_RANGE_REASON: is_beyond & ~is_none}


def _terms_with_dbc_units(
    columns: Columns, mapping: FieldMapping, signals: Sequence[Any]
) -> tuple[tuple[Term, ...], tuple[str, ...]]:
    """Return the terms, with the DBC file's unit where the user has given none, and notes about it."""
    terms, notes = [], []
    for term, signal, kind in zip(
        mapping.terms, signals, MAPPED_QUANTITIES_BY_ROLE[mapping.role].fields.values(), strict=False
    ):
        unit = (signal.unit or "").strip()
        name = UNIT_NAMES_BY_DBC_SPELLING.get(unit.lower(), unit.lower())
        if term.has_scale or not unit:
            terms.append(term)
            continue
        if name not in SI_FACTORS_BY_UNIT_BY_KIND[kind]:
            what = f"the unit of {term.path} is {unit!r}, which is not one of {kind}"
            raise _error_about_mapping(
                columns,
                mapping,
                what,
                f"give one: {term.path}* and one of {', '.join(SI_FACTORS_BY_UNIT_BY_KIND[kind])}",
            )
        terms.append(replace(term, factor=term.factor * SI_FACTORS_BY_UNIT_BY_KIND[kind][name]))
        notes.append(f"{term.path} is in {unit}, as the DBC file says")
    return tuple(terms), tuple(notes)


def _error_about_mapping(columns: Columns, mapping: FieldMapping, fault: str, hint: str = "") -> UsageError:
    return UsageError(f"--map {mapping.role}={mapping.text}: {fault}", where=columns.topic, hint=hint)


def load_dbc_messages(files: Sequence[str]) -> list[DbcMessage]:
    """Return the messages of DBC files, in the order of the files, as cantools describes them.

    Raises:
        UsageError: A file can't be read, or cantools is not installed.
    """
    return [message for file in files for message in _load_dbc_file(file).messages]


def decode_all_signals(octets: Octets, n_octets: FloatArray | Int64Array, message: DbcMessage) -> dict[str, FloatArray]:
    """Return the physical values of each signal of a message, NaN in frames that do not hold it.

    Args:
        octets: Shape (n, k): the data of n frames of the message.
        n_octets: Shape (n,): how many of their bytes are valid.
    """
    values = {}
    for signal in message.signals:
        if signal.length > MAX_SIGNAL_BITS or (signal.is_float and signal.length not in FLOAT_TYPES_BY_BITS):
            continue
        needed = _count_bytes_needed([signal])
        wide = np.pad(octets, ((0, 0), (0, max(needed - octets.shape[1], 0))))
        (value,), is_present, faults = _decode_physical_values(wide, message, [signal])
        is_present = is_present & (n_octets >= needed)
        for is_bad in faults.values():
            is_present &= ~is_bad
        values[signal.name] = np.where(is_present, value, np.nan)
    return values
