"""`cwcli report --pdf`: Chromium prints the page, and one line says so where it does not."""

from __future__ import annotations

import os
import re
import tempfile
import time
import zlib
from contextlib import suppress
from importlib.resources import files
from pathlib import Path

import pytest

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_NOT_WRITTEN, EXIT_USAGE, OutputError
from cwcli.report import pdf as pdf_module
from cwcli.report.pdf import print_html_to_pdf
from tests.cli.browser import browser
from tests.cli.conftest import SAMPLES


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("annotated") / "intersection.mcap"
    assert run_command_line(["run", str(SAMPLES / "intersection.mcap"), "-o", str(target), "--quiet"]) == 0
    return target


def page_contents(pdf: bytes) -> list[bytes]:
    """What is drawn: the unpacked streams with operators of text or lines."""
    found = []
    for stream in re.findall(rb"stream\r?\n(.*?)endstream", pdf, re.DOTALL):
        with suppress(zlib.error):  # fonts and pictures
            found.append(zlib.decompress(stream))
    return [content for content in found if re.search(rb"\n(BT|S|f)\n", content)]


def longest_line(pdf: bytes) -> int:
    """Most segments of one line in the pages' contents: a signal's curve has hundreds, what else is printed few."""
    lines = (line for content in page_contents(pdf) for line in re.findall(rb" m\n((?:[-\d. ]+ l\n)+)", content))
    return max((line.count(b" l\n") for line in lines), default=0)


def test_the_printed_page_holds_its_figures(annotated: Path, tmp_path: Path) -> None:
    browser()
    assert run_command_line(["report", str(annotated), "-o", str(tmp_path / "r.pdf"), "--pdf", "--quiet"]) == 0
    pdf = (tmp_path / "r.pdf").read_bytes()
    assert pdf.startswith(b"%PDF-") and len(re.findall(rb"/Type\s*/Page\b", pdf)) >= 2
    assert run_command_line(["report", str(annotated), "-o", str(tmp_path / "r.html"), "--quiet"]) == 0
    inert = re.sub(rb"<script\b.*?</script>", b"", (tmp_path / "r.html").read_bytes(), flags=re.DOTALL)
    assert longest_line(print_html_to_pdf(inert, browser())) < 20
    assert longest_line(pdf) >= 200  # 201 states a signal


def test_what_a_reader_would_use_is_not_printed() -> None:
    """The fields that find rows: their words and frames are drawn, unless the page's style leaves them out."""
    style = files("cwcli.report").joinpath("assets", "report.css").read_text(encoding="utf-8")
    page, field = f"<!doctype html><style>{style}</style><p>x</p>", '<input value="y">'
    alone, found, other = (
        page_contents(print_html_to_pdf((page + field).encode(), browser()))
        for field in ("", f'<div class="filters">{field}</div>', f"<div>{field}</div>")
    )
    assert found == alone != other


def fake_browser(folder: Path, script: str) -> str:
    path = folder / "chromium"
    path.write_text(
        "#!/bin/bash\nfor each; do case $each in --print-to-pdf=*) target=${each#*=};; esac; done\n" + script
    )
    path.chmod(0o755)
    return str(path)


def test_children_that_outlive_the_browser_end_with_it(tmp_path: Path) -> None:
    """One keeps making files in the profile's folder and holds the browser's output open."""
    browser = fake_browser(
        tmp_path,
        f"""
        folder=$(dirname "$target")/profile; mkdir "$folder"
        (while true; do mkdir -p "$folder"; echo x > "$folder/$RANDOM"; date > {tmp_path}/alive; done) &
        while [ ! -e {tmp_path}/alive ]; do sleep 0.01; done
        echo '%PDF-' > "$target"
        """,
    )
    assert print_html_to_pdf(b"<p>x</p>", browser) == b"%PDF-\n"  # a wait for the children would end with an error
    (tmp_path / "alive").unlink()
    time.sleep(0.3)
    assert not (tmp_path / "alive").exists()


def test_a_browser_that_hangs_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pdf_module, "PRINT_TIMEOUT_S", 0.2)
    monkeypatch.setattr(pdf_module, "PRINT_TIMEOUT_PER_FIGURE_S", 0.4)
    figures = b'<script type="text/plain" id="log-0-map"></script>' * 2
    path = fake_browser(tmp_path, "sleep 1000\n")
    with pytest.raises(OutputError) as caught:
        print_html_to_pdf(figures, path)
    assert str(caught.value) == f"{path} did not print the page: it took longer than 1 s"


def test_the_browser_has_limits_and_no_network(tmp_path: Path) -> None:
    """It prints what it may take instead of a page."""
    browser = fake_browser(
        tmp_path, "(ulimit -c; ulimit -n; ulimit -t; ulimit -f; tail -n +3 /proc/net/dev | cut -d: -f1) > $target\n"
    )
    n_core, n_files, cpu_s, file_kb, *networks = print_html_to_pdf(b"<p>x</p>", browser).decode().split()
    assert (n_core, int(n_files), int(cpu_s)) == ("0", 4096, 960)
    assert int(file_kb) == 2_000_000_000 // 1024
    if os.geteuid() == 0:
        assert networks in (["lo"], [])


def test_a_browser_that_takes_more_than_its_limits_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pdf_module, "MAX_BROWSER_FILE_BYTES", 100_000)
    path = fake_browser(tmp_path, 'head -c 300000 /dev/zero > "$target"\n')
    with pytest.raises(OutputError, match="did not print the page") as caught:
        print_html_to_pdf(b"<p>x</p>", path)
    assert "\n" not in str(caught.value)


def test_a_file_that_cannot_be_written_is_an_error_of_the_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    with pytest.raises(OutputError, match="did not print the page"):
        print_html_to_pdf(b"<p>x</p>", fake_browser(tmp_path, "true\n"))


def test_without_a_browser_one_line_says_so(
    annotated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    for more in (["--pdf"], []):
        assert run_command_line(["report", str(annotated), "-o", str(tmp_path / "r.pdf"), *more]) == EXIT_USAGE
        said = capsys.readouterr().err
        assert said.startswith("error: a PDF needs Chromium") and said.count("error: ") == 1
        assert not (tmp_path / "r.pdf").exists()


@pytest.mark.parametrize(
    ("name", "more", "said"),
    [
        ("r.md", [], "a page ends in .html, .htm or .pdf"),
        ("r.png", [], "a page ends in .html, .htm or .pdf"),
        ("r.html", ["--pdf"], "a PDF ends in .pdf"),
    ],
)
def test_a_name_of_another_format_is_refused(
    annotated: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
    more: list[str],
    said: str,
) -> None:
    monkeypatch.setattr(pdf_module, "find_browser", lambda: fake_browser(tmp_path, "true\n"))
    assert run_command_line(["report", str(annotated), "-o", str(tmp_path / name), *more]) == EXIT_USAGE
    assert said in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / name).exists()


def test_a_name_in_pdf_is_printed_without_being_asked(
    annotated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pdf_module, "find_browser", lambda: "chromium")
    monkeypatch.setattr(pdf_module, "print_html_to_pdf", lambda html, browser: b"%PDF- of the page")
    assert run_command_line(["report", str(annotated), "-o", str(tmp_path / "r.PDF"), "--quiet"]) == 0
    assert (tmp_path / "r.PDF").read_bytes() == b"%PDF- of the page"


def test_a_browser_that_fails_leaves_no_file(
    annotated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "chromium"
    broken.write_text("#!/bin/sh\necho first >&2\necho no display >&2\nexit 3\n")
    broken.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    assert (
        run_command_line(["report", str(annotated), "-o", str(tmp_path / "r.pdf"), "--pdf", "--quiet"])
        == EXIT_NOT_WRITTEN
    )
    assert "did not print the page: no display" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "r.pdf").exists()
