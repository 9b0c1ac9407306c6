"""`cwcli report --pdf`: Chromium prints the page, and one line says so where it does not."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

import pytest

from cwcli.cli.main import run
from cwcli.errors import EXIT_OUTPUT, EXIT_USAGE
from tests.cli.browser import browser
from tests.cli.conftest import SAMPLES


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("annotated") / "intersection.mcap"
    assert run(["run", str(SAMPLES / "intersection.mcap"), "-o", str(target), "--quiet"]) == 0
    return target


def drawn_paths(pdf: bytes) -> int:
    """Curves and lines in the pages' contents: what the figures are made of."""
    total = 0
    for stream in re.findall(rb"stream\r?\n(.*?)endstream", pdf, re.DOTALL):
        try:
            content = zlib.decompress(stream)
        except zlib.error:
            continue
        total += len(re.findall(rb"\n[-\d. ]+ l\b", content))
    return total


def test_the_printed_page_holds_its_figures(annotated: Path, tmp_path: Path) -> None:
    browser()
    assert run(["report", str(annotated), "-o", str(tmp_path / "r.pdf"), "--pdf", "--quiet"]) == 0
    pdf = (tmp_path / "r.pdf").read_bytes()
    assert pdf.startswith(b"%PDF-") and len(re.findall(rb"/Type\s*/Page\b", pdf)) >= 2
    assert drawn_paths(pdf) > 200  # 201 states a signal; a page without figures has the tables' rules alone


def test_without_a_browser_one_line_says_so(
    annotated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert run(["report", str(annotated), "-o", str(tmp_path / "r.pdf"), "--pdf"]) == EXIT_USAGE
    said = capsys.readouterr().err
    assert said.startswith("error: --pdf needs Chromium") and said.count("error: ") == 1
    assert not (tmp_path / "r.pdf").exists()


def test_a_browser_that_fails_leaves_no_file(
    annotated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "chromium"
    broken.write_text("#!/bin/sh\necho first >&2\necho no display >&2\nexit 3\n")
    broken.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    assert run(["report", str(annotated), "-o", str(tmp_path / "r.pdf"), "--pdf", "--quiet"]) == EXIT_OUTPUT
    assert "did not print the page: no display" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "r.pdf").exists()
