"""Writes the part of TOML that configuration files need (the standard library only reads TOML)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any


def format_toml(document: Mapping[str, Any]) -> str:
    """Format a document of values, lists and tables as TOML; None becomes a comment."""
    lines = [_key_value_line(key, value) for key, value in document.items() if not isinstance(value, Mapping)]
    for name, table in document.items():
        if isinstance(table, Mapping):
            lines += ["", f"[{name}]", *(_key_value_line(key, value) for key, value in table.items())]
    return "\n".join(lines) + "\n"


def _key_value_line(key: str, value: Any) -> str:
    return f"# {key} =" if value is None else f"{key} = {_format_value(value)}"


def _format_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_format_value, value))}]"
    return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
