"""The messages in the unaligned packed encoding that are read.

ETSI: CAM (EN 302 637-2 V1.4.1), DENM (EN 302 637-3 V1.3.1), CPM (TS 103 324 V2.1.1) and VAM (TS 103 300-3 V2.2.1 and
V2.3.1); release 2 packs what is read of CAM and DENM (TS 103 900, TS 103 831) alike. SAE: BSM (J2735, DSRCmsgID 20) and
SDSM (J3224, DSRCmsgID 41). Each object of a CPM or an SDSM is a road user of its own.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cwcli.signals import cpm, denm, etsi
from cwcli.signals.bsm_flags import JSON_PATHS_OF_CODED_EVENT_FLAGS
from cwcli.signals.columns import Field
from cwcli.signals.j2735 import STANDARD_JSON_PATHS_BY_QUANTITY
from cwcli.signals.radio.messages import DecodedMessages, PackedMessage, format_station_ids
from cwcli.signals.sdsm import OBJECTS_PATH, SDSM_PATHS
from cwcli.signals.v2x_tables import ros_leaf_path, strip_table_marks_from_path


def _etsi_message(
    name: str, paths: Mapping[str, str], message_id: int, version: int, objects_path: str = ""
) -> PackedMessage:
    components = {quantity: strip_table_marks_from_path(path) for quantity, path in paths.items()}
    return PackedMessage(name, components, objects_path, message_id, version)


CAM = _etsi_message("cam", etsi.CAM_PATHS, message_id=2, version=2)
"""The packed CAM; version 1 (EN 302 637-2 up to V1.3.2) packs the curvature differently."""
DENM = _etsi_message("denm", denm.DENM_PATHS, message_id=1, version=2)
"""The packed DENM, which describes an event on the road and not its sender."""
VAM = _etsi_message("vam", etsi.VAM_PATHS, message_id=16, version=3)
"""The packed VAM, which says of a pedestrian or a cyclist what a CAM says of a car; version 2 is packed differently."""
CPM = _etsi_message("cpm", cpm.CPM_PATHS, message_id=14, version=2, objects_path=cpm.OBJECTS_PATH)
"""The packed CPM; version 1 (TR 103 562) is packed differently."""
BSM_STATION_ID_PATH = STANDARD_JSON_PATHS_BY_QUANTITY["station"]
"""The component of the temporary id of a BSM's sender."""
BSM_EVENT_FLAGS_PATH = JSON_PATHS_OF_CODED_EVENT_FLAGS[0]
"""The component of the event flags of a BSM."""
BSM = PackedMessage("bsm", STANDARD_JSON_PATHS_BY_QUANTITY | {"events": BSM_EVENT_FLAGS_PATH})
"""The packed BSM: its core data (part I) and the event flags of part II."""
SDSM = PackedMessage("sdsm", SDSM_PATHS, OBJECTS_PATH)
"""The packed SDSM: its sender and its objects."""


def cam_ros_fields_from_decoded(decoded: DecodedMessages) -> dict[str, Field]:
    """Return the leaf fields of the ROS message that `signals.etsi` reads, from decoded CAMs."""
    return {ros_leaf_path(etsi.CAM_PATHS[name]): values for name, values in CAM.read_quantities(decoded).items()}


def vam_ros_fields_from_decoded(decoded: DecodedMessages) -> dict[str, Field]:
    """Return the leaf fields of the ROS message that `signals.etsi` reads, from decoded VAMs."""
    return {ros_leaf_path(etsi.VAM_PATHS[name]): values for name, values in VAM.read_quantities(decoded).items()}


def bsm_json_fields_from_decoded(decoded: DecodedMessages) -> dict[str, Field]:
    """Return the leaf fields of a JSON BSM that `signals.j2735` reads, from decoded messages."""
    fields: dict[str, Field] = {
        path: decoded.component_numbers(path) for path in STANDARD_JSON_PATHS_BY_QUANTITY.values()
    }
    fields[BSM_STATION_ID_PATH] = format_station_ids(decoded.component_codes(BSM_STATION_ID_PATH))
    fields[BSM_EVENT_FLAGS_PATH] = np.nan_to_num(decoded.component_numbers(BSM_EVENT_FLAGS_PATH)).astype(np.int64)
    return fields


def sdsm_objects_from_decoded(decoded: DecodedMessages) -> dict[str, Field]:
    """Return the quantities that `signals.sdsm` reads, one row an object, from decoded messages."""
    station = format_station_ids(decoded.component_codes(SDSM_PATHS["station"])[decoded.rows[OBJECTS_PATH]])
    return SDSM.read_quantities(decoded) | {"station": station}
