"""VAM off the radio, against a general ASN.1 library that is given the part of the type that is read."""

from __future__ import annotations

from typing import Any

import asn1tools
import numpy as np
import pytest

from cwcli.signals.build import build_signal
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.radio.messages import CODE_OF_MISSING_COMPONENT, decode_messages
from cwcli.signals.radio.standard_messages import VAM
from cwcli.signals.role import Role
from tests.unit.signals.radio.test_bsm import octets_of
from tests.unit.signals.v2x_messages import radio

TYPE = """
Part DEFINITIONS AUTOMATIC TAGS ::= BEGIN
Angle ::= SEQUENCE { value INTEGER (0..3601), confidence INTEGER (1..127) }
Longitudinal ::= SEQUENCE {
  longitudinalAccelerationValue INTEGER (-160..161), longitudinalAccelerationConfidence INTEGER (0..102) }
Lateral ::= SEQUENCE {
  lateralAccelerationValue INTEGER (-160..161), lateralAccelerationConfidence INTEGER (0..102) }
Position ::= SEQUENCE {
  latitude INTEGER (-900000000..900000001), longitude INTEGER (-1800000000..1800000001),
  positionConfidenceEllipse SEQUENCE {
    semiMajorAxisLength INTEGER (0..4095), semiMinorAxisLength INTEGER (0..4095),
    semiMajorAxisOrientation INTEGER (0..3601) },
  altitude SEQUENCE { altitudeValue INTEGER (-100000..800001), altitudeConfidence INTEGER (0..15) } }
HighFrequency ::= SEQUENCE {
  heading Angle, speed SEQUENCE { speedValue INTEGER (0..16383), speedConfidence INTEGER (1..127) },
  longitudinalAcceleration Longitudinal,
  curvature SEQUENCE { curvatureValue INTEGER (-1023..1023), curvatureConfidence INTEGER (0..7) } OPTIONAL,
  curvatureCalculationMode ENUMERATED { a, b, c, ... } OPTIONAL,
  yawRate SEQUENCE { yawRateValue INTEGER (-32766..32767), yawRateConfidence INTEGER (0..8) } OPTIONAL,
  lateralAcceleration Lateral OPTIONAL, verticalAcceleration Angle OPTIONAL,
  vruLanePosition INTEGER (0..255) OPTIONAL, environment INTEGER (0..255) OPTIONAL,
  movementControl INTEGER (0..255) OPTIONAL, orientation Angle OPTIONAL, rollAngle Angle OPTIONAL,
  deviceUsage INTEGER (0..255) OPTIONAL, ... }
VAM ::= SEQUENCE {
  header SEQUENCE { protocolVersion INTEGER (0..255), messageId INTEGER (0..255), stationId INTEGER (0..4294967295) },
  vam SEQUENCE { generationDeltaTime INTEGER (0..65535), vamParameters SEQUENCE {
    basicContainer SEQUENCE { stationType INTEGER (0..255), referencePosition Position, ... },
    vruHighFrequencyContainer HighFrequency,
    low OCTET STRING OPTIONAL,
    info OCTET STRING OPTIONAL, operation OCTET STRING OPTIONAL, motion OCTET STRING OPTIONAL,
    ... } } }
END
"""
"""After TS 103 300-3 V2.2.1; what stands behind the lateral acceleration is made up, because it is not read."""
OPTIONAL = (
    "curvature",
    "curvatureCalculationMode",
    "yawRate",
    "lateralAcceleration",
    "verticalAcceleration",
    "deviceUsage",
)


def test_any_message_of_an_independent_encoder_is_decoded_exactly() -> None:
    rng, codec = np.random.default_rng(5), asn1tools.compile_string(TYPE, "uper")
    packed, expected = [], []
    for _ in range(200):
        made = any_vam(rng)
        packed.append(codec.encode("VAM", made))
        expected.append(made)
    decoded = decode_messages(VAM.program, octets_of(packed))
    assert not decoded.status.any()
    for row, made in enumerate(expected):
        for path in VAM.components.values():
            value = made
            for name in path.split("."):
                value = value.get(name, {}) if isinstance(value, dict) else value
            assert decoded.component_codes(path)[row] == (CODE_OF_MISSING_COMPONENT if value == {} else value), path


def test_the_smallest_message_has_269_bits() -> None:
    made = any_vam(np.random.default_rng(6))
    high = made["vam"]["vamParameters"]["vruHighFrequencyContainer"]
    for name in OPTIONAL:
        high.pop(name, None)
    made["vam"]["vamParameters"].pop("low", None)
    packed = asn1tools.compile_string(TYPE, "uper").encode("VAM", made)
    assert len(packed) == 34
    decoded = decode_messages(VAM.program, octets_of([packed, packed[:-1]]))
    assert decoded.status.tolist()[0] == 0
    assert decoded.status.tolist()[1] != 0


def test_who_walks_is_a_remote_road_user() -> None:
    made = any_vam(np.random.default_rng(7))
    parameters = made["vam"]["vamParameters"]
    parameters["basicContainer"]["stationType"] = 1
    parameters["basicContainer"]["referencePosition"] |= {
        "latitude": 400_000_000,
        "longitude": 80_000_000,
        "positionConfidenceEllipse": {
            "semiMajorAxisLength": 490,
            "semiMinorAxisLength": 490,
            "semiMajorAxisOrientation": 0,
        },
    }
    parameters["vruHighFrequencyContainer"] |= {
        "speed": {"speedValue": 140, "speedConfidence": 10},
        "heading": {"value": 900, "confidence": 10},
    }
    made["header"]["stationId"] = 77
    packed = asn1tools.compile_string(TYPE, "uper").encode("VAM", made)
    signal, quality = build_signal(Role.REMOTE, radio("udp_msgs/UdpPacket", "data", b"\x07\xe2\x00\x00" + packed))
    assert isinstance(signal, RemoteSignal)
    assert quality.used == 1
    assert signal.station.values == ("77",)
    assert (signal.latitude_deg[0], signal.speed_mps[0]) == pytest.approx((40.0, 1.4), abs=1e-9)
    assert abs(signal.heading_rad[0]) < 1e-12  # due east
    assert np.isnan(signal.length_m[0])


def any_vam(rng: np.random.Generator) -> dict:
    """A message, with and without what is optional."""

    def whole(low: int, high: int) -> int:
        return int(rng.integers(low, high, endpoint=True))

    def acceleration(way: str) -> dict[str, int]:
        return {f"{way}AccelerationValue": whole(-160, 161), f"{way}AccelerationConfidence": whole(0, 102)}

    high: dict[str, Any] = {
        "heading": {"value": whole(0, 3601), "confidence": whole(1, 127)},
        "speed": {"speedValue": whole(0, 16_383), "speedConfidence": whole(1, 127)},
        "longitudinalAcceleration": acceleration("longitudinal"),
    }
    optional: dict[str, Any] = {
        "curvature": {"curvatureValue": whole(-1023, 1023), "curvatureConfidence": whole(0, 7)},
        "curvatureCalculationMode": "abc"[whole(0, 2)],
        "yawRate": {"yawRateValue": whole(-32_766, 32_767), "yawRateConfidence": whole(0, 8)},
        "lateralAcceleration": acceleration("lateral"),
        "verticalAcceleration": {"value": whole(0, 161), "confidence": whole(1, 102)},
        "deviceUsage": whole(0, 255),
    }
    high |= {name: value for name, value in optional.items() if rng.random() < 0.5}
    ellipse = {"semiMajorAxisLength": whole(0, 4095), "semiMinorAxisLength": whole(0, 4095)}
    position = {
        "latitude": whole(-900_000_000, 900_000_001),
        "longitude": whole(-1_800_000_000, 1_800_000_001),
        "positionConfidenceEllipse": ellipse | {"semiMajorAxisOrientation": whole(0, 3601)},
        "altitude": {"altitudeValue": whole(-100_000, 800_001), "altitudeConfidence": whole(0, 15)},
    }
    parameters: dict[str, Any] = {
        "basicContainer": {"stationType": whole(0, 255), "referencePosition": position},
        "vruHighFrequencyContainer": high,
    }
    if rng.random() < 0.5:
        parameters["low"] = b"\x07" * whole(1, 9)
    return {
        "header": {"protocolVersion": 3, "messageId": 16, "stationId": whole(0, 2**32 - 1)},
        "vam": {"generationDeltaTime": whole(0, 65_535), "vamParameters": parameters},
    }
