"""What is public: the names of `cwcli.__all__` and their signatures. A change here is a change for users."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import cwcli
import cwcli.report.views

ROOT = Path(__file__).parents[3]
MAX_NAMES = 15

SIGNATURES = """\
decoder_factory() -> DecoderFactory
open(source: Source, *, topics: Mapping[str, str] | None = None, dbc: Sequence[str] = (), start: float | str | None = \
None, end: float | str | None = None, recover: bool = False, limits: Limits = ...) -> Log
report(source: str | Path | Result, target: str | Path, *, gates: Sequence[str] = (), topics: Sequence[str] = (), \
recover: bool = False, force: bool = False, progress: Callable[[str], None] | None = None) -> Path
simulate(scenario: str | Path, target: str | Path, *, seed: int | None = None, values: Mapping[str, object] | None = \
None, weather: str | None = None, actors: str | Path | None = None, force: bool = False) -> Path
Limits(max_chunk_bytes: int = 256000000, max_input_bytes: int = 64000000000, max_ratio: float = 64.0, timeout_s: float \
= 60.0) -> None
Log.close(self) -> None
Log.run(self, *stages: str, options: StageOptions | None = None, clock: Literal['stamp', 'log'] = 'stamp', \
ego_station: str | None = None, calibration: str | Path | None = None, strict: bool = False, progress: \
Callable[[str], None] | None = None) -> Result
Log.table(self, topic: str) -> pa.Table
Result.save(self, target: str | Path, *, tables: str | Path | None = None, replace: bool = False, split: bool = False, \
force: bool = False) -> list[Path]
Result.table(self, topic: str) -> pa.Table
"""
DOCUMENTED_PROPERTIES = ("ego", "others", "targets", "warnings", "measures", "doubts", "scores", "summary", "topics")


def signature_text(name: str) -> str:
    """`open(source: str, ...) -> Log` of a public function or a method of a public class."""
    owner, _, method = name.rpartition(".")
    function = getattr(getattr(cwcli, owner), method) if owner else getattr(cwcli, name)
    signature = inspect.signature(function)
    if "limits" in signature.parameters:  # the class's own line shows the values
        limits = signature.parameters["limits"].replace(default=...)
        signature = signature.replace(parameters=[*list(signature.parameters.values())[:-1], limits])
    return name + re.sub(r"(?:: |-> )(\'[^\']+\'|\"[^\"]+\")|Ellipsis", _unquote, str(signature))


def _unquote(found: re.Match[str]) -> str:
    """An annotation without the quotes that the postponed evaluation of annotations gives it."""
    return "..." if found[0] == "Ellipsis" else found[0].replace(found[1], found[1][1:-1])


def test_the_signatures_of_public_names_are_those_that_are_promised() -> None:
    names = [line.partition("(")[0] for line in SIGNATURES.splitlines()]
    assert [signature_text(name) for name in names] == SIGNATURES.splitlines()


def test_every_public_name_exists_and_there_are_few() -> None:
    assert len(cwcli.__all__) <= MAX_NAMES
    assert sorted(cwcli.__all__) == list(cwcli.__all__)
    assert all(hasattr(cwcli, name) for name in cwcli.__all__)
    assert set(cwcli.__all__) <= set(dir(cwcli))


def test_the_page_names_all_that_is_public() -> None:
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    names = [name for name in cwcli.__all__ if name != "__version__"]
    methods = [line.partition("(")[0].partition(".")[2] for line in SIGNATURES.splitlines() if "." in line[:20]]
    missing = [name for name in (*names, *DOCUMENTED_PROPERTIES, *methods) if name not in page and name != "__init__"]
    assert missing == []


def test_the_properties_are_there_and_have_a_docstring() -> None:
    for name in DOCUMENTED_PROPERTIES:
        assert getattr(cwcli.Result, name).__doc__


def test_importing_cwcli_imports_nothing_else() -> None:
    """A module more is time that every start pays; the standard library's `typing` alone would take 5 ms."""
    code = "import sys, types; before = {*sys.modules}; import cwcli; print(sorted({*sys.modules} - before))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout == "['cwcli', 'cwcli.version']\n"


def test_a_room_with_the_name_of_a_function_is_both() -> None:
    report: Any = cwcli.report
    assert report.views.__name__ == "cwcli.report.views"
    assert callable(report)
    assert callable(cwcli.simulate)
    code = "import cwcli.report; from cwcli.simulate import sensor_log; import cwcli.simulate.v2x as v; "
    code += "print(callable(cwcli.report), callable(cwcli.simulate), v.__name__, sensor_log.__name__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout == "True True cwcli.simulate.v2x cwcli.simulate.sensor_log\n"


def test_a_name_that_does_not_exist_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'opne'"):
        cwcli.opne  # type: ignore[attr-defined]  # noqa: B018 - the access is the test
