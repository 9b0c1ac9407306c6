"""What corrections change in the summary: counts of messages, and the hint on `--as`.

Read is used, rejected and set aside; repaired is a part of used.
"""

from __future__ import annotations

from cwcli.estimation import Kind
from cwcli.estimation.contradiction import SourceQuantity
from cwcli.estimation.correction import Correction
from cwcli.pipeline.result import InputMessageCount
from cwcli.stages.estimate import _add_corrections_to_input_counts, _hint_for_online_states

SPEED = SourceQuantity("/speed", Kind.SPEED)
CONVERTED = Correction(SPEED, "km/h", "is in km/h", "converted", "evidence", n_rows=100)
STUCK = Correction(SPEED, "stuck", "is stuck", "set aside", "evidence", n_set_aside=30)


def test_rows_that_are_set_aside_are_not_repaired() -> None:
    """100 rows, 5 of them rejected; 30 of the rest are stuck and set aside: 65 are used, and those are repaired."""
    entry = InputMessageCount("/speed", "ego_speed", 100, 95, rejected={"not finite": 5})
    for corrections in ([STUCK, CONVERTED], [CONVERTED, STUCK]):
        (found,) = _add_corrections_to_input_counts([entry], corrections)
        assert (found.read, found.used) == (100, 65)
        assert found.set_aside == {"is stuck": 30}
        assert found.repaired == {"is in km/h": 65}


def test_other_topics_and_roles_count_as_before() -> None:
    entries = [InputMessageCount("/other", "ego_speed", 9, 9), InputMessageCount("/speed", "ego_position", 9, 9)]
    assert _add_corrections_to_input_counts(entries, [STUCK, CONVERTED]) == tuple(entries)


def test_one_option_corrects_all_faults_of_a_source() -> None:
    """`--as` takes a source once, and what it does not name stays as it is."""
    imu = SourceQuantity("/imu", Kind.IMU)
    found = [Correction(imu, name, "is wrong", "converted", "evidence", n_rows=9) for name in ("g", "degrees/s")]
    assert [_hint_for_online_states(each, [*found, CONVERTED]) for each in found] == [
        "; --as /imu=g+degrees/s corrects them, too"
    ] * 2
    assert _hint_for_online_states(CONVERTED, [*found, CONVERTED]) == "; --as /speed=km/h corrects them, too"


def test_a_fault_that_no_option_names_has_no_hint() -> None:
    imu = SourceQuantity("/imu", Kind.IMU)
    tilted, in_g = (Correction(imu, name, "is wrong", "mended", "evidence", n_rows=9) for name in ("tilted", "g"))
    assert _hint_for_online_states(tilted, [in_g, tilted]) == _hint_for_online_states(in_g, [in_g, tilted]) == ""
