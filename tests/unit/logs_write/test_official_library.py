"""The official MCAP library: what cwcli takes from it, and which commands do not wait for its import."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from cwcli.logs.format import records

SAMPLE = Path(__file__).parents[3] / "sample_logs" / "rear-end.mcap"
RUN = """
import sys
from cwcli.cli.main import run_command_line
code = run_command_line(sys.argv[1:])
print(code, sorted(name for name in sys.modules if name.partition(".")[0] == "mcap"))
"""


def run_and_list_official_modules(*arguments: str) -> str:
    """Run a command, and return its exit code and the modules of the official library that it imported."""
    done = subprocess.run([sys.executable, "-c", RUN, *arguments], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()[-1]


@pytest.mark.parametrize(
    "arguments",
    [
        ("--help",),
        ("simulate", "--help"),
        ("export", "--help"),
        ("info", str(SAMPLE)),
        ("estimate", str(SAMPLE), "-o", "out.mcap"),
        ("run", str(SAMPLE), "-o", "out.mcap"),
    ],
    ids=" ".join,
)
def test_commands_that_write_no_new_log_do_not_import_it(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its import takes a third of the instructions of `cwcli info`."""
    monkeypatch.chdir(tmp_path)
    assert run_and_list_official_modules(*arguments) == "0 []"


def test_a_new_log_is_written_by_it(tmp_path: Path) -> None:
    """So the list above can be other than empty."""
    assert "mcap.writer" in run_and_list_official_modules("simulate", "rear-end", "-o", str(tmp_path / "new.mcap"))


def test_opcodes_and_magic_bytes_are_the_official_ones() -> None:
    ours = {name: value for name, value in vars(records.Opcode).items() if name.isupper()}
    assert ours == {each.name: each.value for each in Opcode}
    assert records.MCAP_MAGIC == MCAP0_MAGIC
