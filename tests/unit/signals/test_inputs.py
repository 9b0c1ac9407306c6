"""The registry of inputs names builders that exist, and binding channels imports none of them."""

from __future__ import annotations

import subprocess
import sys

from cwcli.signals import inputs
from cwcli.signals.input_rows import load_attribute_of_signals


def test_every_named_builder_exists() -> None:
    own = [inputs.INPUTS_BY_SCHEMA_NAME[name] for name in inputs._BUILTIN_INPUTS]
    builds = {entry.build for entries in own for entry in entries if entry.build is not None}
    assert len(builds) > 40
    for build in builds:
        assert build.__closure__ is not None
        names = dict(zip(build.__code__.co_freevars, (cell.cell_contents for cell in build.__closure__), strict=True))
        for place in names["builder_and_first_arguments"]:
            assert load_attribute_of_signals(place) is not None


def test_fields_of_every_input_can_be_looked_up() -> None:
    v2x = [
        entry
        for name, entries in inputs.INPUTS_BY_SCHEMA_NAME.items()
        if "BSM" in name or "CAM" in name
        for entry in entries
    ]
    assert len(v2x) >= 16
    for entry in v2x:
        assert all(len(leaves) > 10 for leaves in entry.fields.values())


def test_binding_imports_no_numpy() -> None:
    code = "import sys, cwcli.channels.binding; assert 'numpy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
