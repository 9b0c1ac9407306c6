"""What is wrong with a source is found and corrected, or the source is left out; what is right stays as it is."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cwcli.errors import UsageError
from cwcli.estimation.config import parse_source_units
from cwcli.estimation.contradiction import SourceQuantity
from cwcli.estimation.hypotheses import UNIT_AND_CONVENTION_HYPOTHESES_BY_KIND
from cwcli.estimation.hypotheses.base import with_pairwise_combinations
from cwcli.estimation.hypotheses.imu import signed_axis_rotations
from cwcli.estimation.measurements import QUANTITY_BY_KIND, Kind, Measurements
from cwcli.estimation.prepare import clean_and_sort_measurements_and_note
from cwcli.estimation.source_judgement import (
    JudgedSources,
    correct_and_list_user_faults,
    judge_sources,
    set_wrong_rows_aside_and_list_them,
)
from tests.unit.estimation.made_drive import Values, made_drive

G = 9.80665
TIME_S, VALUES = made_drive()
STAMP_NS = np.rint(1e9 * TIME_S).astype(np.int64)
ALL = (Kind.POSITION, Kind.SPEED, Kind.HEADING, Kind.IMU)
LEAN = (Kind.POSITION, Kind.IMU)


def _drive(*kinds: Kind, made: Values = VALUES) -> list[Measurements]:
    """A made drive with noise of usual sensors; its IMU reads v w to the left and gravity upward."""
    rng = np.random.default_rng(3)
    zero = np.zeros(len(TIME_S))
    speed, yaw_rate = made[Kind.SPEED], made[Kind.YAW_RATE]
    exact = {
        **made,
        Kind.IMU: np.column_stack([made[Kind.ACCEL], speed * yaw_rate, zero + G, zero, zero, yaw_rate]),
    }
    sigma: dict[Kind, Any] = {
        Kind.POSITION: 0.3,
        Kind.SPEED: 0.1,
        Kind.VELOCITY: 0.1,
        Kind.HEADING: 0.02,
        Kind.IMU: np.array([0.1] * 3 + [0.005] * 3),
    }
    found = []
    for kind in kinds:
        values = exact[kind].reshape(len(TIME_S), -1)
        noisy = values + sigma[kind] * rng.standard_normal(values.shape)
        found.append(Measurements(f"/{kind.name.lower()}", kind, STAMP_NS, noisy))
    return found


def _with_fault(
    measurements: Sequence[Measurements], kind: Kind, change: Callable[[np.ndarray], np.ndarray]
) -> list[Measurements]:
    return [replace(m, values=change(m.values)) if m.kind is kind else m for m in measurements]


def _judge(measurements: Sequence[Measurements], **options: object) -> JudgedSources:
    return judge_sources(measurements, lambda current: clean_and_sort_measurements_and_note(current, 0), **options)  # type: ignore[arg-type]


def _turned(*axes: Sequence[float]) -> Callable[[np.ndarray], np.ndarray]:
    matrix = np.array(axes, float)
    return lambda values: np.column_stack([values[:, :3] @ matrix.T, values[:, 3:] @ matrix.T])


def _gyro(factor: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda values: values * np.array([1.0, 1.0, 1.0, factor, factor, factor])


@pytest.mark.parametrize("kinds", [ALL, LEAN, (Kind.POSITION, Kind.SPEED), (Kind.POSITION, Kind.HEADING)])
def test_a_drive_without_a_fault_stays_as_it_is(kinds: tuple[Kind, ...]) -> None:
    judged = _judge(_drive(*kinds))
    assert judged.corrections == ()
    assert judged.contradictions == ()
    assert all(len(p.series) == len(TIME_S) for p in judged.prepared)


FAULTS = [
    ("km/h", Kind.SPEED, ALL, lambda v: 3.6 * v),
    ("mph", Kind.SPEED, ALL, lambda v: v / 0.44704),
    ("knots", Kind.SPEED, (Kind.POSITION, Kind.SPEED), lambda v: v * 3600.0 / 1852.0),
    ("m/s-read-as-km/h", Kind.SPEED, ALL, lambda v: v / 3.6),
    ("reversed", Kind.SPEED, ALL, lambda v: -v),
    ("km/h+reversed", Kind.SPEED, ALL, lambda v: -3.6 * v),
    ("clockwise-from-north", Kind.HEADING, ALL, lambda v: np.pi / 2.0 - v),
    ("clockwise-from-east", Kind.HEADING, ALL, lambda v: -v),
    ("from-north", Kind.HEADING, (Kind.POSITION, Kind.HEADING), lambda v: v - np.pi / 2.0),
    ("backward", Kind.HEADING, ALL, lambda v: v + np.pi),
    ("degrees", Kind.HEADING, ALL, np.degrees),
    ("gyro-reversed", Kind.IMU, LEAN, _gyro(-1.0)),
    ("gyro-reversed", Kind.IMU, ALL, _gyro(-1.0)),
    ("degrees/s", Kind.IMU, LEAN, _gyro(180.0 / np.pi)),
    ("milliradians/s", Kind.IMU, LEAN, _gyro(1000.0)),
    # x reads what points up, y what points left, z what points backward: -z is forward and x up.
    ("-z,y,x", Kind.IMU, LEAN, _turned((0, 0, 1), (0, 1, 0), (-1, 0, 0))),
    ("x,-z,y", Kind.IMU, LEAN, _turned((1, 0, 0), (0, 0, 1), (0, -1, 0))),
    ("-x,-y,z", Kind.IMU, LEAN, _turned((-1, 0, 0), (0, -1, 0), (0, 0, 1))),
    ("-y,x,z", Kind.IMU, ALL, _turned((0, 1, 0), (-1, 0, 0), (0, 0, 1))),
    ("mg", Kind.IMU, LEAN, lambda v: v * np.array([1000.0 / G, 1000.0 / G, 1000.0 / G, 1.0, 1.0, 1.0])),
    ("accel-reversed", Kind.IMU, LEAN, lambda v: v * np.array([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0])),
]


@pytest.mark.parametrize(("name", "kind", "kinds", "fault"), FAULTS, ids=[f"{f[0]}-{len(f[2])}" for f in FAULTS])
def test_a_source_that_is_wrong_in_a_known_way_is_corrected(
    name: str, kind: Kind, kinds: tuple[Kind, ...], fault: Callable[[np.ndarray], np.ndarray]
) -> None:
    right = _drive(*kinds)
    judged = _judge(_with_fault(right, kind, fault))
    assert [(each.who.kind, each.name) for each in judged.corrections] == [(kind, name)]
    assert judged.contradictions == ()
    for found, expected in zip(judged.prepared, _judge(right).prepared, strict=True):
        difference = found.series.values - expected.series.values
        if kind is Kind.HEADING and found.series.kind is kind:
            difference = (difference + np.pi) % (2.0 * np.pi) - np.pi
        np.testing.assert_allclose(difference, 0.0, atol=1e-9)


def test_a_tilted_imu_is_levelled() -> None:
    c, t = np.cos(np.radians(30.0)), np.sin(np.radians(30.0))
    # Nose up by 30 degrees: gravity reads 9.8 / 2 = 4.9 forward and 8.5 up.
    judged = _judge(_with_fault(_drive(*LEAN), Kind.IMU, _turned((c, 0, t), (0, 1, 0), (-t, 0, c))))
    assert [each.sentence_on_fault_and_undoing for each in judged.corrections] == [
        "imu (/imu) is mounted tilted by 30 degrees: levelled (gravity reads 4.9 m/s^2 across its vertical axis; "
        "--trust /imu leaves it unchanged)"
    ]
    assert judged.contradictions == ()
    for found, expected in zip(judged.prepared, _judge(_drive(*LEAN)).prepared, strict=True):
        difference = found.series.values - expected.series.values
        assert np.abs(difference - difference.mean(axis=0)).max() < 0.05  # m/s^2 and rad/s, from noise in the direction


@pytest.mark.parametrize(
    ("kinds", "degrees", "side"),
    [(LEAN, 40.0, "right"), (LEAN, -25.0, "left"), (LEAN, 10.0, "right"), (ALL, 10.0, "right"), (ALL, -10.0, "left")],
)
def test_an_imu_that_is_turned_about_the_vertical_is_turned_back(
    kinds: Sequence[Kind], degrees: float, side: str
) -> None:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    # Forward axis to the right of the car's by that angle: it reads cos times forward minus sin times left.
    judged = _judge(_with_fault(_drive(*kinds), Kind.IMU, _turned((c, -s, 0), (s, c, 0), (0, 0, 1))))
    (correction,) = judged.corrections
    told = re.match(rf"is mounted turned by (\d+) degrees to the {side} about the vertical", correction.fault)
    assert told is not None
    assert abs(float(told[1]) - abs(degrees)) <= 3.0
    assert judged.contradictions == ()


@pytest.mark.parametrize(("kinds", "degrees"), [(LEAN, 4.0), (ALL, 4.0), (ALL, 0.0)])
def test_an_imu_that_is_turned_by_less_than_shows_is_left_as_it_is(kinds: Sequence[Kind], degrees: float) -> None:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    assert _judge(_with_fault(_drive(*kinds), Kind.IMU, _turned((c, -s, 0), (s, c, 0), (0, 0, 1)))).corrections == ()


def test_fixes_are_not_turned_to_a_heading_that_is_wrong_in_one_of_several_ways() -> None:
    """On a road to the east it may count clockwise from north or from south: the fixes are no better suspects."""
    rng = np.random.default_rng(9)
    time_s, course_rad = np.arange(0.0, 15.0, 0.05), 0.0
    stamp_ns = np.rint(1e9 * time_s).astype(np.int64)
    way_m = 14.0 * time_s[:, None] * [np.cos(course_rad), np.sin(course_rad)]
    wrong_rad = np.full((len(time_s), 1), np.pi / 2.0 - course_rad)
    judged = _judge(
        [
            Measurements("/position", Kind.POSITION, stamp_ns, way_m + 0.3 * rng.standard_normal(way_m.shape)),
            Measurements("/speed", Kind.SPEED, stamp_ns, 14.0 + 0.1 * rng.standard_normal(len(time_s))),
            Measurements("/heading", Kind.HEADING, stamp_ns, wrong_rad + 0.01 * rng.standard_normal(wrong_rad.shape)),
        ]
    )
    assert judged.corrections == ()
    (found,) = judged.contradictions
    assert found.who == SourceQuantity("/heading", Kind.HEADING)
    assert found.left_out == (found.who,)


def test_the_sentence_says_what_was_wrong_what_shows_it_and_how_to_undo_it() -> None:
    judged = _judge(_with_fault(_drive(*ALL), Kind.SPEED, lambda v: 3.6 * v))
    sentence = judged.corrections[0].sentence_on_fault_and_undoing
    assert sentence.startswith("ego_speed (/speed) is in km/h, not m/s: converted (log-likelihood ratio ")
    assert sentence.endswith(" by /position, /imu; --trust /speed leaves it unchanged)")


def test_what_is_on_no_list_is_left_out_and_not_taken_for_something_else() -> None:
    judged = _judge(_with_fault(_drive(*ALL), Kind.SPEED, lambda v: 1.5 * v))
    assert judged.corrections == ()
    assert [each.who.kind for each in judged.contradictions] == [Kind.SPEED]
    assert {p.series.kind: len(p.series) for p in judged.prepared}[Kind.SPEED] == 0


def test_a_trusted_source_is_neither_corrected_nor_left_out() -> None:
    judged = _judge(_with_fault(_drive(*ALL), Kind.SPEED, lambda v: 3.6 * v), trusted={"/speed"})
    assert judged.corrections == ()
    assert judged.contradictions
    assert {p.series.kind: len(p.series) for p in judged.prepared}[Kind.SPEED] == len(TIME_S)


def test_without_looking_ahead_it_is_told_and_nothing_is_changed() -> None:
    judged = _judge(_with_fault(_drive(*ALL), Kind.SPEED, lambda v: 3.6 * v), looks_ahead=False)
    assert judged.corrections == ()
    assert [(each.who.kind, each.left_out) for each in judged.contradictions] == [(Kind.SPEED, ())]


def test_a_mirrored_map_beside_an_imu_alone_cannot_be_told_from_a_wrong_imu() -> None:
    judged = _judge(_with_fault(_drive(*LEAN), Kind.POSITION, lambda v: v[:, ::-1]))
    assert judged.corrections == ()
    assert "no third source tells which of them is wrong" in judged.contradictions[0].votes_and_left_out_sources_text


def test_a_mirrored_map_is_found_out_by_heading_and_gyroscope() -> None:
    judged = _judge(_with_fault(_drive(*ALL), Kind.POSITION, lambda v: v[:, ::-1]))
    assert [(each.who.kind, each.name) for each in judged.corrections] == [(Kind.POSITION, "north-east")]


def _standing_drive() -> list[Measurements]:
    """The made drive, which then stands for 20 s."""
    n = 400
    found = []
    rng = np.random.default_rng(5)
    for m in _drive(*ALL):
        last = np.zeros(6) if m.kind is Kind.IMU else m.values[-1]
        if m.kind is Kind.SPEED:
            last = np.zeros(1)
        more = last + 0.01 * rng.standard_normal((n, m.values.shape[1]))
        if m.kind is Kind.IMU:
            more[:, 2] += G
        stamp_ns = np.concatenate([STAMP_NS, STAMP_NS[-1] + 50_000_000 * np.arange(1, n + 1)])
        found.append(Measurements(m.source, m.kind, stamp_ns, np.concatenate([m.values, more])))
    return found


def test_headings_that_are_turned_round_at_standstill_are_set_aside_and_counted() -> None:
    def flip(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[len(TIME_S) + 100 :] += np.pi
        return values

    judged = _judge(_with_fault(_standing_drive(), Kind.HEADING, flip))
    assert [(each.who.kind, each.name, each.n_set_aside) for each in judged.corrections] == [
        (Kind.HEADING, "standstill", 300)
    ]
    assert {p.series.kind: len(p.series) for p in judged.prepared}[Kind.HEADING] == len(TIME_S) + 100


@pytest.mark.parametrize("n", [0, 1, 2])
def test_an_imu_of_a_few_rows_is_no_reason_to_fail(n: int) -> None:
    few = [m.select_rows(np.arange(len(m)) < n) if m.kind is Kind.IMU else m for m in _drive(*LEAN)]
    assert _judge(few).corrections == ()


def _smooth_drive() -> list[Measurements]:
    """Heading and IMU without noise, as of a simulator: both repeat one value where the car drives on evenly."""
    window = np.hanning(102)[1:-1]  # 5 s
    accel, yaw_rate = (
        np.convolve(VALUES[kind], window / window.sum(), mode="same") for kind in (Kind.ACCEL, Kind.YAW_RATE)
    )
    yaw_rate[np.abs(yaw_rate) < 1e-6] = accel[np.abs(accel) < 1e-6] = 0.0
    zero = np.zeros(len(TIME_S))
    course = VALUES[Kind.HEADING][0] + np.cumsum(yaw_rate) * 0.05
    imu = np.column_stack([accel, VALUES[Kind.SPEED] * yaw_rate, zero + G, zero, zero, yaw_rate])
    position, speed = _drive(Kind.POSITION, Kind.SPEED)
    return [
        position,
        speed,
        Measurements("/heading", Kind.HEADING, STAMP_NS, course),
        Measurements("/imu", Kind.IMU, STAMP_NS, imu),
    ]


@pytest.mark.parametrize("turned_rad", [0.0, 2.5])
def test_sensors_without_noise_are_not_stuck_where_the_car_drives_evenly(turned_rad: float) -> None:
    """The headings from -pi to pi, with and without a jump by a whole turn."""
    wrapped = _with_fault(_smooth_drive(), Kind.HEADING, lambda v: (v + turned_rad + np.pi) % (2.0 * np.pi) - np.pi)
    corrected, corrections = set_wrong_rows_aside_and_list_them(wrapped, ())
    assert corrections == []
    assert all(np.isfinite(m.values).all() for m in corrected)


def test_a_heading_without_noise_that_is_stuck_in_a_bend_is_set_aside() -> None:
    def freeze(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[160:220] = values[160]  # the bend lasts from 8 to 12 s
        return values

    found = _judge(_with_fault(_smooth_drive(), Kind.HEADING, freeze)).corrections
    assert Kind.HEADING in [each.who.kind for each in found if each.name == "stuck"]


def test_a_row_that_is_stuck_and_turned_round_is_set_aside_once() -> None:
    """A speed of zero while the car moves makes it seem to stand; the heading is stuck meanwhile, and turned round."""

    def stop(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[400:500] = 0.0
        return values

    def freeze(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[400:500] = values[400] + np.pi
        return values

    drive = _with_fault(_with_fault(_drive(*ALL), Kind.SPEED, stop), Kind.HEADING, freeze)
    own = [each for each in _judge(drive).corrections if each.who.kind is Kind.HEADING]
    assert sum(each.n_set_aside for each in own) == 100


def test_a_speed_of_zero_while_the_fixes_move_is_set_aside_but_not_at_standstill() -> None:
    def drop(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[400:800] = 0.0  # 20 s at 6 to 14 m/s
        values[len(TIME_S) + 100 :] = 0.0  # the car stands
        return values

    judged = _judge(_with_fault(_standing_drive(), Kind.SPEED, drop))
    assert [(each.who.kind, each.name, each.n_set_aside) for each in judged.corrections] == [(Kind.SPEED, "stuck", 400)]


def test_an_imu_that_repeats_one_row_is_set_aside_for_that_time() -> None:
    def freeze(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[400:500] = values[400]
        return values

    judged = _judge(_with_fault(_drive(*LEAN), Kind.IMU, freeze))
    assert [(each.who.kind, each.name, each.n_set_aside) for each in judged.corrections] == [(Kind.IMU, "stuck", 99)]


def test_what_the_user_says_is_done_without_asking_the_log() -> None:
    corrected, told = correct_and_list_user_faults(_drive(Kind.POSITION, Kind.SPEED), {"/speed": "km/h+reversed"})
    np.testing.assert_allclose(corrected[1].values, -_drive(Kind.POSITION, Kind.SPEED)[1].values / 3.6)
    assert told[0].is_by_user
    assert told[0].sentence_on_fault_and_undoing == (
        "ego_speed (/speed) is in km/h, not m/s and has the wrong sign: converted and reversed, as --as says"
    )


@pytest.mark.parametrize("name", ["degrees+clockwise-from-north", "clockwise-from-north+degrees"])
def test_the_order_in_which_the_user_names_faults_does_not_matter(name: str) -> None:
    """Clockwise from north in degrees: east is 90, north 0, west 270."""
    m = Measurements("/heading", Kind.HEADING, np.arange(3), np.array([[90.0], [0.0], [270.0]]))
    (corrected,), _ = correct_and_list_user_faults([m], {"/heading": name})
    np.testing.assert_allclose(np.cos(corrected.values[:, 0]), [1.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(np.sin(corrected.values[:, 0]), [0.0, 1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("name", ["km/h+mph", "km/h+km/h"])
def test_two_units_of_one_source_are_refused(name: str) -> None:
    with pytest.raises(UsageError, match="/speed"):
        correct_and_list_user_faults(_drive(Kind.POSITION, Kind.SPEED), {"/speed": name})


def test_units_that_a_source_cannot_have_are_refused() -> None:
    with pytest.raises(UsageError, match="there is no such fault of /speed"):
        correct_and_list_user_faults(_drive(Kind.POSITION, Kind.SPEED), {"/speed": "clockwise-from-north"})
    with pytest.raises(UsageError, match="no unit or convention 'furlongs'"):
        parse_source_units(["/speed=furlongs"])
    with pytest.raises(UsageError, match="twice"):
        parse_source_units(["/speed=km/h", "/speed=mph"])
    with pytest.raises(UsageError, match="is not TOPIC=UNIT"):
        parse_source_units(["/speed"])


def test_every_hypothesis_is_a_map_of_its_kind_and_no_two_are_the_same() -> None:
    for kind, known in UNIT_AND_CONVENTION_HYPOTHESES_BY_KIND.items():
        width = QUANTITY_BY_KIND[kind].width
        maps = set()
        for each in known:
            matrix, offset = np.array(each.matrix), np.array(each.offset)
            assert matrix.shape == (width, width)
            assert offset.shape == (width,)
            assert abs(np.linalg.det(matrix)) > 0.0
            maps.add((*np.round(matrix, 9).ravel(), *np.round(offset, 9)))
        assert len(maps) == len({each.name for each in known}) == len(known)
        assert all("+" not in each.name for each in known)
        assert len(with_pairwise_combinations(known)) >= len(known)


def test_there_are_24_rotations_and_the_first_is_none() -> None:
    assert len(set(signed_axis_rotations())) == 24
    assert signed_axis_rotations()[0] == (1, 2, 3)
