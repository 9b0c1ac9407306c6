"""`cwcli conform`: its digest, its exit codes, its documents, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from tests.cli.conftest import Run

QUICK = ("--jobs", "1")


def test_a_clause_that_fails_leaves_with_1_and_a_digest(cwcli: Run, tmp_path: Path) -> None:
    done = cwcli(
        "conform", "etsi-101-539", *QUICK, "--junit", "j.xml", "--markdown", "m.md", "--html", "p.html", "--details"
    )
    assert done.returncode == 1, done.stderr.decode()
    lines = done.stdout.decode().splitlines()
    digest = lines[: lines.index("")]
    assert digest[0] == "etsi-101-539: fail (numbers as published; rule cwcli, nominal)"
    assert len(digest) <= 12
    assert max(map(len, digest)) <= 80
    assert "LCRW, slower vehicle                     fail          0 of 1" in done.stdout.decode()
    assert "certif" not in done.stdout.decode()
    assert "ETSI TS 101 539" in done.stdout.decode()
    suite = ET.parse(tmp_path / "j.xml").getroot()[0]
    assert (suite.get("name"), suite.get("tests"), suite.get("failures")) == ("etsi-101-539", "3", "2")
    assert "<svg" in (tmp_path / "p.html").read_text()
    page = (tmp_path / "m.md").read_text()
    assert "| LCRW, slower vehicle | fail | 0 of 1 | 1 |" in page


def test_a_clause_that_passes_leaves_with_0_and_numbers_from_memory_say_so(cwcli: Run) -> None:
    done = cwcli("conform", "un-r157-cut-in", *QUICK, "--json")
    assert done.returncode == 0, done.stderr.decode()
    (clause,) = json.loads(done.stdout)["clauses"]
    assert clause["outcome"] == "pass"
    basis = {number["name"]: number["basis"] for number in clause["numbers"]}
    assert basis["subject-speed"] == "as commonly stated, not checked"
    assert {trial["outcome"] for trial in clause["trials"]} == {"pass"}


def test_the_number_of_processes_and_of_other_seeds_changes_nothing(cwcli: Run) -> None:
    def margins(*arguments: str) -> list[list[float]]:
        (clause,) = json.loads(cwcli("conform", "etsi-101-539", "--json", *arguments).stdout)["clauses"]
        return [[each["margin"] for each in trial["repetitions"]] for trial in clause["trials"]]

    two = margins("--seeds", "2", "--jobs", "2")
    assert two == margins("--seeds", "2", "--jobs", "1")
    assert [trial[:1] for trial in two] == margins("--seeds", "1", "--jobs", "1")


def test_a_second_run_with_a_cache_runs_nothing_and_says_the_same(cwcli: Run, tmp_path: Path) -> None:
    first = cwcli("conform", "etsi-101-539", *QUICK, "--json", "--cache", "kept")
    (kept,) = (tmp_path / "kept").iterdir()
    assert len(kept.read_text().splitlines()) == 3
    second = cwcli("conform", "etsi-101-539", *QUICK, "--json", "--cache", "kept")
    assert second.stdout == first.stdout
    assert len(kept.read_text().splitlines()) == 3
    refused = cwcli("conform", "etsi-101-539", "--cache", "kept", "--log", "drive.mcap")
    assert refused.returncode == 2
    assert "--cache" in refused.stderr.decode()


def test_a_longer_horizon_warns_earlier(cwcli: Run) -> None:
    done = cwcli("conform", "etsi-101-539", *QUICK, "--horizon", "4")
    assert done.returncode == 0, done.stdout.decode()
    assert "horizon 4 s" in done.stdout.decode()


def test_the_list_names_every_clause_with_its_trials(cwcli: Run) -> None:
    done = cwcli("conform", "--list", "--json")
    assert done.returncode == 0
    trials = {row["name"]: row["trials"] for row in json.loads(done.stdout)["clauses"]}
    assert trials["nhtsa-fcw"] == 3
    assert trials["euro-ncap-c2c"] == 45 + 55 + 4


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ((), 2, "conform needs the name of a clause"),
        (("nhtsa",), 2, "did you mean nhtsa-fcw?"),
        (("nhtsa-fcw", "--seeds", "0"), 2, "--seeds 0: permitted are 1 to 1000"),
        (("nhtsa-fcw", "--policy", "ful"), 2, "did you mean full?"),
        (("nhtsa-fcw", "--grade", "norminal"), 2, "did you mean nominal?"),
        (("nhtsa-fcw", "--rule", "tcc"), 2, "did you mean ttc?"),
        (("nhtsa-fcw", "--horizon", "0"), 2, "--horizon 0: permitted are 0.5 to 10 s"),
        (("nhtsa-fcw", "--system", "/fcw:data==true"), 2, "--system is for a recorded trial"),
        (("nhtsa-fcw", "--log", "no.mcap"), 3, "no.mcap"),
        (("un-r130", "--log", "no.mcap"), 2, "un-r130 has no tolerances of recorded trials"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(cwcli: Run, arguments: tuple[str, ...], code: int, words: str) -> None:
    done = cwcli("conform", *arguments, *QUICK)
    assert done.returncode == code, done.stderr.decode()
    assert words in " ".join(done.stderr.decode().split())
