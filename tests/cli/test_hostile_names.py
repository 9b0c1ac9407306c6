"""Names and texts of a log, of files and of options reach a terminal only escaped, whichever command prints them."""

from __future__ import annotations

import json
import os
import re
import shutil
import unicodedata
from pathlib import Path
from typing import Any

import pytest
from mcap.writer import Writer

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_BUG, EXIT_CODES
from tests.cli.conftest import SAMPLES

MARK = "FORGED"
"""Follows a line break in each hostile name: printed raw, it would begin a line of its own."""
HOSTILE = f"h\x1b]0;t\x07\x1b[31m\u202e\u2066\u200f\x9b2J\r\n{MARK}\u2028"
LONG_NAME = "/long/" + "n" * 20_000 + HOSTILE
ESCAPED_LINE_FEEDS = ("\\n", "\\x0a", "\\u000a", "_")
"""How a line feed may be printed: escaped, or replaced in the name of a folder."""
MAX_PRINTED_BYTES = 400_000
"""Most that a command may print; the log holds one topic of 20,000 characters. Chosen by hand."""
T0_NS = 1_700_000_000_000_000_000
OWN_STATION, OTHER_STATION = f"own{HOSTILE}", f"other{HOSTILE}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of hostile files: a drive, one cut short, one without any signal, a text file, the drive annotated."""
    path = tmp_path_factory.mktemp("hostile")
    write_drive(path / file_name("drive"))
    data = (path / file_name("drive")).read_bytes()
    (path / file_name("cut")).write_bytes(data[: len(data) // 2])
    write_drive(path / file_name("empty"), n=0)
    (path / file_name("text")).write_text(f"no log {HOSTILE}")
    ego = f"ego_position=/{HOSTILE}/fix"
    code = run_command_line(
        [
            *("run", str(path / file_name("drive")), "-o", str(path / file_name("annotated")), "--quiet"),
            *("--topic", ego),
        ]
    )
    assert code == 0
    return path


def file_name(kind: str) -> str:
    """The name of a file: no slash, and a byte that is no UTF-8."""
    return os.fsdecode(os.fsencode(f"{kind}{HOSTILE}") + b"\xff.mcap")


def write_drive(path: Path, n: int = 100) -> None:
    """Fixes and V2X messages, 10 s; every name that a log can hold is hostile."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile=HOSTILE, library=HOSTILE)
        fix, bsm, odd, speed, long_name = (
            writer.register_channel(topic, "json", writer.register_schema(schema, "jsonschema", b"{}"))
            for topic, schema in (
                (f"/{HOSTILE}/fix", "foxglove.LocationFix"),
                (f"/{HOSTILE}/bsm", "BasicSafetyMessage"),
                (f"/{HOSTILE}/odd", f"odd/{HOSTILE}"),
                (f"/{HOSTILE}/tf", "foxglove.FrameTransform"),
                (LONG_NAME, f"long/{'s' * 20_000}"),
            )
        )
        for k in range(n):
            time_ns = T0_NS + k * 100_000_000
            stamp = {"sec": time_ns // 10**9, "nsec": time_ns % 10**9}
            place = {"latitude": 51.0 + 1e-5 * k, "longitude": 13.7, "altitude": 100.0}
            messages: list[tuple[int, Any]] = [
                (fix, {"timestamp": stamp, "frame_id": HOSTILE, **place}),
                (odd, {HOSTILE: k, "name": HOSTILE}),
                (long_name, {"x": k}),
                (speed, {"timestamp": stamp, "parent_frame_id": HOSTILE, "child_frame_id": f"c{HOSTILE}"}),
            ]
            for station, lane_deg in ((OWN_STATION, 0.0), (OTHER_STATION, 1e-4)):
                core = {
                    "msgCnt": k, "id": station, "secMark": (time_ns // 10**6) % 60_000,
                    "lat": round((51.0 + 1e-5 * k) * 1e7), "long": round((13.7 + lane_deg) * 1e7), "elev": 1000,
                    "speed": 556, "heading": 0,
                }  # fmt: skip
                messages.append((bsm, {"coreData": core}))
            for channel, message in messages:
                writer.add_message(channel, time_ns, json.dumps(message).encode(), time_ns)
        writer.add_attachment(T0_NS, T0_NS, HOSTILE, "text/plain", b"x")
        writer.add_metadata(HOSTILE, {HOSTILE: HOSTILE})
        writer.finish()


def is_unsafe(char: str) -> bool:
    """Whether a character moves the cursor, reorders the line or is no text; a line feed is judged by `MARK`."""
    return char not in "\n\t" and unicodedata.category(char) in ("Cc", "Cf", "Cs", "Zl", "Zp")


def check_printed(data: bytes) -> None:
    """Check what a command printed.

    Raises:
        AssertionError: A name in it was not escaped, or was not cut.
    """
    text = data.decode("utf-8", "surrogateescape")
    unsafe = {char for char in text if is_unsafe(char)}
    assert not unsafe, (sorted(unsafe), text[:3000])
    lines = text.split("\n")
    for above, line in zip(["", *lines], lines, strict=False):  # a table may wrap there, behind the escaped line break
        first_cell = re.split(r"\s{2,}", above.strip())[0]
        assert not line.lstrip().startswith(MARK) or first_cell.endswith(ESCAPED_LINE_FEEDS), text[:3000]
    assert len(data) < MAX_PRINTED_BYTES, len(data)


def test_the_check_finds_what_is_not_escaped() -> None:
    for raw in (HOSTILE, f"a\n{MARK}", "\x1b", "\u202e", "\r", "\u2028", "\udcff", "x" * MAX_PRINTED_BYTES):
        with pytest.raises(AssertionError):
            check_printed(raw.encode("utf-8", "surrogateescape"))
    check_printed(f"a\\n{MARK} and \\r\\n\n  {MARK}".encode())


COMMANDS = [
    ("info", "drive"),
    ("info", "drive", "--json"),
    ("info", "drive", "--doctor"),
    ("info", "drive", "--doctor", "--json"),
    ("info", "annotated", "--doctor"),
    ("info", "drive", "annotated", "--as-one"),
    ("estimate", "drive", "-o", "OUT"),
    ("estimate", "drive", "-o", "OUT", "--topic", f"ego_position=/{HOSTILE}/fix", "--ego-station", OWN_STATION),
    ("estimate", "drive", "-o", "OUT", "--topic", f"ego_position=/{HOSTILE}/bsm"),
    ("estimate", "drive", "--metrics", "OUT.csv", "--json"),
    ("estimate", "drive", "--strict", "-o", "OUT"),
    ("track", "drive", "-o", "OUT"),
    ("lanes", "drive", "-o", "OUT"),
    ("observe", "drive", "-o", "OUT"),
    ("predict", "annotated", "-o", "OUT", "--replace"),
    ("predict", "annotated", "-o", "OUT"),
    ("predict-lane", "drive", "-o", "OUT"),
    ("warn", "annotated", "-o", "OUT", "--replace"),
    ("warn", "annotated", "-o", "OUT", "--replace", "--json"),
    ("warn-targets", "drive", "-o", "OUT"),
    ("warn-lane", "drive", "-o", "OUT"),
    ("measure", "annotated", "-o", "OUT", "--replace"),
    ("control", "annotated", "-o", "OUT", "--replace"),
    ("cut", "drive", "--start", "1", "-o", "OUT"),
    ("find", "annotated", "all", "--clips", "OUT", "-o", "OUT.csv"),
    ("find", "annotated", "all", "--json"),
    ("find", "annotated", "ego.speed_mps > 0 m/s"),
    ("cut", "drive", "--topics", f"/{HOSTILE}/*", "-o", "OUT"),
    ("join", "drive", "GOOD", "-o", "OUT"),
    ("join", "GOOD", "drive", "-o", "OUT", "--id", HOSTILE),
    ("join", "drive", "drive", "-o", "OUT"),
    ("calibrate", "drive", "GOOD", "-o", "OUT.toml"),
    ("calibrate", "drive", "--json"),
    ("run", "drive", "-o", "OUT"),
    ("run", "drive", "-o", "OUT", "--metrics-dir", "OUT", "--json"),
    ("run", "drive", "text", "-d", "OUT", "--jobs", "1"),
    ("run", "drive", "text", "-d", "OUT", "--jobs", "1", "--json"),
    ("evaluate", "annotated"),
    ("evaluate", "annotated", "--json"),
    ("evaluate", "annotated", "--markdown", "OUT.md", "--junit", "OUT.xml", "--metrics", "OUT.csv"),
    ("evaluate", "annotated", "--topic", f"warning=/{HOSTILE}/odd:x==1"),
    ("compare", "annotated", "annotated"),
    ("compare", "annotated", "drive"),
    ("compare", "annotated", "annotated", "--json"),
    ("report", "annotated", "-o", "OUT.html"),
    ("export", "annotated", "-o", "OUT.csv"),
    ("export", "annotated", "-o", "OUT.gpx", "--what", "remote"),
    ("export", "annotated", "-o", "OUT.tum", "--what", "remote", "--id", HOSTILE),
    ("export", "annotated", "-o", "OUT.kml", "--what", "remote"),
    ("export", "annotated", "-o", "OUT.geojson"),
    ("export", "annotated", "-o", "OUT.mcap", "--format", "ros2"),
    ("export", "annotated", "-o", "OUT.mcap", "--format", "osi"),
    ("plot", "annotated", "-o", "OUT.svg"),
    ("view", "nothing"),
    ("layout", "annotated", "-o", "OUT.json"),
]
"""Commands; a word that names a file of the folder stands for it, OUT for a new hostile one."""
FAULTY = [
    ("info",),
    ("estimate", "-o", "OUT"),
    ("run", "-o", "OUT"),
    ("run", "-d", "OUT"),
    ("evaluate",),
    ("report", "-o", "OUT.html"),
    ("export", "-o", "OUT.csv"),
    ("plot", "-o", "OUT.svg"),
    ("layout", "-o", "OUT.json"),
    ("compare", "annotated"),
    ("cut", "--end", "1", "-o", "OUT"),
    ("join", "drive", "-o", "OUT"),
    ("calibrate", "-o", "OUT.toml"),
    ("predict", "-o", "OUT"),
    ("warn", "-o", "OUT"),
]
"""Commands that are tried on each of the folder's other files."""
OPTIONS = [
    (),
    ("info", "drive", "--X"),
    ("info", "drive", "--config", "X"),
    ("info", "drive", "--expect", "X"),
    ("info", "drive", "--dbc", "X"),
    ("info", "drive", "--start", "X"),
    ("info", "drive", "--map", "X"),
    ("info", "drive", "--map", "ego_speed=/X:X*X"),
    ("info", "drive", "--topic", "X"),
    ("info", "drive", "--topic", "ego_speed=/X"),
    ("info", "drive", "--topic", "X=/X"),
    ("estimate", "drive", "--calibration", "X", "-o", "OUT"),
    ("estimate", "drive", "-o", "X/X"),
    ("estimate", "drive", "--model", "X", "-o", "OUT"),
    ("estimate", "drive", "--ego-station", "X", "--topic", f"ego_position=/{HOSTILE}/bsm", "-o", "OUT"),
    ("run", "drive", "--stage", "X", "-d", "OUT"),
    ("run", "drive", "--gate", "X", "-d", "OUT"),
    ("run", "drive", "-d", "drive"),
    ("evaluate", "annotated", "--truth", "X"),
    ("evaluate", "annotated", "--gate", "X"),
    ("warn", "annotated", "--rule", "X", "-o", "OUT"),
    ("warn", "annotated", "--conflict", "X", "-o", "OUT"),
    ("export", "annotated", "--what", "X"),
    ("export", "annotated", "--format", "X"),
    ("export", "annotated", "-o", "OUT.X"),
    ("export", "annotated", "--what", "remote", "--id", "X"),
    ("plot", "annotated", "X", "-o", "OUT.svg"),
    ("simulate", "X", "-o", "OUT"),
    ("config", "X"),
    ("reproduce", "X"),
    ("report", "annotated", "-o", "OUT.html", "--tiles", "X"),
]
"""Wrong values of options; X stands for the hostile text."""


class Bench:
    """Runs commands in this process and checks what they print."""

    def __init__(self, folder: Path, work: Path, capfd: pytest.CaptureFixture[str]) -> None:
        self.folder, self.work, self._capfd = folder, work, capfd

    def run(self, *words: str) -> None:
        names = {kind: str(self.folder / file_name(kind)) for kind in ("drive", "cut", "empty", "text", "annotated")}
        names |= {"GOOD": str(SAMPLES / "straight.mcap"), "nothing": str(self.folder / file_name("nothing"))}
        out = str(self.work / file_name("out").removesuffix(".mcap"))
        replaced = [out + (word[3:] or ".mcap") if word.startswith("OUT") else names.get(word, word) for word in words]
        self._capfd.readouterr()
        code = run_command_line(replaced)
        out_bytes, error_bytes = (each.encode("utf-8", "surrogateescape") for each in self._capfd.readouterr())
        assert code in EXIT_CODES and code != EXIT_BUG, error_bytes
        check_printed(out_bytes)
        check_printed(error_bytes)
        shutil.rmtree(self.work)
        self.work.mkdir()


@pytest.fixture
def bench(folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Bench:
    """In an empty folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "work").mkdir()
    return Bench(folder, tmp_path / "work", capfd)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda words: ascii(" ".join(words)))
def test_a_command_escapes_every_name(bench: Bench, command: tuple[str, ...]) -> None:
    bench.run(*command)


@pytest.mark.parametrize("kind", ["cut", "empty", "text", "nothing", "drive"])
def test_an_error_about_a_file_escapes_its_name(bench: Bench, kind: str) -> None:
    for first, *rest in FAULTY:
        bench.run(first, kind, *rest)


@pytest.mark.parametrize("command", OPTIONS, ids=" ".join)
def test_an_error_about_an_option_escapes_its_value(bench: Bench, command: tuple[str, ...]) -> None:
    bench.run(*(re.sub("X", HOSTILE.replace("\\", r"\\"), word) for word in command or ("X",)))
