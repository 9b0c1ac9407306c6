"""V2X channels of octets that a radio received: which message each row is, and who sent it.

A channel may mix messages. Those that tell of their sender (BSM, CAM, VAM) are remote vehicles, and so are the objects
of those that tell of what their sender perceived (CPM, SDSM); the others are set aside by name.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from cwcli.signals import cpm as cpm_objects
from cwcli.signals import etsi, j2735, perceived
from cwcli.signals import sdsm as sdsm_objects
from cwcli.signals.columns import Columns, Field, Strings
from cwcli.signals.denm import told
from cwcli.signals.quality import BoolArray, RowLedger
from cwcli.signals.radio import bsm, cam, cpm, denm, frames, messages, sdsm, vam
from cwcli.signals.radio.program import Program
from cwcli.signals.road_events import RoadEvents, joined_events
from cwcli.signals.v2x_codec import Objects, RemoteRows, Senders, V2xCodec, nothing_told

SIGNED_NOTE = "are signed (IEEE 1609.2): their signatures are not verified"
"""The note on signed messages."""

J2735_NAMES: dict[int, str] = {
    18: "MAP", 19: "SPaT", 20: "BSM", 27: "probe data", 29: "SRM", 30: "SSM", 31: "TIM", 32: "PSM", 41: "SDSM"
}  # fmt: skip
"""The message names of SAE J2735, by DSRCmsgID."""
ETSI_NAMES: dict[int, str] = {1: "DENM", 2: "CAM", 4: "SPATEM", 5: "MAPEM", 6: "IVIM", 14: "CPM", 16: "VAM"}
"""The message names of ETSI, by message id (TS 102 894-2)."""
PORT_NAMES: dict[int, str] = {
    2001: "CAM", 2002: "DENM", 2003: "MAPEM", 2004: "SPATEM", 2006: "IVIM", 2009: "CPM", 2018: "VAM"
}  # fmt: skip
"""The message names of ETSI, by BTP port (TS 103 248)."""
NAMES: dict[str, dict[int, str]] = {"j2735": J2735_NAMES, "btp": PORT_NAMES, "its": ETSI_NAMES}
"""The message names by id or port, by format."""


@dataclass(frozen=True)
class Packed:
    """A message in the packed encoding that is decoded.

    Attributes:
        program: The program that decodes its components.
        message_id, versions: The required values of the header, for ETSI's messages.
    """

    program: Callable[[], Program]
    message_id: int | None = None
    versions: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Kind(Packed):
    """A message that describes road users.

    Attributes:
        fields: Decoded messages -> the leaf fields that `codec` reads.
        codec: The codec of the same message in a form with named fields.
        rows: The list whose elements are the road users; "": the message's sender is the one.
    """

    fields: Callable[[messages.Decoded], dict[str, Field]]
    codec: V2xCodec
    rows: str = ""


OTHER_MESSAGE, OTHER_VERSION = 254, 255
"""The status codes of a message that is not what its port says, and of a protocol version that is not read."""
FAULTS: dict[int, str] = {
    **messages.FAULTS,
    OTHER_MESSAGE: "message type does not match its port",
    OTHER_VERSION: "unsupported protocol version",
}
"""The reason for rejecting a message, by status code."""
KINDS: dict[str, Kind] = {
    "BSM": Kind(bsm.core_program, fields=bsm.fields, codec=j2735.JSON_BSM),
    "CAM": Kind(cam.program, cam.MESSAGE_ID, cam.PROTOCOL_VERSIONS, fields=cam.fields, codec=etsi.CAM),
    "VAM": Kind(vam.program, vam.MESSAGE_ID, vam.PROTOCOL_VERSIONS, fields=vam.fields, codec=etsi.CAM),
}
"""The messages that describe their sender, by name."""
PERCEIVED: dict[str, Kind] = {
    "CPM": Kind(
        cpm.program,
        cpm.MESSAGE_ID,
        cpm.PROTOCOL_VERSIONS,
        fields=cpm.objects,
        codec=cpm_objects.OBJECT_CODEC,
        rows=cpm.OBJECTS,
    ),
    "SDSM": Kind(sdsm.program, fields=sdsm.objects, codec=sdsm_objects.OBJECT_CODEC, rows=sdsm.OBJECTS),
}
"""The messages that describe objects that their sender perceived, by name."""
DENM = Packed(denm.program, denm.MESSAGE_ID, denm.PROTOCOL_VERSIONS)
"""The message that notifies events."""


def radio_codec(form: str) -> V2xCodec:
    """Return the codec of a channel whose octets are in a format: `j2735`, `btp` or `its`."""

    def identify(columns: Columns) -> Senders:
        n = len(columns)
        codes = np.full(n, -1, np.int32)
        names: dict[str, int] = {}
        is_roadside = np.zeros(n, np.bool_)
        for kind, part, rows, _ in _parts(columns, frames.unwrap(columns, form), form):
            senders = kind.codec.identify(part)
            index = np.array([names.setdefault(name, len(names)) for name in senders.station.values] + [-1], np.int32)
            codes[rows] = index[senders.station.codes]
            is_roadside[rows] = senders.is_roadside
        return Senders(Strings(codes, tuple(names)), np.zeros(n, np.bool_), is_roadside)

    def decode_all(columns: Columns, ledger: RowLedger) -> RemoteRows:
        found = frames.unwrap(columns, form)
        _reject(ledger, found.status, frames.FAULTS)
        made = nothing_told(len(columns))
        is_known = np.zeros(len(columns), np.bool_)
        for kind, part, rows, status in _parts(columns, found, form):
            is_known[rows] = True
            _reject_some(ledger, rows, status)
            with ledger.part(rows, part) as inner:
                decoded = kind.codec.decode(part, inner)
            for entry in fields(RemoteRows):
                getattr(made, entry.name)[rows] = getattr(decoded, entry.name)
        rows, denms, notified = _denms(columns, found, form)
        _reject_some(ledger, rows, denms.status)
        if len(notified):
            ledger.note(told(notified))
        for name, kind in PERCEIVED.items():
            rows, decoded_objects = _decoded(found, form, name, kind)
            _reject_some(ledger, rows, decoded_objects.status)
        _set_aside(ledger, found, is_known, form)
        n_signed = int(np.count_nonzero(found.is_signed & ledger.keep))
        if n_signed:
            ledger.note(f"{n_signed} messages {SIGNED_NOTE}")
        return made

    def objects(columns: Columns) -> Objects:
        found = frames.unwrap(columns, form)
        made = []
        for name, kind in PERCEIVED.items():
            rows, decoded = _decoded(found, form, name, kind)
            of_row = decoded.rows[kind.rows]
            if len(of_row):
                made.append((perceived.object_columns(columns, rows[of_row], kind.fields(decoded)), kind.codec))
        return tuple(made)

    def events(columns: Columns) -> tuple[RoadEvents, BoolArray]:
        found = frames.unwrap(columns, form)
        notified, is_unread = [_denms(columns, found, form)[2]], np.zeros(len(columns), np.bool_)
        for kind, part, rows, _ in _parts(columns, found, form):
            flags, is_unread[rows] = kind.codec.events(part)
            notified.append(flags)
        return joined_events(notified), is_unread

    return V2xCodec(identify, decode_all, objects, events)


def _decoded(found: frames.Frames, form: str, name: str, kind: Packed) -> tuple[npt.NDArray[np.intp], messages.Decoded]:
    """Decode the messages with a name; return their rows and their contents."""
    wanted = [number for number, other in NAMES[form].items() if other == name]
    rows = np.flatnonzero(np.isin(found.message, wanted) & (found.status == 0))
    octets = found.octets.take(rows)
    return rows, messages.decode(kind.program(), octets, _foreign(octets, kind.message_id, kind.versions))


def _parts(
    columns: Columns, found: frames.Frames, form: str
) -> list[tuple[Kind, Columns, npt.NDArray[np.intp], messages.UInt8Array]]:
    """Decode the messages that describe their sender: for each kind columns with named fields, their rows, and their
    status."""
    parts = []
    for number, name in NAMES[form].items():
        kind = KINDS.get(name)
        if kind is None or not (found.message == number).any():
            continue
        rows, decoded = _decoded(found, form, name, kind)
        part = replace(
            columns,
            log_time_ns=columns.log_time_ns[rows],
            publish_time_ns=columns.publish_time_ns[rows],
            sequence=columns.sequence[rows],
            fields=kind.fields(decoded),
            n_undecodable=0,
        )
        parts.append((kind, part, rows, decoded.status))
    return parts


def _denms(
    columns: Columns, found: frames.Frames, form: str
) -> tuple[npt.NDArray[np.intp], messages.Decoded, RoadEvents]:
    """Decode the DENMs; return their rows, their contents, and the events that they notify."""
    rows, decoded = _decoded(found, form, "DENM", DENM)
    return rows, decoded, denm.events(decoded, columns.log_time_ns[rows])


def _foreign(octets: messages.Octets, message_id: int | None, versions: tuple[int, ...]) -> messages.UInt8Array:
    """Return the status (n,) of messages whose header does not fit the message id or versions, 0 for the rest."""
    status = np.zeros(len(octets), np.uint8)
    if message_id is not None and len(octets.data):
        last = len(octets.data) - 1
        has_header = octets.ends - octets.starts >= 2
        version = octets.data[np.minimum(octets.starts, last)]
        said_id = octets.data[np.minimum(octets.starts + 1, last)]
        status[has_header & ~np.isin(version, versions)] = OTHER_VERSION
        status[has_header & (said_id != message_id)] = OTHER_MESSAGE
    return status


def _reject_some(ledger: RowLedger, rows: npt.NDArray[np.intp], status: messages.UInt8Array) -> None:
    """Reject the messages among these rows that can't be decoded."""
    everywhere = np.zeros(len(ledger.keep), np.uint8)
    everywhere[rows] = status
    _reject(ledger, everywhere, FAULTS)


def _reject(ledger: RowLedger, status: messages.UInt8Array, reasons: dict[int, str]) -> None:
    for code, reason in reasons.items():
        ledger.reject(status == code, reason)


def _set_aside(ledger: RowLedger, found: frames.Frames, is_known: BoolArray, form: str) -> None:
    """Set aside the messages that do not describe their sender, by name."""
    others = ~is_known & (found.status == 0)
    for number in np.unique(found.message[others]):
        name = NAMES[form].get(int(number), f"message {number}")
        what = "objects counted separately" if name in PERCEIVED else "not about its sender"
        ledger.set_aside(others & (found.message == number), f"{name} ({what})")


J2735 = radio_codec("j2735")
"""The codec of SAE J2735 MessageFrames."""
BTP = radio_codec("btp")
"""The codec of ETSI messages behind a basic transport header."""
ITS = radio_codec("its")
"""The codec of bare ETSI messages."""
