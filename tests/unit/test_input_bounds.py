"""The bound of each input that is no log, one row each as in docs/reliability.md: told in one line, nothing written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cwcli.cli.main import run_command_line
from cwcli.errors import UsageError
from cwcli.importing.bounded_xml import MAX_BYTES_WITHOUT_TAG, MAX_ELEMENT_DEPTH, MAX_ELEMENTS_INSIDE_KEPT_ONE
from cwcli.signals.can import list_dbc_signal_names

LOG = str(Path(__file__).parents[2] / "sample_logs" / "straight.mcap")
HEAD = '<?xml version="1.0"?><gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>'
POINT = '<trkpt lat="1" lon="2"><time>2024-01-01T00:00:00Z</time>{}</trkpt>'
TAIL = "</trkseg></trk></gpx>"
N_LAUGHS = 12


def large(path: Path) -> None:
    """17 MB of zeros, which take no room on the disk."""
    with path.open("wb") as file:
        file.truncate(17_000_000)


def laughs(path: Path) -> None:
    """Ten of each in the next one: 10^12 characters."""
    entities = "".join(f'<!ENTITY e{k} "{f"&e{k - 1};" * 10 if k else "ha"}">' for k in range(N_LAUGHS))
    text = HEAD.replace("<gpx", f"<!DOCTYPE gpx [{entities}]><gpx")
    path.write_text(text + POINT.format(f"<name>&e{N_LAUGHS - 1};</name>") + TAIL)


def deep(path: Path) -> None:
    path.write_text(HEAD + POINT.format("<a>" * MAX_ELEMENT_DEPTH + "</a>" * MAX_ELEMENT_DEPTH) + TAIL)


def wide(path: Path) -> None:
    path.write_text(HEAD + POINT.format("<a/>" * (MAX_ELEMENTS_INSIDE_KEPT_ONE + 1)) + TAIL)


def quiet(path: Path) -> None:
    path.write_text(HEAD + POINT.format("<name>" + "x" * (MAX_BYTES_WITHOUT_TAG + 200_000)) + TAIL)


def outside(path: Path) -> None:
    """A file that a document names from outside."""
    text = HEAD.replace("<gpx", '<!DOCTYPE gpx [<!ENTITY e SYSTEM "file:///etc/hostname">]><gpx')
    path.write_text(text + POINT.format("<name>&e;</name>") + TAIL)


def nested_toml(path: Path) -> None:
    path.write_text("a = " + "[" * 100_000)


def dotted_toml(path: Path) -> None:
    path.write_text(".".join("a" * 50_000) + " = 1\n")


ROWS: dict[str, tuple[str, Callable[[Path], None], tuple[str, ...], str]] = {
    "configuration": ("c.toml", large, ("info", LOG, "--config", "FILE"), "more than 16 MB"),
    "configuration, nested": ("c.toml", nested_toml, ("info", LOG, "--config", "FILE"), "nested too deeply"),
    "configuration, dotted": ("c.toml", dotted_toml, ("info", LOG, "--config", "FILE"), "more than 64 parts"),
    "calibration": ("c.toml", large, ("estimate", LOG, "--calibration", "FILE"), "more than 16 MB"),
    "calibration, nested": ("c.toml", nested_toml, ("estimate", LOG, "--calibration", "FILE"), "nested too deeply"),
    "contract": ("c.toml", large, ("info", LOG, "--expect", "FILE"), "more than 16 MB"),
    "scenario": ("s.toml", large, ("simulate", "FILE", "-o", "OUT"), "more than 16 MB"),
    "vehicle": ("v.toml", large, ("observe", LOG, "--vehicle", "FILE"), "more than 16 MB"),
    "GPX, entities": ("t.gpx", laughs, ("import", "FILE", "-o", "OUT"), "the XML is damaged"),
    "GPX, deep": ("t.gpx", deep, ("import", "FILE", "-o", "OUT"), "nested too deep"),
    "GPX, wide": ("t.gpx", wide, ("import", "FILE", "-o", "OUT"), "one has too many"),
    "GPX, a long text": ("t.gpx", quiet, ("import", "FILE", "-o", "OUT"), "bytes without an element"),
    "GPX, another file": ("t.gpx", outside, ("import", "FILE", "-o", "OUT"), "the XML is damaged"),
}
"""Input -> its file's name, its maker, the command, and a word of the error."""


def test_bound_of_a_dbc_file(tmp_path: Path) -> None:
    large(tmp_path / "d.dbc")
    with pytest.raises(UsageError, match="more than 16 MB"):
        list_dbc_signal_names([str(tmp_path / "d.dbc")])


@pytest.mark.parametrize("row", ROWS)
def test_bound_of_an_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], row: str
) -> None:
    name, make, command, words = ROWS[row]
    monkeypatch.chdir(tmp_path)
    make(tmp_path / name)
    arguments = [{"FILE": name, "OUT": "out.mcap"}.get(each, each) for each in command]
    assert run_command_line(arguments) in (2, 3, 5)
    said = capsys.readouterr().err
    assert said.startswith("error: ") and "Traceback" not in said
    assert any(word in said for word in words.split("|")), said
    assert [each.name for each in tmp_path.iterdir()] == [name]
