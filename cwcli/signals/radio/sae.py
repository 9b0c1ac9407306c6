"""SAE's messages in the unaligned packed encoding: BSM (J2735, DSRCmsgID 20) and SDSM (J3224, DSRCmsgID 41).

An SDSM says what its sender detected of others: each object is a road user of its own (`signals.sdsm`).
"""

from __future__ import annotations

import numpy as np

from cwcli.signals.bsm_flags import CODED_FLAGS_PATHS
from cwcli.signals.columns import Field
from cwcli.signals.j2735 import JSON_RAW_PATHS
from cwcli.signals.radio.messages import DecodedMessages, PackedMessage, format_station_ids
from cwcli.signals.radio.tables import load_message_type
from cwcli.signals.sdsm import OBJECTS_PATH, SDSM_PATHS

STATION_PATH = JSON_RAW_PATHS["station"]
"""The component of the temporary id of a BSM's sender."""
EVENTS_PATH = CODED_FLAGS_PATHS[0]
"""The component of the event flags of a BSM."""
BSM = PackedMessage(lambda: load_message_type("bsm"), JSON_RAW_PATHS | {"events": EVENTS_PATH})
"""The packed BSM: its core data (part I) and the event flags of part II."""
SDSM = PackedMessage(lambda: load_message_type("sdsm"), SDSM_PATHS, OBJECTS_PATH)
"""The packed SDSM: its sender and its objects."""


def bsm_fields_from_decoded(decoded: DecodedMessages) -> dict[str, Field]:
    """Return the leaf fields of a JSON BSM that `signals.j2735` reads, from decoded messages."""
    fields: dict[str, Field] = {path: decoded.component_numbers(path) for path in JSON_RAW_PATHS.values()}
    fields[STATION_PATH] = format_station_ids(decoded.component_codes(STATION_PATH))
    fields[EVENTS_PATH] = np.nan_to_num(decoded.component_numbers(EVENTS_PATH)).astype(np.int64)
    return fields


def sdsm_objects_from_decoded(decoded: DecodedMessages) -> dict[str, Field]:
    """Return the quantities that `signals.sdsm` reads, one row an object, from decoded messages."""
    station = format_station_ids(decoded.component_codes(SDSM_PATHS["station"])[decoded.rows[OBJECTS_PATH]])
    return SDSM.read_quantities(decoded) | {"station": station}
