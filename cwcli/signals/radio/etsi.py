"""ETSI's messages in the unaligned packed encoding: CAM (EN 302 637-2 V1.4.1), DENM (EN 302 637-3 V1.3.1), CPM
(TS 103 324 V2.1.1) and VAM (TS 103 300-3 V2.2.1 and V2.3.1).

Release 2 packs what is read of CAM and DENM (TS 103 900, TS 103 831) alike.
"""

from __future__ import annotations

from collections.abc import Mapping

from cwcli.signals import cpm, denm, etsi
from cwcli.signals.columns import Field
from cwcli.signals.radio.messages import DecodedMessages, PackedMessage
from cwcli.signals.radio.tables import load_message_type
from cwcli.signals.v2x_tables import ros_leaf_path, strip_table_marks_from_path


def _etsi_message(
    name: str, paths: Mapping[str, str], message_id: int, version: int, objects_path: str = ""
) -> PackedMessage:
    components = {quantity: strip_table_marks_from_path(path) for quantity, path in paths.items()}
    return PackedMessage(lambda: load_message_type(name), components, objects_path, message_id, version)


CAM = _etsi_message("cam", etsi.CAM_PATHS, message_id=2, version=2)
"""The packed CAM; version 1 (EN 302 637-2 up to V1.3.2) packs the curvature differently."""
DENM = _etsi_message("denm", denm.DENM_PATHS, message_id=1, version=2)
"""The packed DENM, which describes an event on the road and not its sender."""
VAM = _etsi_message("vam", etsi.VAM_PATHS, message_id=16, version=3)
"""The packed VAM, which says of a pedestrian or a cyclist what a CAM says of a car; version 2 is packed differently."""
CPM = _etsi_message("cpm", cpm.CPM_PATHS, message_id=14, version=2, objects_path=cpm.OBJECTS_PATH)
"""The packed CPM, whose objects are road users of their own; version 1 (TR 103 562) is packed differently."""


def cam_fields_from_decoded(decoded: DecodedMessages) -> dict[str, Field]:
    """Return the leaf fields of the ROS message that `signals.etsi` reads, from decoded CAMs."""
    return {ros_leaf_path(etsi.CAM_PATHS[name]): values for name, values in CAM.read_quantities(decoded).items()}


def vam_fields_from_decoded(decoded: DecodedMessages) -> dict[str, Field]:
    """Return the leaf fields of the ROS message that `signals.etsi` reads, from decoded VAMs."""
    return {ros_leaf_path(etsi.VAM_PATHS[name]): values for name, values in VAM.read_quantities(decoded).items()}
