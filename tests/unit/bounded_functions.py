"""Functions for a bounded process that take more than they may, or fail."""

from __future__ import annotations

import os
import signal
from typing import Any

from cwcli.errors import DataError


def answer(request: dict[str, Any]) -> dict[str, Any]:
    return {"twice": 2 * request["number"]}


def take_memory(request: dict[str, Any]) -> dict[str, Any]:
    return {"n": len(bytearray(2_000_000_000))}


def take_time(request: dict[str, Any]) -> dict[str, Any]:
    while True:
        pass


def crash(request: dict[str, Any]) -> dict[str, Any]:
    os.kill(os.getpid(), signal.SIGSEGV)
    return {}


def write_much(request: dict[str, Any]) -> dict[str, Any]:
    with open(request["path"], "wb") as file:  # noqa: PTH123 - as a library would
        file.write(bytes(2_000_000))
    return {}


def fail(request: dict[str, Any]) -> dict[str, Any]:
    raise DataError("it is wrong", where="a.csv", found=("b",), hint="c")


def stumble(request: dict[str, Any]) -> dict[str, Any]:
    raise KeyError("a bug")
