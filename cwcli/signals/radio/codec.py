"""V2X channels of octets that a radio received: which message each row is, and who sent it.

A channel may mix messages. Those that tell of their sender (BSM, CAM, VAM) are remote vehicles, and so are the objects
of those that tell of what their sender perceived (CPM, SDSM); the others are set aside by name.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals import cpm, etsi, j2735, sdsm
from cwcli.signals.columns import BoolArray, Columns, Field, Strings, sort_distinct_values
from cwcli.signals.denm import event_counts_notice_or_empty, road_events_from_denm_codes
from cwcli.signals.quality import RowLedger
from cwcli.signals.radio import frames, messages, standard_messages
from cwcli.signals.road_events import RoadEvents, join_road_events
from cwcli.signals.v2x_codec import Objects, RemoteRows, Senders, V2xCodec, empty_remote_rows

SIGNED_MESSAGES_NOTE = "are signed (IEEE 1609.2): their signatures are not verified"
"""The note on signed messages."""

J2735_MESSAGE_NAMES_BY_ID: dict[int, str] = {
    18: "MAP", 19: "SPaT", 20: "BSM", 27: "probe data", 29: "SRM", 30: "SSM", 31: "TIM", 32: "PSM", 41: "SDSM"
}  # fmt: skip
"""The message names of SAE J2735, by DSRCmsgID."""
ETSI_MESSAGE_NAMES_BY_ID: dict[int, str] = {
    1: "DENM",
    2: "CAM",
    4: "SPATEM",
    5: "MAPEM",
    6: "IVIM",
    14: "CPM",
    16: "VAM",
}
"""The message names of ETSI, by message id (TS 102 894-2)."""
MESSAGE_NAMES_BY_BTP_PORT: dict[int, str] = {
    2001: "CAM", 2002: "DENM", 2003: "MAPEM", 2004: "SPATEM", 2006: "IVIM", 2009: "CPM", 2018: "VAM"
}  # fmt: skip
"""The message names of ETSI, by BTP port (TS 103 248)."""
MESSAGE_NAMES_BY_FORMAT: dict[str, dict[int, str]] = {
    "j2735": J2735_MESSAGE_NAMES_BY_ID,
    "btp": MESSAGE_NAMES_BY_BTP_PORT,
    "its": ETSI_MESSAGE_NAMES_BY_ID,
}
"""The message names by id or port, by format."""


@dataclass(frozen=True)
class RoadUserMessage:
    """A message that describes road users.

    Attributes:
        packed: The packed message, whose objects are the road users, if it has any, else its sender.
        read_fields: Returns the leaf fields that `codec` reads of decoded messages.
        codec: The codec of the same message in a form with named fields.
    """

    packed: messages.PackedMessage
    read_fields: Callable[[messages.DecodedMessages], dict[str, Field]]
    codec: V2xCodec


STATUS_CODE_OF_MESSAGE_NOT_MATCHING_ITS_PORT, STATUS_CODE_OF_UNSUPPORTED_PROTOCOL_VERSION = 254, 255
"""The status codes of a message that is not what its port says, and of a protocol version that is not read."""
MESSAGE_FAULT_TEXTS: dict[int, str] = {
    **messages.DECODE_FAULT_TEXTS,
    STATUS_CODE_OF_MESSAGE_NOT_MATCHING_ITS_PORT: "message type does not match its port",
    STATUS_CODE_OF_UNSUPPORTED_PROTOCOL_VERSION: "unsupported protocol version",
}
"""The reason for rejecting a message, by status code."""
MESSAGES_THAT_DESCRIBE_THEIR_SENDER_BY_NAME: dict[str, RoadUserMessage] = {
    "BSM": RoadUserMessage(standard_messages.BSM, standard_messages.bsm_json_fields_from_decoded, j2735.JSON_BSM_CODEC),
    "CAM": RoadUserMessage(
        standard_messages.CAM, standard_messages.cam_ros_fields_from_decoded, etsi.CAM_AND_VAM_CODEC
    ),
    "VAM": RoadUserMessage(
        standard_messages.VAM, standard_messages.vam_ros_fields_from_decoded, etsi.CAM_AND_VAM_CODEC
    ),
}
"""The messages that describe their sender, by name."""
PERCEPTION_MESSAGES: dict[str, RoadUserMessage] = {
    "CPM": RoadUserMessage(standard_messages.CPM, standard_messages.CPM.read_quantities, cpm.PERCEIVED_OBJECT_CODEC),
    "SDSM": RoadUserMessage(
        standard_messages.SDSM, standard_messages.sdsm_objects_from_decoded, sdsm.CODED_OBJECT_CODEC
    ),
}
"""The messages that describe objects that their sender perceived, by name."""


def make_radio_codec(form: str) -> V2xCodec:
    """Return the codec of a channel whose octets are in a format: `j2735`, `btp` or `its`."""

    def identify_senders(columns: Columns) -> Senders:
        n = len(columns)
        codes = np.full(n, -1, np.int32)
        names: dict[str, int] = {}
        is_roadside = np.zeros(n, np.bool_)
        for kind, part, rows, _ in _decode_messages_describing_their_sender(
            columns, frames.unwrap_frames(columns, form), form
        ):
            senders = kind.codec.identify(part)
            index = np.array([names.setdefault(name, len(names)) for name in senders.station.values] + [-1], np.int32)
            codes[rows] = index[senders.station.codes]
            is_roadside[rows] = senders.is_roadside
        return Senders(Strings(codes, tuple(names)), np.zeros(n, np.bool_), is_roadside)

    def decode_all(columns: Columns, ledger: RowLedger) -> RemoteRows:
        found = frames.unwrap_frames(columns, form)
        _reject_rows_by_status_code(ledger, found.status, frames.FRAME_FAULT_TEXTS)
        decoded_rows = empty_remote_rows(len(columns))
        is_known = np.zeros(len(columns), np.bool_)
        for kind, part, rows, status in _decode_messages_describing_their_sender(columns, found, form):
            is_known[rows] = True
            _reject_undecodable_rows(ledger, rows, status)
            with ledger.ledger_of_rows(rows, part) as inner:
                decoded = kind.codec.decode(part, inner)
            for entry in fields(RemoteRows):
                getattr(decoded_rows, entry.name)[rows] = getattr(decoded, entry.name)
        rows, denms, notified = _decode_denms_with_rows_and_events(columns, found, form)
        _reject_undecodable_rows(ledger, rows, denms.status)
        if len(notified):
            ledger.add_note(event_counts_notice_or_empty(notified))
        for name, kind in PERCEPTION_MESSAGES.items():
            rows, decoded_objects = _decode_messages_named_with_rows(found, form, name, kind.packed)
            _reject_undecodable_rows(ledger, rows, decoded_objects.status)
        _set_aside_messages_not_describing_sender(ledger, found, is_known, form)
        n_signed = int(np.count_nonzero(found.is_signed_mask & ledger.keep))
        if n_signed:
            ledger.add_note(f"{n_signed} messages {SIGNED_MESSAGES_NOTE}")
        return decoded_rows

    def decode_objects(columns: Columns) -> Objects:
        found = frames.unwrap_frames(columns, form)
        decoded_objects = []
        for name, kind in PERCEPTION_MESSAGES.items():
            rows, decoded = _decode_messages_named_with_rows(found, form, name, kind.packed)
            of_row = decoded.rows[kind.packed.objects_path]
            if len(of_row):
                quantities = kind.read_fields(decoded)
                decoded_objects.append((columns.with_fields_of_rows(rows[of_row], quantities), kind.codec))
        return tuple(decoded_objects)

    def decode_events(columns: Columns) -> tuple[RoadEvents, BoolArray]:
        found = frames.unwrap_frames(columns, form)
        notified, is_unread = (
            [_decode_denms_with_rows_and_events(columns, found, form)[2]],
            np.zeros(len(columns), np.bool_),
        )
        for kind, part, rows, _ in _decode_messages_describing_their_sender(columns, found, form):
            flags, is_unread[rows] = kind.codec.events(part)
            notified.append(flags)
        return join_road_events(notified), is_unread

    return V2xCodec(identify_senders, decode_all, decode_objects, decode_events)


def _decode_messages_named_with_rows(
    unwrapped: frames.UnwrappedFrames, form: str, name: str, kind: messages.PackedMessage
) -> tuple[npt.NDArray[np.intp], messages.DecodedMessages]:
    message_numbers = [number for number, other in MESSAGE_NAMES_BY_FORMAT[form].items() if other == name]
    rows = np.flatnonzero(np.isin(unwrapped.message, message_numbers) & (unwrapped.status == 0))
    octets = unwrapped.octets.select_messages(rows)
    return rows, messages.decode_messages(kind.program, octets, _header_mismatch_status(octets, kind))


def _decode_messages_describing_their_sender(
    columns: Columns, unwrapped: frames.UnwrappedFrames, form: str
) -> list[tuple[RoadUserMessage, Columns, npt.NDArray[np.intp], messages.UInt8Array]]:
    """Decode the messages that describe their sender: for each kind columns with named fields, their rows, and their
    status."""
    parts = []
    for number, name in MESSAGE_NAMES_BY_FORMAT[form].items():
        kind = MESSAGES_THAT_DESCRIBE_THEIR_SENDER_BY_NAME.get(name)
        if kind is None or not (unwrapped.message == number).any():
            continue
        rows, decoded = _decode_messages_named_with_rows(unwrapped, form, name, kind.packed)
        part = columns.with_fields_of_rows(rows, kind.read_fields(decoded))
        parts.append((kind, part, rows, decoded.status))
    return parts


def _decode_denms_with_rows_and_events(
    columns: Columns, unwrapped: frames.UnwrappedFrames, form: str
) -> tuple[npt.NDArray[np.intp], messages.DecodedMessages, RoadEvents]:
    """Decode the DENMs; return their rows, their contents, and the events that they notify."""
    rows, decoded = _decode_messages_named_with_rows(unwrapped, form, "DENM", standard_messages.DENM)
    is_ok = decoded.status == 0
    codes = {name: decoded.component_numbers(path)[is_ok] for name, path in standard_messages.DENM.components.items()}
    return rows, decoded, road_events_from_denm_codes(codes, columns.log_time_ns[rows][is_ok])


def _header_mismatch_status(octets: messages.Octets, kind: messages.PackedMessage) -> messages.UInt8Array:
    """Return the status (n,) of messages whose header has another message id or version, 0 for the rest."""
    status = np.zeros(len(octets), np.uint8)
    if kind.message_id is not None and len(octets.data):
        last = len(octets.data) - 1
        has_header = octets.ends - octets.starts >= 2
        version = octets.data[np.minimum(octets.starts, last)]
        said_id = octets.data[np.minimum(octets.starts + 1, last)]
        status[has_header & (version != kind.version)] = STATUS_CODE_OF_UNSUPPORTED_PROTOCOL_VERSION
        status[has_header & (said_id != kind.message_id)] = STATUS_CODE_OF_MESSAGE_NOT_MATCHING_ITS_PORT
    return status


def _reject_undecodable_rows(ledger: RowLedger, rows: npt.NDArray[np.intp], status: messages.UInt8Array) -> None:
    """Reject the messages among these rows that can't be decoded."""
    everywhere = np.zeros(len(ledger.keep), np.uint8)
    everywhere[rows] = status
    _reject_rows_by_status_code(ledger, everywhere, MESSAGE_FAULT_TEXTS)


def _reject_rows_by_status_code(ledger: RowLedger, status: messages.UInt8Array, reasons: dict[int, str]) -> None:
    for code, reason in reasons.items():
        ledger.reject(status == code, reason)


def _set_aside_messages_not_describing_sender(
    ledger: RowLedger, unwrapped: frames.UnwrappedFrames, is_known: BoolArray, form: str
) -> None:
    """Set aside the messages that do not describe their sender, by name."""
    others = ~is_known & (unwrapped.status == 0)
    for number in sort_distinct_values(unwrapped.message[others]):
        name = MESSAGE_NAMES_BY_FORMAT[form].get(int(number), f"message {number}")
        what = "objects counted separately" if name in PERCEPTION_MESSAGES else "not about its sender"
        ledger.set_aside(others & (unwrapped.message == number), f"{name} ({what})")


J2735_CODEC = make_radio_codec("j2735")
"""The codec of SAE J2735 MessageFrames."""
BTP_CODEC = make_radio_codec("btp")
"""The codec of ETSI messages behind a basic transport header."""
ITS_CODEC = make_radio_codec("its")
"""The codec of bare ETSI messages."""
