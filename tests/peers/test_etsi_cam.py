"""The octets of the CAM that other tests use are those of an independent encoder of ETSI's modules."""

from __future__ import annotations

import pytest
from pycrate_asn1dir import ITS_CAM_2

from tests.unit.signals.v2x_messages import CAM, packed_cam


def official_cam(k: int) -> bytes:
    """The CAM, by an independent encoder, `k` tenths of a second later."""
    position = {
        "latitude": CAM["latitude_deg"],
        "longitude": CAM["longitude_deg"],
        "positionConfidenceEllipse": {
            "semiMajorConfidence": CAM["semi_major_m"],
            "semiMinorConfidence": CAM["semi_minor_m"],
            "semiMajorOrientation": CAM["semi_major_compass_deg"],
        },
        "altitude": {"altitudeValue": CAM["altitude_m"], "altitudeConfidence": "unavailable"},
    }
    vehicle = {
        "heading": {"headingValue": CAM["heading_compass_deg"], "headingConfidence": CAM["heading_95_deg"]},
        "speed": {"speedValue": CAM["speed_mps"], "speedConfidence": CAM["speed_95_mps"]},
        "driveDirection": "forward",
        "vehicleLength": {
            "vehicleLengthValue": CAM["length_m"],
            "vehicleLengthConfidenceIndication": "noTrailerPresent",
        },
        "vehicleWidth": CAM["width_m"],
        "longitudinalAcceleration": {
            "longitudinalAccelerationValue": CAM["accel_mps2"],
            "longitudinalAccelerationConfidence": CAM["accel_95_mps2"],
        },
        "curvature": {"curvatureValue": 1023, "curvatureConfidence": "unavailable"},
        "curvatureCalculationMode": "unavailable",
        "yawRate": {"yawRateValue": CAM["yaw_rate_degps"], "yawRateConfidence": "degSec-001-00"},
        "lateralAcceleration": {
            "lateralAccelerationValue": CAM["lateral_accel_mps2"],
            "lateralAccelerationConfidence": 102,
        },
    }
    message = ITS_CAM_2.CAM_PDU_Descriptions.CAM
    message.set_val(
        {
            "header": {"protocolVersion": 2, "messageID": 2, "stationID": CAM["station"]},
            "cam": {
                "generationDeltaTime": (CAM["generation_delta_time"] + 100 * k) % 65_536,
                "camParameters": {
                    "basicContainer": {"stationType": CAM["station_type"], "referencePosition": position},
                    "highFrequencyContainer": ("basicVehicleContainerHighFrequency", vehicle),
                },
            },
        }
    )
    packed: bytes = message.to_uper()
    return packed


@pytest.mark.parametrize("k", [0, 1, 700])
def test_the_committed_octets_are_those_of_the_encoder(k: int) -> None:
    assert packed_cam(k) == official_cam(k)
