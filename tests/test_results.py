"""Numbers in the docs are those of the result files, and a wrong one is found, wherever it stands."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from tools.results import __main__ as command
from tools.results.markers import MARKER, fill_markers, unmarked_numbers
from tools.results.pages import DOCS, MEASURED_SECTIONS, PAPER_PAGES, page_faults, picture_faults
from tools.results.result_file import (
    RESULTS,
    ResultFile,
    Value,
    faults_of_small_run,
    read_result_file,
    write_result_file,
)
from tools.results.studies import STUDIES, Measured, Study

PLANTED_PAGES = (*PAPER_PAGES, *(page for page in MEASURED_SECTIONS if page != "performance.md"))
"""Pages in which a wrong number is planted: all but the page that has bounds alone."""


@pytest.fixture
def docs(tmp_path: Path) -> Path:
    """A copy of the measured pages and of the result files."""
    for page in (*PAPER_PAGES, *MEASURED_SECTIONS):
        (tmp_path / page).parent.mkdir(exist_ok=True)
        shutil.copy(DOCS / page, tmp_path / page)
    shutil.copytree(RESULTS, tmp_path / "results")
    return tmp_path


def test_the_pages_are_those_of_the_result_files() -> None:
    assert page_faults() == []


def test_each_result_file_has_a_study_and_says_how_it_was_measured() -> None:
    assert {path.stem for path in RESULTS.glob("*.json")} == set(STUDIES)
    for name, study in STUDIES.items():
        result = read_result_file(name)
        assert (result.command, result.seeds, result.small_seeds) == (study.command, study.seeds, study.small_seeds)
        assert re.fullmatch(r"20\d\d-\d\d-\d\d", result.date)
        assert result.version
        assert result.values


@pytest.mark.parametrize("page", PLANTED_PAGES)
def test_a_wrong_number_in_a_page_is_found(page: str, docs: Path) -> None:
    text = (docs / page).read_text(encoding="utf-8")
    if page in PAPER_PAGES:
        found = re.search(r"\| (\d\.\d{3}) ", text)
        assert found is not None
        wrong = text[: found.start(1)] + "9.999" + text[found.end(1) :]
    else:
        marked = MARKER.search(text)
        assert marked is not None
        wrong = text[: marked.start("shown")] + "99.9" + text[marked.end("shown") :]
    (docs / page).write_text(wrong, encoding="utf-8")
    (fault,) = page_faults(docs)
    assert fault.startswith(f"{page}: ")


@pytest.mark.parametrize("page", MEASURED_SECTIONS)
def test_a_number_without_a_marker_is_refused(page: str, docs: Path) -> None:
    text = (docs / page).read_text(encoding="utf-8")
    heading = (*MEASURED_SECTIONS[page], text.splitlines()[0].lstrip("# "))[0]
    at = re.search(rf"(?m)^#+ {re.escape(heading)}$", text)
    assert at is not None
    (docs / page).write_text(text[: at.end()] + "\n\nIt takes 3.7 s.\n" + text[at.end() :], encoding="utf-8")
    assert [fault for fault in page_faults(docs) if "no marker: 3.7" in fault]


def test_the_pictures_of_the_papers_are_of_the_runs_that_gave_the_numbers(tmp_path: Path) -> None:
    assert picture_faults() == []
    shutil.copytree(RESULTS, tmp_path / "results")
    shutil.copytree(DOCS / "papers" / "figures", tmp_path / "papers" / "figures")
    pictures = tmp_path / "papers" / "figures"
    shutil.copy(pictures / "xiang2019" / "fig-7.png", pictures / "xiang2019" / "fig-8.png")
    (pictures / "song2016" / "fig-9.png").unlink()
    (pictures / "zhang2011" / "fig-20.png").write_bytes(b"")
    assert [fault.partition(":")[0] for fault in picture_faults(tmp_path)] == [
        "papers/figures/song2016/fig-9.png",
        "papers/figures/xiang2019/fig-8.png",
        "papers/figures/zhang2011/fig-20.png",
    ]


def result(**values: Value) -> ResultFile:
    return ResultFile("a", "command", 100, 4, "2026-01-01", "0.1.0", values)


def test_a_marker_shows_value_end_factor_and_format() -> None:
    known = result(speed=Value(0.12345, 0.1, 0.15, 0.12), share=Value(0.934))
    text = "?<!--=a/speed--> from ?<!--=a/speed@low;.2f-->, 7<!--=a/share;*100.0f--> %"
    filled = fill_markers(text, lambda name: known)
    assert MARKER.sub(lambda match: match["shown"], filled) == "0.123 from 0.10, 93 %"
    assert fill_markers(filled, lambda name: known) == filled
    with pytest.raises(KeyError):
        fill_markers("1<!--=a/height-->", lambda name: known)


def test_what_counts_as_a_number_of_a_measured_section() -> None:
    text = (
        "# Page\n\n5 apples\n\n## Measured\n\n| 2.5 s ahead | b |\n|---|---|\n| `3` | 4<!--=a/b--> |\n"
        "song2016 in [warning 7](x.md), `0.5 m`\n\n    cwcli run 6\n"
    )
    assert list(unmarked_numbers(text, ("Measured",))) == []
    assert list(unmarked_numbers(text + "or 8.5 %\n", ("Measured",))) == ["8.5: or 8.5 %"]
    assert list(unmarked_numbers(text, ())) == ["5: 5 apples"]
    with pytest.raises(ValueError, match="no heading 'Results'"):
        list(unmarked_numbers(text, ("Results",)))


def test_a_moved_number_of_the_small_set_is_found_and_noise_is_not() -> None:
    stored = result(
        error=Value(1.0, 0.9, 1.1, 1.2), count=Value(3.0, small=3.0), word=Value(text="0110"), nothing=Value()
    )
    good: dict[str, float | str | None] = {"error": 1.29, "count": 3.0, "word": "0110", "nothing": None}
    assert faults_of_small_run(stored, good) == []
    wrong_values: dict[str, float | str | None] = {"error": 1.31, "count": 3.1, "word": "0111", "nothing": 1.0}
    for key, wrong in wrong_values.items():
        assert len(faults_of_small_run(stored, {**good, key: wrong})) == 1, key
    assert len(faults_of_small_run(stored, {"error": 1.2, "word": "0110"})) == 1  # one is lost
    assert faults_of_small_run(stored, {"error": 1.2, "count": 3.0, "word": "0110"}) == []  # of the whole set only


def test_a_wrong_number_of_the_whole_set_contradicts_the_small_one() -> None:
    stored = result(error=Value(2.9, 2.8, 3.0, 1.2))  # half intervals of 0.1 at 100 seeds: 0.5 at 4
    (fault,) = faults_of_small_run(stored, {"error": 1.2})
    assert "which the small set does not support" in fault


def test_a_result_file_is_read_as_it_was_written(tmp_path: Path) -> None:
    written = replace(result(error=Value(1.0, 0.9, 1.1, 1.2), word=Value(text="0110")), more={"note": "4 seeds"})
    write_result_file(written, tmp_path)
    assert read_result_file("a", tmp_path) == written


def test_a_study_that_fails_keeps_its_file_and_the_others_are_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(_: int) -> Measured:
        raise RuntimeError("no frames")

    studies = {
        "first": Study("command", fail, 1, 1),
        "second": Study("command", lambda seeds: Measured({"error": (float(seeds), 0.5, 1.5)}), 2, 1),
    }
    monkeypatch.setattr(command, "STUDIES", studies)
    write_result_file(replace(result(error=Value(7.0)), name="first"), tmp_path)
    assert command.measure_all(["first", "second"], tmp_path) == [
        "first: not measured, its file is as it was: no frames"
    ]
    assert read_result_file("first", tmp_path).values["error"].value == 7.0
    assert read_result_file("second", tmp_path).values["error"] == Value(2.0, 0.5, 1.5, 1.0)
    assert "RuntimeError" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["true-states"])
def test_a_small_set_gives_the_numbers_of_its_file(name: str) -> None:
    """The other studies take longer: `python -m tools.results --check --small`."""
    found = STUDIES[name].run(STUDIES[name].small_seeds).values
    now = {key: each if isinstance(each, str) else each[0] for key, each in found.items()}
    assert faults_of_small_run(read_result_file(name), now) == []
