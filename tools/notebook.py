"""The notebook docs/python.ipynb: its cells run in order, and their outputs are written into it. No Jupyter is needed.

python -m tools.notebook
"""

from __future__ import annotations

import ast
import contextlib
import io
import json
import os
import tempfile
from pathlib import Path
from typing import Any

NOTEBOOK = Path(__file__).parents[1] / "docs" / "python.ipynb"
"""The notebook of docs/python.md."""
Cell = dict[str, Any]


def run_cell(source: str, names: dict[str, Any]) -> list[dict[str, Any]]:
    """Run the code of a cell, and return its outputs as a notebook holds them: what it prints, then its last value.

    Args:
        source: The code.
        names: The variables of the notebook, which the cell changes.
    """
    body = ast.parse(source).body
    end = body[-1] if body else None
    last = end.value if isinstance(end, ast.Expr) else None
    if last is not None:
        body.pop()
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(ast.Module(body, []), "cell", "exec"), names)
        value = None if last is None else eval(compile(ast.Expression(last), "cell", "eval"), names)
    outputs: list[dict[str, Any]] = []
    if printed.getvalue():
        outputs.append({"name": "stdout", "output_type": "stream", "text": split_lines(printed.getvalue())})
    if value is not None:
        data = {"text/plain": split_lines(repr(value))}
        outputs.append({"data": data, "execution_count": None, "metadata": {}, "output_type": "execute_result"})
    return outputs


def split_lines(text: str) -> list[str]:
    """Split a text as notebooks store it: lines with their ends."""
    return text.splitlines(keepends=True)


def run_notebook(document: dict[str, Any]) -> dict[str, Any]:
    """Return the notebook with the outputs and numbers of its code cells; it runs in an empty folder."""
    names: dict[str, Any] = {}
    cells: list[Cell] = []
    count = 0
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            for cell in document["cells"]:
                if cell["cell_type"] != "code":
                    cells.append(cell)
                    continue
                count += 1
                outputs = run_cell("".join(cell["source"]), names)
                for output in outputs:
                    if "execution_count" in output:
                        output["execution_count"] = count
                cells.append({**cell, "execution_count": count, "outputs": outputs})
        finally:
            os.chdir(here)
    return {**document, "cells": cells}


def format_notebook(document: dict[str, Any]) -> str:
    """Format a notebook as Jupyter writes it."""
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    NOTEBOOK.write_text(
        format_notebook(run_notebook(json.loads(NOTEBOOK.read_text(encoding="utf-8")))), encoding="utf-8"
    )
