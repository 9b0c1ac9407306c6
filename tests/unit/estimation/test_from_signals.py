"""Signals of a log as measurements, and which of them can be used together."""

from __future__ import annotations

import numpy as np

from cwcli.estimation.from_signals import drop_stretches_without_position_and_note
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.signals.units import NS_PER_S

T0_NS = 1_700_000_000 * NS_PER_S


def measured(source: str, kind: Kind, at_s: list[float]) -> Measurements:
    stamp_ns = T0_NS + np.round(np.array(at_s) * NS_PER_S).astype(np.int64)
    width = 2 if kind is Kind.POSITION else 1
    return Measurements(source, kind, stamp_ns, np.arange(width * len(at_s), dtype=float).reshape(-1, width))


def test_rows_in_a_stretch_without_a_position_are_left_out_and_told() -> None:
    fixes = measured("/fix", Kind.POSITION, [0.0, 1.0, 200.0])
    # -59 s belongs to the first fix, 150 s to the last; -3600 s and 80 s are more than 60 s from everything
    turned = measured("/imu", Kind.YAW_RATE, [-3600.0, -59.0, 0.5, 80.0, 150.0])
    near, notes = drop_stretches_without_position_and_note([fixes, turned], 60.0)
    assert [m.source for m in near] == ["/fix", "/imu"]
    assert near[0] is fixes
    np.testing.assert_array_equal(near[1].values[:, 0], [1.0, 2.0, 4.0])
    assert notes == ["/imu: 2 yaw rate rows lie more than 60 s from any stretch with a position, left out"]


def test_a_source_of_another_epoch_is_left_out_whole() -> None:
    fixes = measured("/fix", Kind.POSITION, [0.0, 1.0])
    near, notes = drop_stretches_without_position_and_note(
        [fixes, measured("/v", Kind.SPEED, [-1e9, -1e9 + 1.0])], 60.0
    )
    assert near == [fixes]
    assert notes == ["/v: 2 speed rows lie more than 60 s from any stretch with a position, left out"]


def test_nothing_is_left_out_of_a_drive_without_a_pause() -> None:
    given = [measured("/fix", Kind.POSITION, [30.0, 80.0]), measured("/v", Kind.SPEED, [0.0, 130.0])]
    assert drop_stretches_without_position_and_note(given, 60.0) == (given, [])
