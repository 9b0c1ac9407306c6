"""Numbers at the axes of a drawing."""

from __future__ import annotations

from cwcli.report.svg import _axis_number_text


def test_a_value_that_rounds_to_zero_has_no_sign() -> None:
    assert [_axis_number_text(value, 20.0) for value in (-0.3, -0.0, -0.7)] == ["0", "0", "-1"]
