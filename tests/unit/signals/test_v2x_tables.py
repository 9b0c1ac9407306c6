"""The V2X tables: code against docs, and each row decoded with values worked out by hand from the standards."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from cwcli.signals import cpm, etsi, j2735, sdsm
from cwcli.signals.v2x_elements import decode_codes_to_values
from cwcli.signals.v2x_tables import (
    Element,
    load_message_table,
    parse_presence_bits,
    ros_leaf_path,
    ros_presence_paths,
)

DOCS = Path(__file__).parents[3] / "docs" / "v2x.md"


def table_below(heading: str) -> list[list[str]]:
    """Rows of the first table below a heading of docs/v2x.md, without its header."""
    section = re.split(f"\n##+ {heading}\n", DOCS.read_text(encoding="utf-8"), maxsplit=1)[1]
    lines = section.split("\n## ", 1)[0].splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("|"))
    rows = []
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip().strip("|").split("|")])
    return rows


def codes(cell: str) -> tuple[int, ...]:
    return () if cell == "none" else tuple(int(code) for code in cell.split(","))


def element_of(cells: list[str]) -> Element:
    low, high = (int(code) for code in re.fullmatch(r"(-?\d+)\.\.(-?\d+)", cells[4]).groups())  # type: ignore[union-attr]
    out_of_range = codes(cells[6]) if len(cells) > 6 else ()
    return Element(cells[1], float(cells[2]), int(cells[3]), low, high, codes(cells[5]), out_of_range)


@pytest.mark.parametrize(
    ("heading", "elements"),
    [
        ("SAE J2735", j2735.DATA_ELEMENTS_BY_BSM_QUANTITY),
        ("ETSI CAM", etsi.DATA_ELEMENTS_BY_CAM_OR_VAM_QUANTITY),
        ("What others perceived", cpm.DATA_ELEMENTS_BY_CPM_QUANTITY),
        (
            "SDSM",
            {
                name: each
                for name, each in sdsm.DATA_ELEMENTS_BY_SDSM_QUANTITY.items()
                if name not in j2735.DATA_ELEMENTS_BY_BSM_QUANTITY
            },
        ),
    ],
    ids=["j2735", "etsi", "cpm", "sdsm"],
)
def test_docs_table_is_the_code_s_table(heading: str, elements: dict[str, Element]) -> None:
    documented = {cells[0]: element_of(cells) for cells in table_below(heading)}
    assert documented == elements


def test_docs_yaw_rate_confidence_is_the_code_s_table() -> None:
    text = DOCS.read_text(encoding="utf-8")
    found = re.search(
        r"codes 0 to 6 of YawRateConfidence are bounds for 95 %: ([\d., ]+) degrees/s; (.+?)\.", text, re.S
    )
    assert found is not None
    assert dict(enumerate(map(float, found[1].split(",")))) == etsi.YAW_RATE_95_PERCENT_BOUND_BY_CONFIDENCE_CODE_DEGPS
    assert " ".join(found[2].split()) == "7 is out of range, 8 unavailable"


def test_docs_confidences_of_an_sdsm_are_the_code_s() -> None:
    text = DOCS.read_text(encoding="utf-8")
    for name, bounds in sdsm.STANDARD_NAME_AND_95_PERCENT_BOUNDS_BY_QUANTITY.values():
        found = re.search(rf"^\| {name} \| ([\d., ]+) \S+ \|$", text, flags=re.MULTILINE)
        assert found is not None, name
        assert tuple(map(float, found[1].split(","))) == bounds


@pytest.mark.parametrize(
    ("path", "leaf", "flag"),
    [
        ("header.stationID", "header.station_id.value", None),
        ("management.actionID.originatingStationID", "management.action_id.originating_station_id.value", None),
        ("cam.highFrequencyContainer:choice", "cam.high_frequency_container.choice", None),
        ("lateralAcceleration?.value", "lateral_acceleration.value.value", "lateral_acceleration_is_present"),
        ("management.termination?", "management.termination.value", "management.termination_is_present"),
        ("zAngularVelocity?.value", "z_angular_velocity.value.value", "z_angular_velocity_is_present"),
        ("objectDimensionX?.value", "object_dimension_x.value.value", "object_dimension_x_is_present"),
    ],
)
def test_leaf_fields_of_ros_messages_are_those_of_etsi_its_messages(path: str, leaf: str, flag: str | None) -> None:
    assert ros_leaf_path(path) == leaf
    assert ros_presence_paths({"quantity": path}) == ({} if flag is None else {"quantity": flag})


def test_a_row_gives_a_path_for_each_encoding_and_containers_are_resolved() -> None:
    table = load_message_table("cam", "etsi")
    motion = "cam.camParameters.highFrequencyContainer.basicVehicleContainerHighFrequency"
    assert table.columns["cam"]["heading_compass_deg"] == f"{motion}.heading.headingValue"
    assert table.columns["cam_ts"]["accel_mps2"] == f"{motion}.longitudinalAcceleration.value"
    assert table.columns["vam"]["latitude_deg"] == "vam.vamParameters.basicContainer.referencePosition.latitude"
    assert "length_m" not in table.columns["vam"]
    flags = parse_presence_bits(load_message_table("sdsm", "sae").columns["ros_flags"])
    assert [(path.rpartition("objects.")[2], bit) for name, path, bit in flags if name == "width_m"] == [
        ("detected_object_data.presence_vector", 1),
        ("detected_object_data.detected_object_optional_data.det_veh.presence_vector", 32),
    ]


# Element, code, value: worked out by hand from the standards' definitions.
BY_HAND = [
    ("j2735", "latitude_deg", 408_646_987, 40.8646987),
    ("j2735", "latitude_deg", -900_000_000, -90.0),
    ("j2735", "latitude_deg", 900_000_001, None),
    ("j2735", "longitude_deg", -778_304_602, -77.8304602),
    ("j2735", "longitude_deg", 1_800_000_001, None),
    ("j2735", "altitude_m", 3356, 335.6),
    ("j2735", "altitude_m", -4095, -409.5),
    ("j2735", "altitude_m", -4096, None),
    ("j2735", "semi_major_m", 186, 9.3),
    ("j2735", "semi_major_m", 254, 12.7),
    ("j2735", "semi_major_m", 255, None),
    ("j2735", "semi_minor_m", 255, None),
    ("j2735", "semi_major_compass_deg", 65_534, 359.9945078786),
    ("j2735", "semi_major_compass_deg", 65_535, None),
    ("j2735", "speed_mps", 500, 10.0),
    ("j2735", "speed_mps", 8190, 163.8),
    ("j2735", "speed_mps", 8191, None),
    ("j2735", "heading_compass_deg", 7200, 90.0),
    ("j2735", "heading_compass_deg", 28_799, 359.9875),
    ("j2735", "heading_compass_deg", 28_800, None),
    ("j2735", "accel_mps2", -350, -3.5),
    ("j2735", "accel_mps2", 2001, None),
    ("j2735", "lateral_accel_mps2", 100, -1.0),  # 1 m/s^2 to the right
    ("j2735", "lateral_accel_mps2", 2001, None),
    ("j2735", "yaw_rate_degps", 1000, -10.0),  # 10 degrees/s to the right
    ("j2735", "yaw_rate_degps", -32_767, 327.67),
    ("j2735", "width_m", 190, 1.9),
    ("j2735", "width_m", 0, None),
    ("j2735", "length_m", 570, 5.7),
    ("j2735", "length_m", 0, None),
    ("j2735", "length_m", 4096, None),
    ("cpm", "east_m", -13_107, -131.07),
    ("cpm", "east_m", 131_071, None),
    ("cpm", "north_95_m", 4094, 40.94),
    ("cpm", "north_95_m", 4095, None),
    ("cpm", "delta_time_ms", -50, -50.0),
    ("cpm", "delta_time_ms", -2048, None),
    ("cpm", "east_mps", -1520, -15.2),
    ("cpm", "east_mps", 16_383, None),
    ("cpm", "heading_deg", 900, 90.0),
    ("cpm", "yaw_rate_degps", -7, -7.0),  # to the right
    ("cpm", "yaw_rate_degps", 256, None),
    ("cpm", "length_m", 45, 4.5),
    ("cpm", "length_m", 255, None),
    ("sdsm", "north_m", -32_767, -3276.7),
    ("sdsm", "delta_time_ms", 1500, 1500.0),
    ("etsi", "latitude_deg", 468_937_604, 46.8937604),
    ("etsi", "latitude_deg", 900_000_001, None),
    ("etsi", "longitude_deg", 168_437_430, 16.843743),
    ("etsi", "longitude_deg", 1_800_000_001, None),
    ("etsi", "altitude_m", 24_314, 243.14),
    ("etsi", "altitude_m", 800_001, None),
    ("etsi", "semi_major_m", 196, 1.96),
    ("etsi", "semi_major_m", 4094, None),
    ("etsi", "semi_major_m", 4095, None),
    ("etsi", "semi_minor_m", 4095, None),
    ("etsi", "semi_major_compass_deg", 3601, None),
    ("etsi", "heading_compass_deg", 2640, 264.0),
    ("etsi", "heading_compass_deg", 3601, None),
    ("etsi", "heading_95_deg", 10, 1.0),
    ("etsi", "heading_95_deg", 126, None),
    ("etsi", "heading_95_deg", 127, None),
    ("etsi", "speed_mps", 814, 8.14),
    ("etsi", "speed_mps", 16_383, None),
    ("etsi", "speed_95_mps", 100, 1.0),
    ("etsi", "speed_95_mps", 126, None),
    ("etsi", "speed_95_mps", 127, None),
    ("etsi", "accel_mps2", -35, -3.5),
    ("etsi", "accel_mps2", 161, None),
    ("etsi", "accel_95_mps2", 2, 0.2),
    ("etsi", "accel_95_mps2", 101, None),
    ("etsi", "accel_95_mps2", 102, None),
    ("etsi", "lateral_accel_mps2", 10, 1.0),  # to the left
    ("etsi", "lateral_accel_mps2", 161, None),
    ("etsi", "yaw_rate_degps", 1000, 10.0),  # to the left
    ("etsi", "yaw_rate_degps", 32_767, None),
    ("etsi", "length_m", 45, 4.5),
    ("etsi", "length_m", 1022, None),
    ("etsi", "length_m", 1023, None),
    ("etsi", "width_m", 18, 1.8),
    ("etsi", "width_m", 61, None),
    ("etsi", "width_m", 62, None),
]


STANDARDS = {
    "j2735": j2735.DATA_ELEMENTS_BY_BSM_QUANTITY,
    "etsi": etsi.DATA_ELEMENTS_BY_CAM_OR_VAM_QUANTITY,
    "cpm": cpm.DATA_ELEMENTS_BY_CPM_QUANTITY,
    "sdsm": sdsm.DATA_ELEMENTS_BY_SDSM_QUANTITY,
}


@pytest.mark.parametrize(("standard", "quantity", "code", "expected"), BY_HAND)
def test_decode_by_hand(standard: str, quantity: str, code: int, expected: float | None) -> None:
    element = STANDARDS[standard][quantity]
    value = decode_codes_to_values(element, np.array([float(code)]))[0]
    if expected is None:
        assert np.isnan(value)
    else:
        assert value == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize(
    ("standard", "quantity"),
    [(standard, name) for standard, elements in STANDARDS.items() for name in elements],
)
def test_decode_is_nan_for_every_special_code_and_outside_the_range(standard: str, quantity: str) -> None:
    element = STANDARDS[standard][quantity]
    outside = (element.low - 1, element.high + 1, 2_147_483_647, np.nan)
    raw = np.array([*element.unavailable, *element.out_of_range, *outside], dtype=np.float64)
    assert np.isnan(decode_codes_to_values(element, raw)).all()
    assert np.isfinite(decode_codes_to_values(element, np.array([element.low, element.high], dtype=np.float64))).all()


def test_by_hand_table_covers_every_element_and_every_special_code() -> None:
    covered = {(standard, quantity, code) for standard, quantity, code, _ in BY_HAND}
    for standard, elements in (
        ("j2735", j2735.DATA_ELEMENTS_BY_BSM_QUANTITY),
        ("etsi", etsi.DATA_ELEMENTS_BY_CAM_OR_VAM_QUANTITY),
    ):
        for quantity, element in elements.items():
            assert any(row[:2] == (standard, quantity) for row in covered)
            for code in element.unavailable + element.out_of_range:
                assert (standard, quantity, code) in covered or quantity == "semi_minor_m", (standard, quantity, code)
