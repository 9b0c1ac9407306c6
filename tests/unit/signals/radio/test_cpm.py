"""CPM off the radio, against a general ASN.1 library that is given ETSI's type, and a published message."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import asn1tools
import numpy as np
import pytest

from cwcli.signals.build import build_signal
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.radio.messages import CODE_OF_MISSING_COMPONENT, DECODE_FAULT_TEXTS, decode_messages
from cwcli.signals.radio.standard_messages import CPM
from cwcli.signals.role import Role
from tests.unit.signals.radio.test_bsm import mutated, octets_of
from tests.unit.signals.v2x_messages import radio

TYPE = """
Cpm DEFINITIONS AUTOMATIC TAGS ::= BEGIN
Coordinate ::= SEQUENCE { value INTEGER (-131072..131071), confidence INTEGER (1..4096) }
VelocityComponent ::= SEQUENCE { value INTEGER (-16383..16383), confidence INTEGER (1..127) }
AccelerationComponent ::= SEQUENCE { value INTEGER (-160..161), confidence INTEGER (0..102) }
Angle ::= SEQUENCE { value INTEGER (0..3601), confidence INTEGER (1..127) }
Dimension ::= SEQUENCE { value INTEGER (1..256), confidence INTEGER (1..32) }
Correlation ::= SEQUENCE {
  componentsIncludedIntheMatrix BIT STRING (SIZE (13, ...)),
  matrix SEQUENCE (SIZE (1..13)) OF SEQUENCE (SIZE (1..13, ...)) OF INTEGER (-100..101) }
Subprofile ::= CHOICE {
  pedestrian INTEGER (0..4), bicyclistAndLightVruVehicle INTEGER (0..9), motorcyclist INTEGER (0..5),
  animal INTEGER (0..4), ... }
Cluster ::= SEQUENCE {
  clusterId INTEGER (0..255) OPTIONAL, clusterBoundingBoxShape NULL OPTIONAL, clusterCardinalitySize INTEGER (0..255),
  clusterProfiles BIT STRING (SIZE (4)) OPTIONAL, ... }
Class ::= SEQUENCE {
  objectClass CHOICE { vehicleSubClass INTEGER (0..14), vruSubClass Subprofile, groupSubClass Cluster,
    otherSubClass INTEGER (0..255), ... },
  confidence INTEGER (1..101) }
Road ::= SEQUENCE { region INTEGER (0..65535) OPTIONAL, id INTEGER (0..65535) }
MapPosition ::= SEQUENCE {
  mapReference CHOICE { roadsegment Road, intersection Road } OPTIONAL,
  laneId INTEGER (0..255) OPTIONAL, connectionId INTEGER (0..255) OPTIONAL,
  longitudinalLanePosition SEQUENCE { longitudinalLanePositionValue INTEGER (0..32767),
    longitudinalLanePositionConfidence INTEGER (0..1023) } OPTIONAL, ... }
PerceivedObject ::= SEQUENCE {
  objectId INTEGER (0..65535) OPTIONAL, measurementDeltaTime INTEGER (-2048..2047),
  position SEQUENCE { xCoordinate Coordinate, yCoordinate Coordinate, zCoordinate Coordinate OPTIONAL },
  velocity CHOICE {
    polarVelocity SEQUENCE {
      velocityMagnitude SEQUENCE { speedValue INTEGER (0..16383), speedConfidence INTEGER (1..127) },
      velocityDirection Angle, zVelocity VelocityComponent OPTIONAL },
    cartesianVelocity SEQUENCE { xVelocity VelocityComponent, yVelocity VelocityComponent,
      zVelocity VelocityComponent OPTIONAL } } OPTIONAL,
  acceleration CHOICE {
    polarAcceleration SEQUENCE {
      accelerationMagnitude SEQUENCE { accelerationMagnitudeValue INTEGER (0..161),
        accelerationConfidence INTEGER (0..102) },
      accelerationDirection Angle, zAcceleration AccelerationComponent OPTIONAL },
    cartesianAcceleration SEQUENCE { xAcceleration AccelerationComponent, yAcceleration AccelerationComponent,
      zAcceleration AccelerationComponent OPTIONAL } } OPTIONAL,
  angles SEQUENCE { zAngle Angle, yAngle Angle OPTIONAL, xAngle Angle OPTIONAL } OPTIONAL,
  zAngularVelocity SEQUENCE { value INTEGER (-255..256), confidence INTEGER (0..7) } OPTIONAL,
  lowerTriangularCorrelationMatrices SEQUENCE (SIZE (1..4)) OF Correlation OPTIONAL,
  objectDimensionZ Dimension OPTIONAL, objectDimensionY Dimension OPTIONAL, objectDimensionX Dimension OPTIONAL,
  objectAge INTEGER (0..2047) OPTIONAL, objectPerceptionQuality INTEGER (0..15) OPTIONAL,
  sensorIdList SEQUENCE (SIZE (1..128, ...)) OF INTEGER (0..255) OPTIONAL,
  classification SEQUENCE (SIZE (1..8)) OF Class OPTIONAL, mapPosition MapPosition OPTIONAL, ... }
PerceivedObjectContainer ::= SEQUENCE {
  numberOfPerceivedObjects INTEGER (0..255),
  perceivedObjects SEQUENCE (SIZE (0..255, ...)) OF PerceivedObject, ... }
Rate ::= SEQUENCE { mantissa INTEGER (1..100), exponent INTEGER (-5..2) }
CPM ::= SEQUENCE {
  header SEQUENCE { protocolVersion INTEGER (0..255), messageId INTEGER (0..255), stationId INTEGER (0..4294967295) },
  payload SEQUENCE {
    managementContainer SEQUENCE {
      referenceTime INTEGER (0..4398046511103),
      referencePosition SEQUENCE {
        latitude INTEGER (-900000000..900000001), longitude INTEGER (-1800000000..1800000001),
        positionConfidenceEllipse SEQUENCE { semiMajorAxisLength INTEGER (0..4095),
          semiMinorAxisLength INTEGER (0..4095), semiMajorAxisOrientation INTEGER (0..3601) },
        altitude SEQUENCE { altitudeValue INTEGER (-100000..800001), altitudeConfidence INTEGER (0..15) } },
      segmentationInfo SEQUENCE { totalMsgNo INTEGER (1..8), thisMsgNo INTEGER (1..8) } OPTIONAL,
      messageRateRange SEQUENCE { messageRateMin Rate, messageRateMax Rate } OPTIONAL, ... },
    cpmContainers SEQUENCE (SIZE (1..8)) OF SEQUENCE { containerId INTEGER (1..16), containerData OCTET STRING },
    ... } }
END
"""
"""After TS 103 324 V2.1.1; an open type is packed as an OCTET STRING is, an enumeration as an integer."""
BTP = b"\x07\xd9\x00\x00"
PUBLISHED = bytes.fromhex(
    "020e000004b1029ae7ebf80e116cd9b552d2d557ffffff08eddd0f90030384fc418008058010003be7209c4059801e01668bdff9ffffe016f000"
)
"""Packed by the implementation Vanetza, published with the values below."""
PUBLISHED_CODES = {
    "station": 1201,
    "reference_time_ms": 716_084_805_123,
    "latitude_deg": 210_285_110,
    "longitude_deg": 1_058_048_170,
    "object": 7,
    "delta_time_ms": -50,
    "east_m": 2500,
    "east_95_m": 90,
    "north_m": 120,
    "north_95_m": 90,
    "east_mps": 1520,
    "east_95_mps": 127,
    "north_mps": 0,
    "north_95_mps": 127,
}


@cache
def official() -> Any:
    return asn1tools.compile_string(TYPE, "uper")


def whole(rng: np.random.Generator, low: int, high: int) -> int:
    chance = rng.random()
    return low if chance < 0.05 else high if chance < 0.1 else int(rng.integers(low, high, endpoint=True))


def any_of(rng: np.random.Generator, **parts: tuple[int, int]) -> dict[str, int]:
    return {name: whole(rng, *bounds) for name, bounds in parts.items()}


def sometimes(rng: np.random.Generator, made: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in made.items() if rng.random() < 0.5}


def any_object(rng: np.random.Generator) -> dict[str, Any]:
    """With and without what is optional."""
    angle = {"value": (0, 3601), "confidence": (1, 127)}
    component = {"value": (-16_383, 16_383), "confidence": (1, 127)}
    push = {"value": (-160, 161), "confidence": (0, 102)}
    place = {"value": (-131_072, 131_071), "confidence": (1, 4096)}
    size = {"value": (1, 256), "confidence": (1, 32)}
    polar = {
        "velocityMagnitude": any_of(rng, speedValue=(0, 16_383), speedConfidence=(1, 127)),
        "velocityDirection": any_of(rng, **angle),
    } | sometimes(rng, {"zVelocity": any_of(rng, **component)})
    cartesian = {f"{axis}Velocity": any_of(rng, **component) for axis in "xy"}
    polar_2 = {
        "accelerationMagnitude": any_of(rng, accelerationMagnitudeValue=(0, 161), accelerationConfidence=(0, 102)),
        "accelerationDirection": any_of(rng, **angle),
    }
    cartesian_2 = {f"{axis}Acceleration": any_of(rng, **push) for axis in "xy"} | sometimes(
        rng, {"zAcceleration": any_of(rng, **push)}
    )
    classes: list[Any] = [
        ("vehicleSubClass", whole(rng, 0, 14)),
        ("vruSubClass", ("bicyclistAndLightVruVehicle", whole(rng, 0, 9))),
        ("groupSubClass", {"clusterCardinalitySize": 3} | sometimes(rng, {"clusterProfiles": (b"\xf0", 4)})),
        ("otherSubClass", whole(rng, 0, 255)),
    ]
    matrix = {
        "componentsIncludedIntheMatrix": (b"\xc0\x00", 13),
        "matrix": [[whole(rng, -100, 101)] * int(rng.integers(1, 4)) for _ in range(int(rng.integers(1, 4)))],
    }
    road = {"id": whole(rng, 0, 65_535)} | sometimes(rng, {"region": whole(rng, 0, 65_535)})
    optional = {
        "velocity": [("polarVelocity", polar), ("cartesianVelocity", cartesian)][int(rng.integers(2))],
        "acceleration": [("polarAcceleration", polar_2), ("cartesianAcceleration", cartesian_2)][int(rng.integers(2))],
        "angles": {"zAngle": any_of(rng, **angle)} | sometimes(rng, {"xAngle": any_of(rng, **angle)}),
        "zAngularVelocity": any_of(rng, value=(-255, 256), confidence=(0, 7)),
        "lowerTriangularCorrelationMatrices": [matrix],
        **{f"objectDimension{axis}": any_of(rng, **size) for axis in "XYZ"},
        "objectAge": whole(rng, 0, 2047),
        "objectPerceptionQuality": whole(rng, 0, 15),
        "sensorIdList": [whole(rng, 0, 255) for _ in range(int(rng.integers(1, 6)))],
        "classification": [
            {"objectClass": classes[int(rng.integers(4))], "confidence": whole(rng, 1, 101)}
            for _ in range(int(rng.integers(1, 4)))
        ],
        "mapPosition": sometimes(
            rng,
            {
                "mapReference": ("intersection", road),
                "laneId": 5,
                "longitudinalLanePosition": any_of(
                    rng, longitudinalLanePositionValue=(0, 32_767), longitudinalLanePositionConfidence=(0, 1023)
                ),
            },
        ),
        "objectId": whole(rng, 0, 65_535),
    }
    position = {f"{axis}Coordinate": any_of(rng, **place) for axis in "xy"}
    position |= sometimes(rng, {"zCoordinate": any_of(rng, **place)})
    return {"measurementDeltaTime": whole(rng, -2048, 2047), "position": position} | sometimes(rng, optional)


def any_cpm(rng: np.random.Generator) -> dict[str, Any]:
    """A message; its objects in `objects`."""
    ellipse = any_of(
        rng, semiMajorAxisLength=(0, 4095), semiMinorAxisLength=(0, 4095), semiMajorAxisOrientation=(0, 3601)
    )
    position = any_of(rng, latitude=(-900_000_000, 900_000_001), longitude=(-1_800_000_000, 1_800_000_001)) | {
        "positionConfidenceEllipse": ellipse,
        "altitude": any_of(rng, altitudeValue=(-100_000, 800_001), altitudeConfidence=(0, 15)),
    }
    rate = any_of(rng, mantissa=(1, 100), exponent=(-5, 2))
    management = {"referenceTime": whole(rng, 0, 2**42 - 1), "referencePosition": position} | sometimes(
        rng,
        {
            "segmentationInfo": any_of(rng, totalMsgNo=(1, 8), thisMsgNo=(1, 8)),
            "messageRateRange": {"messageRateMin": rate, "messageRateMax": rate},
        },
    )
    return {
        "header": {"protocolVersion": 2, "messageId": 14, "stationId": whole(rng, 0, 2**32 - 1)},
        "payload": {"managementContainer": management},
        "objects": [any_object(rng) for _ in range(int(rng.choice([0, 1, 2, 5, 20])))],
        "other": [(int(rng.choice([1, 2, 3, 4, 9])), bytes(rng.integers(0, 256, 7, dtype=np.uint8))) for _ in range(2)],
    }


def packed(made: dict[str, Any]) -> bytes:
    """By the independent encoder: other containers before and behind that of the objects."""
    content = {"numberOfPerceivedObjects": len(made["objects"]), "perceivedObjects": made["objects"]}
    inside = official().encode("PerceivedObjectContainer", content)
    first, last = ({"containerId": number, "containerData": octets} for number, octets in made["other"])
    containers = [first, {"containerId": 5, "containerData": inside}, last]
    payload = made["payload"] | {"cpmContainers": containers}
    whole_message: bytes = official().encode("CPM", {"header": made["header"], "payload": payload})
    return whole_message


def code_of(made: Any, path: str) -> int:
    """A component of a value as it was given to the encoder."""
    for name in path.split("."):
        if isinstance(made, tuple):
            made = made[1] if made[0] == name else {}
            continue
        made = made.get(name, {}) if isinstance(made, dict) else {}
    return CODE_OF_MISSING_COMPONENT if made in ({}, ()) else int(made)


def check_random(n: int, seed: int) -> None:
    """Every component of any message is what the independent encoder packed."""
    rng = np.random.default_rng(seed)
    made = [any_cpm(rng) for _ in range(n)]
    decoded = decode_messages(CPM.program, octets_of([packed(each) for each in made]))
    assert not decoded.status.any()
    objects = [(row, one) for row, each in enumerate(made) for one in each["objects"]]
    assert decoded.rows[CPM.objects_path].tolist() == [row for row, _ in objects]
    for path in CPM.components.values():
        below = path.removeprefix(f"{CPM.objects_path}.")
        expected = [code_of(each, path) for each in made] if below == path else [code_of(o, below) for _, o in objects]
        assert decoded.component_codes(path).tolist() == expected, path


def check_mutated(n: int, seed: int) -> dict[str, int]:
    """Any octets are decoded or counted, and what is decoded lies inside the type's ranges."""
    rng = np.random.default_rng(seed)
    some = [packed(any_cpm(rng)) for _ in range(50)]
    broken = [mutated(rng, some[int(rng.integers(len(some)))]) for _ in range(n)]
    decoded = decode_messages(CPM.program, octets_of(broken))
    assert set(decoded.status.tolist()) <= {0, *DECODE_FAULT_TEXTS}
    east = decoded.component_codes(CPM.components["east_m"])
    assert ((east >= -131_072) & (east <= 131_071)).all()
    assert not decoded.status[decoded.rows[CPM.objects_path]].any()
    counts = np.bincount(decoded.status, minlength=max(DECODE_FAULT_TEXTS) + 1)
    return {"decoded": int(counts[0])} | {reason: int(counts[code]) for code, reason in DECODE_FAULT_TEXTS.items()}


def test_a_published_message_is_what_its_publisher_decoded() -> None:
    decoded = decode_messages(CPM.program, octets_of([PUBLISHED]))
    assert not decoded.status.any()
    found: Mapping[str, Any] = CPM.read_quantities(decoded)
    assert {name: int(found[name][0]) for name in PUBLISHED_CODES} == PUBLISHED_CODES
    assert np.isnan(found["speed_mps"]).all()


def test_any_message_of_an_independent_encoder_is_decoded_exactly() -> None:
    check_random(150, seed=8)


def test_broken_messages_are_decoded_or_counted() -> None:
    counts = check_mutated(3000, seed=9)
    assert counts["decoded"] > 300
    assert counts["truncated message"] > 300


def test_objects_are_road_users_and_their_message_is_set_aside() -> None:
    signal, quality = build_signal(
        Role.REMOTE, radio("udp_msgs/UdpPacket", "data", BTP + PUBLISHED, BTP + PUBLISHED[:30])
    )
    assert isinstance(signal, RemoteSignal)
    assert signal.station.values == ("1201:7",)
    assert signal.is_perceived is not None
    assert signal.is_perceived.all()
    assert signal.speed_mps.tolist() == pytest.approx([15.2])
    assert signal.heading_rad.tolist() == [0.0]  # due east
    assert (signal.latitude_deg[0], signal.longitude_deg[0]) == pytest.approx((21.0285218, 105.8050575), abs=1e-7)
    assert (quality.read, quality.used, quality.rejected) == (2, 0, {"truncated message": 1})
    assert quality.set_aside == {"CPM (objects counted separately)": 1}
    assert quality.objects is not None
    assert (quality.objects.read, quality.objects.used) == (1, 1)


@pytest.mark.parametrize(
    ("heading", "velocity", "speed_mps", "accel_mps2"),
    [
        (900, (0, 1000), 10.0, -2.0),  # northward: the acceleration of 2 m/s^2 to the south brakes
        (2700, (0, 1000), -10.0, 2.0),  # headed south, moving north: in reverse
        (3601, (0, 1000), 10.0, -2.0),  # no box: it heads where it moves
        (3601, (0, 20), 0.2, np.nan),  # too slow to tell where it heads
    ],
    ids=["forward", "reverse", "no-box", "slow"],
)
def test_speed_and_acceleration_are_along_the_heading(
    heading: int, velocity: tuple[int, int], speed_mps: float, accel_mps2: float
) -> None:
    made = any_cpm(np.random.default_rng(10))
    place = {"value": 100, "confidence": 100}
    east, north = velocity
    made["payload"]["managementContainer"]["referencePosition"] |= {"latitude": 500_000_000, "longitude": 80_000_000}
    made["payload"]["managementContainer"]["referencePosition"]["positionConfidenceEllipse"] |= {
        "semiMajorAxisLength": 100,
        "semiMinorAxisLength": 100,
    }
    made["objects"] = [
        {
            "objectId": 3,
            "measurementDeltaTime": 0,
            "position": {"xCoordinate": place, "yCoordinate": place},
            "velocity": (
                "cartesianVelocity",
                {
                    "xVelocity": {"value": east, "confidence": 50},
                    "yVelocity": {"value": north, "confidence": 50},
                },
            ),
            "acceleration": (
                "cartesianAcceleration",
                {"xAcceleration": {"value": 0, "confidence": 10}, "yAcceleration": {"value": -20, "confidence": 10}},
            ),
            "angles": {"zAngle": {"value": heading, "confidence": 10}},
        }
    ]
    signal, _ = build_signal(Role.REMOTE, radio("udp_msgs/UdpPacket", "data", BTP + packed(made)))
    assert isinstance(signal, RemoteSignal)
    np.testing.assert_allclose(signal.speed_mps, [speed_mps], atol=1e-9)
    np.testing.assert_allclose(signal.accel_mps2, [accel_mps2], atol=1e-9)
