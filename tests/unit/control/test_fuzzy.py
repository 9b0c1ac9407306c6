"""Mamdani inference against integrals worked out by hand."""

import numpy as np
import pytest

from cwcli.control.fuzzy import FuzzySet, LinguisticVariable, MamdaniInference

ATOL = 2e-3  # the centroid is taken on 201 points of a range of 1


def test_membership_of_trapezoid_by_hand() -> None:
    trapezoid = FuzzySet(0.0, 1.0, 2.0, 4.0)
    values = np.array([-1.0, 0.0, 0.25, 1.0, 1.5, 3.0, 4.0, 9.0])
    np.testing.assert_allclose(trapezoid(values), [0.0, 0.0, 0.25, 1.0, 1.0, 0.5, 0.0, 0.0])


def test_membership_of_end_sets_reaches_beyond_the_range() -> None:
    np.testing.assert_allclose(FuzzySet(0.0, 0.0, 1.0, 2.0)(np.array([-5.0, 0.0, 1.5])), [1.0, 1.0, 0.5])
    np.testing.assert_allclose(FuzzySet(1.0, 2.0, 3.0, 3.0)(np.array([1.5, 3.0, 8.0])), [0.5, 1.0, 1.0])


UNIT = LinguisticVariable(0.0, 1.0, {"low": FuzzySet(0.0, 0.0, 0.0, 1.0), "high": FuzzySet(0.0, 1.0, 1.0, 1.0)})
OUTPUT = LinguisticVariable(0.0, 1.0, {"low": FuzzySet(0.0, 0.0, 0.0, 1.0), "high": FuzzySet(0.0, 1.0, 1.0, 1.0)})
RULES = {("low", "low"): "low", ("low", "high"): "low", ("high", "low"): "low", ("high", "high"): "high"}


def test_centroid_of_one_full_triangle_is_a_third() -> None:
    # Only ("low", "low") fires, with strength 1: the set 1 - z on [0, 1] has its centroid at 1/3.
    out = MamdaniInference(UNIT, UNIT, OUTPUT, RULES)(np.zeros(1), np.zeros(1))
    np.testing.assert_allclose(out, [1.0 / 3.0], atol=ATOL)


def test_centroid_of_clipped_sets_by_hand() -> None:
    # a = b = 0.5: both consequents are clipped at 0.5. The union is 0.5 on all of [0, 1]: min(1 - z, .5)
    # and min(z, .5) together never fall below 0.5. Its centroid is 0.5 by symmetry.
    np.testing.assert_allclose(
        MamdaniInference(UNIT, UNIT, OUTPUT, RULES)(np.full(1, 0.5), np.full(1, 0.5)), [0.5], atol=ATOL
    )
    # a = 1, b = 0.25: "high" is clipped at 0.25, "low" at 0.75. Union: 0.75 on [0, .25], 1 - z on [.25, .75], 0.25 on
    # [.75, 1]. Area 0.1875 + 0.25 + 0.0625 = 0.5. Moment 0.0234375 + (0.25 - 0.1354167) + 0.0546875 = 0.1927083.
    out = MamdaniInference(UNIT, UNIT, OUTPUT, RULES)(np.ones(1), np.full(1, 0.25))
    np.testing.assert_allclose(out, [0.1927083 / 0.5], atol=ATOL)


def test_rule_table_with_a_hole_is_refused() -> None:
    with pytest.raises(ValueError, match="high"):
        MamdaniInference(UNIT, UNIT, OUTPUT, {("low", "low"): "low"})


def test_rule_with_an_unknown_consequent_is_refused() -> None:
    with pytest.raises(ValueError, match="rule table"):
        MamdaniInference(UNIT, UNIT, OUTPUT, {**RULES, ("low", "low"): "medium"})
