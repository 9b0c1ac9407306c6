"""docs/python.md and its notebook: the example runs, and the cells have the outputs that the notebook shows."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import cwcli
from tools.notebook import NOTEBOOK, format_notebook, run_notebook

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
MAX_NOTEBOOK_BYTES = 10_000


def test_the_notebook_shows_what_its_cells_return() -> None:
    """Run `python -m tools.notebook` after a change that is meant."""
    text = NOTEBOOK.read_text(encoding="utf-8")
    assert len(text) < MAX_NOTEBOOK_BYTES
    assert format_notebook(run_notebook(json.loads(text))) == text


def test_the_notebook_has_the_form_of_version_4() -> None:
    document = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert (document["nbformat"], document["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in document["cells"]}) == len(document["cells"])
    assert {cell["cell_type"] for cell in document["cells"]} == {"code", "markdown"}


def test_the_example_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    [code] = re.findall(r"<!-- example -->\n```python\n(.*?)```\n<!-- end -->", PAGE, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    cwcli.simulate("intersection", "drive.mcap")
    exec(code.replace(".to_pandas()", ".to_pylist()"), {})  # pandas is no dependency
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "annotated.mcap",
        "drive.mcap",
        "metrics",
        "report.html",
    ]
