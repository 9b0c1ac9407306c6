"""The decoders' kernels under AddressSanitizer and UndefinedBehaviorSanitizer, in a folder beside the ones in use."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
KERNELS = ("cdr", "json_walk", "message_scan", "metadata_scan", "protobuf")
"""Those that see the bytes of a log; the others see arrays that cwcli has made."""
FLAGS = ("-O0", "-g", "-fPIC", "-shared", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
LIBRARIES = ("libasan.so", "libubsan.so")
OPTIONS = {
    # The interpreter keeps memory on purpose, and an allocation that fails is a Python error.
    "ASAN_OPTIONS": "detect_leaks=0:allocator_may_return_null=1:abort_on_error=1:handle_segv=1",
    "UBSAN_OPTIONS": "print_stacktrace=1:abort_on_error=1",
    "PYTHONMALLOC": "malloc",  # small objects have blocks of their own, whose ends are known
}


def compiler() -> str:
    """The C compiler that the interpreter was built with, or `CC`."""
    return os.environ.get("CC") or str(sysconfig.get_config_var("CC") or "cc").split()[0]


def build(folder: Path) -> None:
    """Compile the kernels into a folder, side by side.

    Raises:
        RuntimeError: Cython or the compiler refuses.
    """
    (folder / "c").mkdir(parents=True, exist_ok=True)
    sources = [str(ROOT / "cwcli" / "kernels" / f"{name}.pyx") for name in KERNELS]
    outputs = [folder / "c" / f"{name}.c" for name in KERNELS]
    cython = [
        [sys.executable, "-m", "cython", "-3", "-I", str(ROOT), "-o", str(output), source]
        for source, output in zip(sources, outputs, strict=True)
    ]
    _run(cython)
    suffix, include = sysconfig.get_config_var("EXT_SUFFIX"), sysconfig.get_path("include")
    _run(
        [
            [compiler(), *FLAGS, f"-I{include}", str(output), "-o", str(folder / f"{name}{suffix}")]
            for name, output in zip(KERNELS, outputs, strict=True)
        ]
    )


def environment() -> dict[str, str]:
    """What a process needs that is to load these kernels."""
    asked = [[compiler(), f"-print-file-name={name}"] for name in LIBRARIES]
    found = [subprocess.run(each, capture_output=True, text=True, check=True).stdout.strip() for each in asked]
    return os.environ | OPTIONS | {"LD_PRELOAD": " ".join(found)}


def use(folder: Path) -> None:
    """Let this process import the kernels of a folder; to be called before anything imports them."""
    import cwcli.kernels

    cwcli.kernels.__path__.insert(0, str(folder))
    for name in KERNELS:
        module = importlib.import_module(f"cwcli.kernels.{name}")
        if not str(module.__file__).startswith(str(folder)):
            raise RuntimeError(f"{module.__file__} is not the kernel in {folder}")


def _run(commands: Sequence[Sequence[str]]) -> None:
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    running = [subprocess.Popen(each, cwd=ROOT, text=True, **streams) for each in commands]  # type: ignore[call-overload]
    for process in running:
        said, _ = process.communicate()
        if process.returncode:
            raise RuntimeError(f"{' '.join(map(str, process.args))}:\n{said}")
