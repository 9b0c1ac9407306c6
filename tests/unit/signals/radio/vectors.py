"""Messages that others have published, and what they decoded them to."""

from __future__ import annotations

import base64

BSM_ODE = bytes.fromhex(
    "001480b8494c4c950cd8cde6e9651116579f22a424dd78fffff00761e4fd7eb7d07f7fff80005f11d1020214c1c0ffc7c016aff4017a0ff654"
    "03b0fd204c20ffccc04f8fe40c420ffe6404cefe60e9a10133408fcfde1438103ab4138f00e1eec1048ec160103e237410445c171104e26bc1"
    "03dc4154305c2c84103b1c1c8f0a82f42103f34262d1123198103dac25fb12034ce10381c259f12038ca103574251b10e3b2210324c23ad0f2"
    "3d8efffe0000209340d10000004264bf00"
)
"""US DOT's jpo-geojsonconverter, BsmDecoderTests (Apache 2.0), with its XER beside it."""
CORE_ODE = {
    "coreData.msgCnt": 37,
    "coreData.id": 0x31325433,
    "coreData.secMark": 25_399,
    "coreData.lat": 405_659_938,
    "coreData.long": -1_050_317_754,
    "coreData.elev": 14_409,
    "coreData.accuracy.semiMajor": 186,
    "coreData.accuracy.semiMinor": 241,
    "coreData.accuracy.orientation": 65_535,
    "coreData.transmission": 7,
    "coreData.speed": 14,
    "coreData.heading": 25_060,
    "coreData.angle": 127,
    "coreData.accelSet.long": 27,
    "coreData.accelSet.lat": 0,
    "coreData.accelSet.vert": 0,
    "coreData.accelSet.yaw": 0,
    "coreData.brakes.wheelBrakes": 0b10000,
    "coreData.brakes.traction": 0,
    "coreData.brakes.abs": 0,
    "coreData.brakes.scs": 0,
    "coreData.brakes.brakeBoost": 0,
    "coreData.brakes.auxBrakes": 0,
    "coreData.size.width": 190,
    "coreData.size.length": 570,
}
CRUMBS_ODE = [
    (-113, 181, -6, 190),
    (-310, 472, -23, 610),
    (-103, 636, -14, 1570),
    (-52, 615, -13, 1870),
    (614, 1150, -17, 2589),
    (1878, 2503, 7, 3959),
    (2333, 2816, 31, 4539),
    (2187, 2952, 39, 4959),
    (1976, 2721, 46, 5699),
    (1891, 3655, 84, 6050),
    (2022, 4886, 137, 6349),
    (1973, 4861, 144, 6760),
    (1795, 4815, 144, 7270),
    (1710, 4749, 135, 7570),
    (1609, 4566, 121, 7880),
]
PREDICTION_ODE = (32_767, 0)

CAM_ASN1TOOLS = base64.b64decode(
    "AgINl1aLXpNAWrOG4g4oO3viNCMMSDOWUFh5cKJYfgKWilc3/un/6iA//5RZgQJeAMyAFdjOAATwOlwGSsZwAVOB2WAyljOACewO/QGbMZwAT+B6"
    "eA0FjOACfwOhQGLsgAAS2BzOAwdjOACTwPHwGMsZwAUOB1iAy5jOACewOlQGbsZwAT+B4qAzZjOACqA="
)
"""eerimoq/asn1tools, issue 179: decoded there by asn1tools with ETSI's modules."""
CAM_OF_ISSUE = {
    "header.stationID": 228_021_899,
    "cam.generationDeltaTime": 24_211,
    "cam.camParameters.basicContainer.stationType": 5,
    "cam.camParameters.basicContainer.referencePosition.latitude": 536_301_072,
    "cam.camParameters.basicContainer.referencePosition.longitude": 100_141_535,
    "cam.camParameters.basicContainer.referencePosition.positionConfidenceEllipse.semiMajorConfidence": 282,
    "cam.camParameters.basicContainer.referencePosition.positionConfidenceEllipse.semiMinorConfidence": 280,
    "cam.camParameters.basicContainer.referencePosition.positionConfidenceEllipse.semiMajorOrientation": 1572,
    "cam.camParameters.basicContainer.referencePosition.altitude.altitudeValue": 5650,
}
CAM_PYCRATE = bytes.fromhex(
    "02020000D900B1E74059D824554CC4C2D79FFFFFFC2230D41E58622FC0000082B88A800FFD01FFF8807FE013C0400009FFFF7FFFD8CE00"
)
"""P1sec/pycrate, issue 156."""
