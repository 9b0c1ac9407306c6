"""The registry of inputs names builders that exist, and binding channels imports none of them."""

from __future__ import annotations

import subprocess
import sys

from cwcli.signals import inputs
from cwcli.signals.input_rows import load_from_signals


def test_every_named_builder_exists() -> None:
    wanted = [
        cell.cell_contents
        for entries in inputs.INPUTS.values()
        for entry in entries
        for cell in (getattr(entry.build, "__closure__", None) or ())
    ]
    assert len(wanted) > 40
    for name in wanted:
        dotted = name if "." in name else f"v2x.{name}"
        place = (
            "" if dotted.startswith(("j2735.", "etsi.", "cpm.", "sdsm.", "denm.", "osi.", "radio.")) else "builders."
        )
        assert load_from_signals(place + dotted) is not None


def test_fields_of_every_input_can_be_looked_up() -> None:
    v2x = [entry for name, entries in inputs.INPUTS.items() if "BSM" in name or "CAM" in name for entry in entries]
    assert len(v2x) >= 16
    for entry in v2x:
        assert all(len(leaves) > 10 for leaves in entry.fields.values())


def test_binding_imports_no_numpy() -> None:
    code = "import sys, cwcli.channels.binding; assert 'numpy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
