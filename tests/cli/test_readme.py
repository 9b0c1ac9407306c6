"""What README.md claims: its commands run, its numbers come out, and its picture is small.

Its digest and exit codes are compared in test_reference.py, its demo runs in .ci/run, and what it says of a script
without cwcli is tried in peers/test_without_cwcli.py.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path

from tests.cli.conftest import ROOT, Run

README = (ROOT / "README.md").read_text(encoding="utf-8")
MAX_PICTURE_BYTES = 120_000
"""Most bytes of the picture at the top: what a slow phone loads in a second."""


def test_the_three_commands_run(cwcli: Run, tmp_path: Path) -> None:
    block = README[README.index("<!-- three -->") :].partition("<!-- end -->")[0]
    commands = [shlex.split(line, comments=True)[1:] for line in block.splitlines() if line.startswith("    cwcli ")]
    assert [command[0] for command in commands] == ["info", "run", "report"]
    for command in commands:
        arguments = [str(ROOT / word) if word.startswith("sample_logs/") else word for word in command]
        assert cwcli(*arguments).returncode == 0
    assert (tmp_path / "report.html").read_bytes().startswith(b"<!")


def test_the_picture_is_small() -> None:
    (picture,) = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", README)
    assert (ROOT / picture).stat().st_size < MAX_PICTURE_BYTES
