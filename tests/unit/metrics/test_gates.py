"""Gates: the grammar, three-valued logic, and what is said of a failure."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cwcli.errors import UsageError
from cwcli.metrics.condition_parser import AndOr, Comparison, Not, Number
from cwcli.metrics.gate_syntax import (
    Aggregate,
    AnyAll,
    Name,
    Share,
    needs_single_log,
    parse_gate,
)
from cwcli.metrics.gates import FAILED_LOGS_GATE, CheckStatus, check_gates, matches_pattern
from cwcli.metrics.headline import HeadlineCollector
from cwcli.metrics.pooling import LogMetrics, metric_rows_by_name

ERROR = "ego.position_rmse_m"


def log(
    name: str, rmse: float | None = None, *, recall: tuple[float, float] | None = None, **more: float
) -> LogMetrics:
    headline = HeadlineCollector()
    if rmse is not None:
        headline.add_from_sums(ERROR, rmse**2 * 10.0, 10.0)
    if recall is not None:
        headline.add_from_sums("warnings.recall", *recall)
    for metric, value in more.items():
        headline.add_from_sums(metric.replace("__", "."), value, 1.0)
    return LogMetrics(name, metric_rows_by_name(headline.to_table()))


PIECES = [
    "a",
    "b.c",
    "x",
    "_",
    "*",
    "(",
    ")",
    "<",
    ">",
    "=",
    "!",
    "%",
    "0",
    "1.5",
    " ",
    "-",
    "'",
    "\n",
    "\x1b",
    "\u200b",
]
PIECES += ["and ", "or ", "not ", "any(", "share(", "pooled(", "p95(", "<="]
THREE = (log("a", 0.2, recall=(1, 1)), log("b", 0.4, recall=(1, 3)), log("c", 0.6, recall=(0, 0)))


def holds(gate: str, logs: tuple[LogMetrics, ...] = THREE) -> bool:
    return check_gates([gate], logs)[0].status is CheckStatus.PASSED


@pytest.mark.parametrize(
    ("text", "node"),
    [
        ("a.b_m < 0.5", Comparison((Name("a.b_m"), Number(0.5)), ("<",))),
        ("a.b_m<-.5e-1", Comparison((Name("a.b_m"), Number(-0.05)), ("<",))),
        ("90% <= share_x", Comparison((Number(0.9), Name("share_x")), ("<=",))),
        ("0.8 < x != 2", Comparison((Number(0.8), Name("x"), Number(2.0)), ("<", "!="))),
        ("prediction.ego.cj-cya.fde_2.5s_m>=1", Comparison(
            (Name("prediction.ego.cj-cya.fde_2.5s_m"), Number(1.0)), (">=",))),
        ("p95(x) == 1", Comparison((Aggregate("p95", Name("x")), Number(1.0)), ("==",))),
        ("not x > 1", Not(Comparison((Name("x"), Number(1.0)), (">",)))),
        ("not not x > 1", Comparison((Name("x"), Number(1.0)), (">",))),
        ("any(x > 1)", AnyAll("any", Comparison((Name("x"), Number(1.0)), (">",)))),
        ("share(x > 1) > 0.5", Comparison(
            (Share(Comparison((Name("x"), Number(1.0)), (">",))), Number(0.5)), (">",))),
    ],
)  # fmt: skip
def test_parse(text: str, node: object) -> None:
    assert parse_gate(text) == node


def test_and_binds_stronger_than_or() -> None:
    x, y, z = (parse_gate(f"{name} > 1") for name in "xyz")
    assert parse_gate("x > 1 or y > 1 and z > 1") == AndOr((x, AndOr((y, z), is_and=True)), is_and=False)
    assert parse_gate("(x > 1 or y > 1) and z > 1") == AndOr((AndOr((x, y), is_and=False), z), is_and=True)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "it ends"),
        ("x", "expected one of"),
        ("x <", "it ends"),
        ("x < y z", "found `z`"),
        ("1 < 2", "compares numbers only"),
        ("x < 1 and", "it ends"),
        ("(x < 1", "expected `)`"),
        ("x < 1)", "found `)`"),
        ("__import__('os').system('true') < 1", "at character 1"),
        ("x.__class__('a') < 1", "found `'a')"),
        ("x.__class__(a) < 1", "no function x.__class__"),
        ("eval(x) < 1", "no function eval"),
        ("lambda: 1", "found `: 1`"),
        ("x < 0x10", "found `x10`"),
        ("x < nan(y)", "no function nan"),
        ("mean(x < 1) < 1", "expected `)`"),
        ("mean(mean(x)) < 1", "expected a metric"),
        ("any(pooled(x) < 1)", "need a metric of a log"),
        ("a.* < b.*", "two patterns"),
        ("x = 1", "found `= 1`"),
        ("x < 1;", "found `;`"),
    ],
)
def test_what_is_no_gate_is_refused_with_the_place(text: str, said: str) -> None:
    with pytest.raises(UsageError) as error:
        parse_gate(text)
    assert said in error.value.what


def test_endless_gates_are_refused() -> None:
    with pytest.raises(UsageError, match="inside each other"):
        parse_gate("(" * 60 + "x < 1" + ")" * 60)
    with pytest.raises(UsageError, match="longer than"):
        parse_gate("x < 1 and " * 1000 + "x < 1")


@settings(max_examples=300, deadline=None)
@given(st.lists(st.sampled_from(PIECES), max_size=25).map("".join))
def test_any_text_is_parsed_or_refused(text: str) -> None:
    try:
        node = parse_gate(text)
    except UsageError:
        return
    assert isinstance(needs_single_log(node), bool)


@pytest.mark.parametrize(
    ("gate", "expected"),
    [
        (f"{ERROR} < 0.7", True),
        (f"{ERROR} < 0.6", False),
        (f"0.1 < {ERROR} <= 0.6", True),
        (f"mean({ERROR}) == 0.4", False),  # 0.4 but for rounding
        (f"0.3999 < mean({ERROR}) < 0.4001", True),
        (f"max({ERROR}) > 0.59 and min({ERROR}) < 0.21", True),
        (f"median({ERROR}) < 0.41", True),
        (f"p90({ERROR}) < 0.55", False),  # linear between 0.4 and 0.6: 0.56
        (f"p90({ERROR}) < 0.57", True),
        (f"pooled({ERROR}) < 0.43", False),  # sqrt((0.04 + 0.16 + 0.36) / 3) = 0.4320
        (f"pooled({ERROR}) < 0.4321", True),
        ("pooled(warnings.recall) == 50%", True),  # 2 of 4
        (f"any({ERROR} > 0.5)", True),
        (f"all({ERROR} > 0.5)", False),
        (f"share({ERROR} < 0.5) >= 66%", True),
        (f"share({ERROR} < 0.5) >= 67%", False),
        (f"not {ERROR} > 0.7", True),
        (f"{ERROR} < 0.3 or {ERROR} > 0.35", True),
        (f"pooled({ERROR}) < {ERROR}", False),
        ("ego.* < 0.7", True),
        ("max(ego.*) < 0.6", False),
    ],
)
def test_gates_by_hand(gate: str, expected: bool) -> None:
    assert holds(gate) is expected


def test_a_gate_on_a_log_is_asked_of_every_log() -> None:
    (result,) = check_gates([f"{ERROR} < 0.5"], THREE)
    assert [(check.log, check.status.value) for check in result.checks] == [
        ("a", "passed"), ("b", "passed"), ("c", "failed"),
    ]  # fmt: skip
    assert result.failed_checks[0].detail == "ego.position_rmse_m = 0.6000 m"


def test_a_gate_on_the_run_is_asked_once() -> None:
    (result,) = check_gates([f"max({ERROR}) < 0.5"], THREE)
    assert [(check.log, check.detail) for check in result.checks] == [("", f"max({ERROR}) = 0.6000 m over 3 logs")]


def test_a_missing_metric_fails_with_the_reason_unless_allowed() -> None:
    logs = (log("a", 0.2), log("b"))
    (result,) = check_gates([f"{ERROR} < 0.5"], logs)
    assert [(check.log, check.detail) for check in result.failed_checks] == [("b", f"{ERROR} is missing")]
    (result,) = check_gates([f"{ERROR} < 0.5"], logs, allow_missing=True)
    assert [check.status for check in result.checks] == [CheckStatus.PASSED, CheckStatus.SKIPPED]
    assert result.status is CheckStatus.PASSED


def test_a_metric_of_no_log_fails_with_the_nearest_name() -> None:
    (result,) = check_gates(["ego.positon_rmse_m < 0.5"], THREE)
    assert "did you mean ego.position_rmse_m?" in result.failed_checks[0].detail
    (result,) = check_gates(["mean(lanes.found_share) > 0.5"], THREE)
    assert result.failed_checks[0].detail == "no log has lanes.found_share"


def test_a_metric_without_a_value_is_told_from_a_missing_one() -> None:
    (result,) = check_gates(["warnings.recall > 0.2"], THREE)
    assert [(check.log, check.detail) for check in result.failed_checks] == [
        ("c", "warnings.recall has no value: there was nothing to judge")
    ]


def test_kleene_logic_lets_a_missing_metric_decide_nothing() -> None:
    assert holds(f"{ERROR} < 0.7 or lanes.found_share > 0.5")
    (result,) = check_gates([f"{ERROR} > 0.7 and lanes.found_share > 0.5"], THREE, allow_missing=True)
    assert result.status is CheckStatus.FAILED  # false, whatever the missing one is
    (result,) = check_gates(["not lanes.found_share > 0.5"], THREE, allow_missing=True)
    assert result.status is CheckStatus.SKIPPED


def test_a_failed_log_fails_what_is_asked_of_it_and_a_gate_of_its_own() -> None:
    logs = (log("a", 0.2), LogMetrics("b", error="it was cut"))
    first, second, last = check_gates([f"{ERROR} < 0.5", f"max({ERROR}) < 0.5"], logs, allow_missing=True)
    assert [check.detail for check in first.failed_checks] == ["the log failed: it was cut"]
    assert second.status is CheckStatus.PASSED
    assert (last.gate, [check.log for check in last.failed_checks]) == (FAILED_LOGS_GATE, ["b"])
    assert check_gates([], logs) == []


def test_no_logs_pass_no_gate() -> None:
    (result,) = check_gates([f"{ERROR} < 0.5"], ())
    assert result.failed_checks[0].detail == "there is no log"


@pytest.mark.parametrize(
    ("pattern", "name", "expected"),
    [
        ("a*c", "abbc", True),
        ("a*c", "ac", True),
        ("a*c", "acb", False),
        ("*.fde_*s_m", "prediction.ego.fde_2.5s_m", True),
        ("a*b*a", "aba", True),
        ("ab*ba", "aba", False),
        ("*", "", True),
        ("a", "ab", False),
    ],
)
def test_patterns(pattern: str, name: str, expected: bool) -> None:
    assert matches_pattern(pattern, name) is expected


@pytest.mark.parametrize(
    ("gate", "expected"),
    [
        ("min(measures.ttc_s) > 1", True),
        ("min(measures.ttc_s) > 1.3", False),
        ("measures.ttc_s > 1.1", True),
        ("mean(measures.ttc_s) == 1.5", True),
        ("max(measures.drac_mps2) < 6", True),
        ("measures.drac_mps2 < 5", False),
        ("min(measures.min_ttc_s) > 1", True),
        ("min(measures.drac_mps2) > 0", False),  # only the greatest value is critical, and known
        ("measures.pet_s > 0", False),
    ],
)
def test_a_measure_means_its_most_critical_value(gate: str, expected: bool) -> None:
    logs = (
        log("a", measures__min_ttc_s=1.2, measures__max_drac_mps2=3.0),
        log("b", measures__min_ttc_s=1.8, measures__max_drac_mps2=5.5),
    )
    assert holds(gate, logs) is expected
