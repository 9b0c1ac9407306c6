"""`cwcli layout` as a process."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

Run = Callable[..., CompletedProcess[bytes]]


def test_layout_goes_to_standard_output_or_a_file(cwcli: Run, tmp_path: Path) -> None:
    printed = cwcli("layout")
    written = cwcli("layout", "-o", "cwcli.foxglove.json")
    assert (printed.returncode, printed.stderr) == (0, b"")
    assert written.returncode == 0 and b"wrote cwcli.foxglove.json" in written.stdout
    document = json.loads(printed.stdout)
    assert document == json.loads((tmp_path / "cwcli.foxglove.json").read_bytes())
    assert document["layout"] in document["configById"]


def test_layout_of_a_log_shows_its_own_fixes(cwcli: Run, intersection: Path) -> None:
    from_file = cwcli("layout", intersection)
    from_pipe = cwcli("layout", "-", input=intersection.read_bytes())
    assert from_file.stdout == from_pipe.stdout
    assert "/gps/fix" in json.loads(from_file.stdout)["configById"]["map!map"]["topicColors"]


def test_layout_refuses_what_it_must_not_overwrite_or_cannot_read(
    cwcli: Run, intersection: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "drive.mcap"
    copy.write_bytes(intersection.read_bytes())
    (tmp_path / "there.json").write_text("{}")
    codes = {
        "exists": cwcli("layout", "-o", "there.json").returncode,
        "forced": cwcli("layout", "-o", "there.json", "--force", "--json").returncode,
        "input": cwcli("layout", "drive.mcap", "-o", "drive.mcap", "--force").returncode,
        "missing": cwcli("layout", "nothing.mcap").returncode,
        "json": cwcli("layout", "--json").returncode,
    }
    assert codes == {"exists": 6, "forced": 0, "input": 6, "missing": 3, "json": 2}
    assert copy.read_bytes() == intersection.read_bytes()
