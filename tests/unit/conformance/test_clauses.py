"""The files of clauses: the numbers of the sources, and what is refused in a file."""

from __future__ import annotations

import re
import tomllib
from copy import deepcopy
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

from cwcli.conformance.clause import clause_names, load_clause, parse_clause
from cwcli.conformance.page import published_numbers_table
from cwcli.conformance.results import ClauseResult, Repetition, TrialResult
from cwcli.conformance.run import ConformConfig, run_clauses
from cwcli.conformance.verdict import Verdict
from cwcli.errors import UsageError
from tools.conformance import COLUMNS, PAGE, RULES, clause_block

SOURCE_NUMBERS: dict[str, dict[str, tuple[tuple[float, ...], str]]] = {
    "nhtsa-fcw": {  # DOT HS 811 501
        "subject-speed": ((45,), "mph"),
        "slower-speed": ((20,), "mph"),
        "following-gap": ((30,), "m"),
        "lead-deceleration": ((0.3,), "g"),
        "ttc-stopped": ((2.1,), "s"),
        "ttc-decelerating": ((2.4,), "s"),
        "ttc-slower": ((2.0,), "s"),
    },
    "un-r152": {  # M1, maximum mass; pedestrians below
        "speeds": ((10, 20, 30, 40, 42, 45, 50, 55, 60), "km/h"),
        "impact-speeds": ((0, 0, 0, 0, 10, 15, 25, 30, 35), "km/h"),
        "pedestrian-speeds": ((20, 30, 35, 40, 45, 50, 55, 60), "km/h"),
        "pedestrian-impact-speeds": ((0, 0, 20, 25, 30, 35, 40, 45), "km/h"),
        "lead-time": ((0.8,), "s"),
        "braking": ((5.0,), "m/s^2"),
        "false-speed": ((50,), "km/h"),
    },
    "un-r131": {  # above 8 t
        "speeds": ((40, 50, 60, 70, 80, 90, 100), "km/h"),
        "impact-speeds": ((0, 0, 0, 0, 28, 42, 54), "km/h"),
        "lead-time": ((0.8,), "s"),
        "braking": ((4.0,), "m/s^2"),
        "false-speed": ((50,), "km/h"),
    },
    "iso-15623": {
        "reaction-time": ((0.8,), "s"),
        "required-deceleration": ((0.68,), "g"),
        "longest-ttc": ((4.0,), "s"),
    },
    "iso-17361": {},  # nothing in it is checked in the source
    "un-r130": {
        "speed": ((65,), "km/h"),
        "rates": ((0.1, -0.1, 0.3, -0.3, 0.5, -0.5, 0.8, -0.8), "m/s"),
        "latest-outside": ((0.3,), "m"),
    },
    "un-r157-cut-in": {},  # the criterion itself is in `control.driver_models`
    "fmvss-127": {},
    "euro-ncap-c2c": {
        "standing-speeds": ((10, 15, 20, 25, 30, 35, 40, 45, 50), "km/h"),
        "moving-speeds": ((30, 35, 40, 45, 50, 55, 60, 65, 70, 75, 80), "km/h"),
        "slower-speed": ((20,), "km/h"),
        "braking-speed": ((50,), "km/h"),
        "braking-gaps": ((12, 40), "m"),
        "braking-decelerations": ((2, 6), "m/s^2"),
    },
    "euro-ncap-crossing": {
        "turning-speeds": ((10, 15, 20), "km/h"),
        "oncoming-speeds": ((30, 45, 60), "km/h"),
        "straight-speeds": ((20, 40, 60), "km/h"),
        "crossing-speeds": ((20, 40, 60), "km/h"),
    },
    "etsi-101-539": {"longest-ttc": ((5,), "s")},  # 3 s is of automatic action, not of warnings
    "j2945-1": {},
}
"""Clause -> number -> values and unit, copied from the sources by hand, apart from the files."""
BRAKING_ONSET_OF_49_CFR: dict[str, tuple[tuple[float, ...], str]] = {"TOL subject-onset": ((0.15,), "g")}
TOLERANCES_OF_UN: dict[str, tuple[tuple[float, ...], str]] = {
    "TOL subject-speed": ((2,), "km/h"), "TOL other-speed": ((2,), "km/h"), "TOL lateral-offset": ((0.5,), "m"),
    "clearance": ((4.5,), "m"), **BRAKING_ONSET_OF_49_CFR,
}  # fmt: skip
OTHER_NUMBERS: dict[str, dict[str, tuple[tuple[float, ...], str]]] = {
    "nhtsa-fcw": {
        "TOL subject-speed": ((1,), "mph"), "TOL other-speed": ((1,), "mph"), "TOL lateral-offset": ((0.6,), "m"),
        "TOL gap": ((2.4,), "m"), "TOL lead-deceleration": ((0.03,), "g"), "TOL lead-onset": ((0.05,), "g"),
        **BRAKING_ONSET_OF_49_CFR,
    },
    "fmvss-127": {
        "pedestrian-walks": ((5,), "km/h"), "slower-speed": ((20,), "km/h"), "braking-speed": ((50,), "km/h"),
        "braking-gaps": ((12, 40), "m"), "braking-decelerations": ((0.3, 0.5), "g"), "false-speed": ((80,), "km/h"),
        "clearance": ((4.5,), "m"), "plate-length": ((3.7,), "m"), "plate-width": ((2.4,), "m"),
        "TOL subject-speed": ((1.6,), "km/h"), "TOL other-speed": ((1.6,), "km/h"),
        "TOL lateral-offset": ((0.3,), "m"), "TOL lead-onset": ((0.05,), "g"), **BRAKING_ONSET_OF_49_CFR,
    },
    "iso-15623": {"TOL gap": ((2,), "m")},
    "iso-17361": {
        "radius": ((500,), "m"), "earliest-slow": ((0.75,), "m"), "earliest-time": ((1.5,), "s"),
        "earliest-fast": ((1.5,), "m"), "latest-outside": ((0.3,), "m"),
    },
    "un-r131": TOLERANCES_OF_UN,
    "un-r152": {"pedestrian-walks": ((5,), "km/h"), **TOLERANCES_OF_UN},
    "un-r157-cut-in": {"subject-speed": ((60,), "km/h")},
}  # fmt: skip
"""The same for the tolerances (`TOL`), and for numbers as commonly stated: a second copy, which guards the first."""
SOURCE_PAGES = {
    ("fmvss-127", "no-impact"): "S7, S8",
    ("un-r157-cut-in", "no-impact"): "5.2.5.2",
}
"""Clause and number -> the page or section of the source, where it is known."""


def document(name: str = "nhtsa-fcw") -> dict[str, Any]:
    text = (files("cwcli.conformance") / "clauses" / f"{name}.toml").read_text()
    return deepcopy(tomllib.loads(text))


@pytest.mark.parametrize("name", clause_names())
def test_the_numbers_are_those_of_the_source(name: str) -> None:
    clause = load_clause(name)
    numbers = {**clause.numbers, **{f"TOL {key}": number for key, number in clause.tolerances.items()}}
    expected = {**SOURCE_NUMBERS[name], **OTHER_NUMBERS.get(name, {})}
    assert {key: (numbers[key].values, numbers[key].unit) for key in expected} == expected
    unexplained = {
        key for key, number in numbers.items() if key not in expected and number.basis != "own" and any(number.values)
    }
    assert not unexplained, "a number that is not a choice of this project has no row in the tables"


@pytest.mark.parametrize("name", clause_names())
def test_what_is_not_checked_says_so_and_every_number_is_used(name: str) -> None:
    clause = load_clause(name)
    groups = [table.get(group, {}) for table in document(name)["trials"] for group in ("given", "demands")]
    used = {number for group in groups for number in group.values()}
    assert used == set(document(name)["numbers"])
    assert all(number.source for number in clause.numbers.values())


def test_a_page_is_given_where_the_notes_have_one_and_else_it_is_not_known() -> None:
    numbers = {(name, key): number for name in clause_names() for key, number in load_clause(name).numbers.items()}
    found = {place: number.page for place, number in numbers.items() if number.page}
    assert found == SOURCE_PAGES
    assert numbers["nhtsa-fcw", "ttc-stopped"].page_text == "not known"
    rows = {row[0]: row[4] for row in published_numbers_table(load_clause("nhtsa-fcw")).rows}
    pages = [rows[name] for name in ("ttc-stopped", "tolerance of gap", "brake-ramp")]
    assert pages == ["not known", "not known", "choice of cwcli"]


def test_numbers_are_called_published_only_if_one_was_read_in_its_source() -> None:
    words = {name: load_clause(name).basis_text.removeprefix("numbers ") for name in clause_names()}
    for name, text in words.items():
        bases = {number["basis"] for number in document(name)["numbers"].values()}
        assert (text == "as published") is ("read" in bases), name
        assert (text == "chosen here") is (bases == {"own"}), name
    assert (words["iso-17361"], words["un-r130"]) == ("as commonly stated",) * 2
    assert words["j2945-1"] == "chosen here"
    assert "definition of its TTC as commonly stated" in load_clause("nhtsa-fcw").numbers["ttc-decelerating"].source
    assert load_clause("iso-15623").tolerances["gap"].basis == "own", "2 m are of the warning distance in the source"


def test_the_published_table_has_every_clause_with_its_basis_and_as_many_trials_as_its_file() -> None:
    block = PAGE.read_text(encoding="utf-8").partition("<!-- clauses -->")[2].partition("<!-- end -->")[0]
    block, _, failures = block.partition("What the default fails")
    head, _, *rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in block.strip().splitlines()]
    assert tuple(head) == COLUMNS
    assert [row[0] for row in rows] == list(clause_names())
    for row in rows:
        clause = load_clause(row[0])
        assert f"numbers {row[1]}" == clause.basis_text
        assert int(row[2]) >= clause.n_repetitions  # more with --seeds
        assert (f"| {row[0]} |" in failures) == row[3].startswith("fail"), row[0]
        judged = [cell for cell in row[3:] if cell != "-"]
        assert judged
        assert all(f" of {len(clause.trials)}," in f"{cell}," for cell in judged), row[0]


def test_the_trial_of_a_cut_in_has_the_criterion_s_time() -> None:
    """UN R157, 5.2.5.2: v_rel / (2 * 6 m/s^2) + 0.35 s, and the 0.6 s that the clause's reading adds."""
    for trial in load_clause("un-r157-cut-in").trials:
        closing_mps = trial.given["host_speed"] - trial.given["other_speed"]
        assert trial.given["ttc_at_cut_in"] == pytest.approx(closing_mps / 12.0 + 0.35 + 0.6, abs=0.006)


def test_five_of_seven_is_a_share_of_other_numbers_of_seeds() -> None:
    clause = load_clause("nhtsa-fcw")
    assert [clause.required_passes(n) for n in (1, 2, 7, 14, 20)] == [1, 2, 5, 10, 15]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["numbers"]["ttc-stopped"].update(value=float("nan")), "ttc-stopped.value is nan"),
        (lambda d: d["numbers"]["subject-speed"].update(value=900), "permitted: -156 to 156 mph"),
        (lambda d: d["numbers"]["ttc-stopped"].update(value=0), "permitted: more than 0, at most 60 s"),
        (lambda d: d["numbers"]["brake-ramp"].update(value=-0.5), "permitted: 0 to 60 s"),
        (lambda d: d["numbers"]["subject-speed"].update(unit="furlong"), "unit is 'furlong'"),
        (lambda d: d["numbers"]["subject-speed"].update(basis="sure"), "basis is 'sure'"),
        (lambda d: d["numbers"]["subject-speed"].pop("source"), "source is missing"),
        (lambda d: d["tolerances"]["gap"].update(value=-2.0), "permitted: more than 0"),
        (lambda d: d["tolerances"]["gap"].update(value="wide"), "gap.value is 'wide'"),
        (lambda d: d["trials"][0].update(scene="aproach"), "no scene 'aproach'"),
        (lambda d: d["trials"][0].update(judge="oracle"), "no judge 'oracle'"),
        (lambda d: d["trials"][0]["given"].update(host_speed="speed"), "the number 'speed', which is not defined"),
        (lambda d: d["trials"][0]["given"].update(color="subject-speed"), "given.color is unknown"),
        (lambda d: d["trials"][0]["given"].pop("host_speed"), "given.host_speed is missing"),
        (lambda d: d.update(repetitions={"n": 5, "required": 7}), "1 <= required <= n"),
        (lambda d: d.update(trial=[]), "trial is unknown"),
        (lambda d: d["trials"].append(d["trials"][0]), "two trials are called"),
        (lambda d: d.update(policy="hope"), "policy is 'hope'"),
        (lambda d: d.update(grade=["fine"]), "grade is ['fine']"),
        (lambda d: d.update(trials=3), "trials is 3; permitted: tables"),
        (lambda d: d.update(left_out=5), "left_out is 5; permitted: a table"),
        (lambda d: d["numbers"]["subject-speed"].update(unit=["mph"]), "unit is ['mph']"),
        (lambda d: d["numbers"]["subject-speed"].update(basis=["read"]), "basis is ['read']"),
        (lambda d: d["trials"][0].update(scene=["approach"]), "no scene ['approach']"),
        (lambda d: d["trials"][0].update(name="a\x1b[31m"), "permitted: printable characters"),
        (lambda d: d.update(title="a\x00"), "title is 'a\\x00'; permitted: printable characters"),
        (lambda d: d.update(reading="two\nlines\x07"), "permitted: printable characters"),
        (lambda d: d.update(left_out={"a\nb": "why"}), "permitted: printable characters"),
        (lambda d: d["numbers"]["brake-ramp"].update(source="a\tb"), "numbers.brake-ramp.source is 'a\\tb'"),
        (lambda d: d["trials"][0].update(judge="--init--"), "no judge '--init--'"),
        (lambda d: d["trials"][0]["given"].update(host_speed=["subject-speed"]), "which is not defined"),
        (lambda d: d["trials"][0]["given"].update(host_speed="ttc-stopped"), "given.host_speed has the unit 's'"),
        (lambda d: d["trials"][0]["demands"].update(ttc="subject-speed"), "demands.ttc has the unit 'mph'"),
        (lambda d: d["trials"][0]["demands"].update(mercy="ttc-stopped"), "demands.mercy is unknown"),
        (
            lambda d: d["trials"][0].update(judge="warned-by", demands={"to_contact": "ttc-stopped"}),
            "demands.to_contact has the unit 's'",
        ),
        (
            lambda d: d["trials"][0].update(judge="lane-line", demands={"latest_outside": "ttc-stopped"}),
            "demands.latest_outside has the unit 's'",
        ),
        (lambda d: d["numbers"]["brake-ramp"].update(value=0), "brake-ramp.value is 0"),
        (lambda d: d["tolerances"].update(gapp=d["tolerances"]["gap"]), "tolerances.gapp is unknown"),
        (lambda d: d["tolerances"]["gap"].update(unit="s"), "tolerances.gap.unit is 's'"),
        (lambda d: d["tolerances"]["gap"].update(value=[1.0, 2.0]), "permitted: one number, at most 20 m"),
        (lambda d: d["tolerances"]["gap"].update(value=400.0), "permitted: one number, at most 20 m"),
    ],
)
def test_nonsense_in_a_file_is_refused_with_its_place(change: Any, words: str) -> None:
    broken = document()
    change(broken)
    with pytest.raises(UsageError, match=re.escape(words)) as caught:
        parse_clause(broken, "mine")
    assert caught.value.where == "mine.toml"


def test_an_unknown_clause_names_the_closest_one() -> None:
    with pytest.raises(UsageError) as caught:
        load_clause("nhtsa-fwc")
    assert caught.value.hint == "did you mean nhtsa-fcw?"


def test_two_clauses_of_one_name_are_refused_as_no_output_could_tell_them_apart(tmp_path: Path) -> None:
    text = (files("cwcli.conformance") / "clauses" / "nhtsa-fcw.toml").read_text()
    path = tmp_path / "nhtsa-fcw.toml"
    path.write_text(text)
    with pytest.raises(UsageError, match="two clauses are called nhtsa-fcw") as caught:
        run_clauses(["nhtsa-fcw", str(path)], ConformConfig(jobs=1))
    assert caught.value.found == ("nhtsa-fcw", str(path))
    path.rename(tmp_path / "a\x07b.toml")
    with pytest.raises(UsageError, match="the file's name is"):
        load_clause(str(tmp_path / "a\x07b.toml"))


def test_rows_of_clauses_that_were_not_run_anew_stay_in_the_published_table() -> None:
    def result(name: str, margin: float) -> ClauseResult:
        clause = load_clause(name)
        trials = tuple(
            TrialResult(each, (Repetition("0", Verdict(margin, "s", "moved")),), 1) for each in clause.trials
        )
        return ClauseResult(clause, trials, 1, {})

    def block(margin_by_clause: dict[str, float], before: str = "") -> str:
        results = [result(name, margin) for name, margin in margin_by_clause.items()]
        return clause_block(dict.fromkeys(RULES, results), before)

    both = block({"nhtsa-fcw": -0.5, "etsi-101-539": -0.25})
    again = block({"nhtsa-fcw": 0.5}, both)
    assert block({"nhtsa-fcw": -0.5}, again) == both, "in the order of names, whichever was run last"
    assert block({"etsi-101-539": -0.25}, block({"nhtsa-fcw": 0.5})) == again
    kept = {line for line in both.splitlines() if line.startswith("| etsi-101-539 |")}
    assert len(kept) == 1 + 3, "its row, and its failed trials"
    assert {line for line in again.splitlines() if line.startswith("| etsi-101-539 |")} == kept
    (row,) = (line for line in again.splitlines() if line.startswith("| nhtsa-fcw |"))
    assert row.count("pass, 3 of 3, +0.50 s") == len(RULES)
    gone = both.replace("etsi-101-539", "no-longer-a-clause")
    assert "no-longer-a-clause" not in block({"nhtsa-fcw": 0.5}, gone)


def test_impossible_physics_in_a_file_of_the_users_is_refused_before_anything_runs(tmp_path: Path) -> None:
    text = (files("cwcli.conformance") / "clauses" / "nhtsa-fcw.toml").read_text()
    path = tmp_path / "mine.toml"
    path.write_text(text.replace("slower-speed = { value = 20", "slower-speed = { value = 60"))
    with pytest.raises(UsageError, match="lead vehicle slower: an impossible trial"):
        run_clauses([str(path)], ConformConfig(jobs=1))
