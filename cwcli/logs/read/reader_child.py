"""The process that reads a bag or a database: it limits itself, converts the file to MCAP, and says how that went.

It is given open files and a request of JSON on standard input, and answers with JSON on standard output; see
`cwcli.logs.read.reader_process`, which starts it.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

from cwcli.errors import EXIT_TERMINATED, CwcliError, InputError, OutputError, UsageError
from cwcli.input import InputFile
from cwcli.logs.read.bags import convert_bag
from cwcli.logs.read.read_bounds import ReadBounds
from cwcli.logs.read.source_format import SourceFormat

CLONE_NEWNET, CLONE_NEWUSER = 0x40000000, 0x10000000
"""Flags of `unshare(2)` for a network and for users of the process's own."""
PR_SET_PDEATHSIG = 1
"""The request of `prctl(2)` for a signal when the parent ends."""
ERROR_KINDS: dict[str, type[CwcliError]] = {"input": InputError, "usage": UsageError}
"""Name of an error in the answer -> its class."""


def serve_request() -> None:
    """Read the request from standard input, convert the file, and write the answer to standard output."""
    request = json.load(sys.stdin)
    _end_with_parent(request["folder"], request["parent"])
    _leave_network()
    _limit_resources(request["limits"])
    source = SourceFormat(request["format"])
    answer: dict[str, Any] = {}
    try:
        _convert(request, source)
    except OutputError as error:
        cause = error.__cause__
        answer["error"] = _system_error(cause if isinstance(cause, OSError) else OSError(errno.EIO, ""), request)
    except CwcliError as error:
        kind = next((name for name, each in ERROR_KINDS.items() if isinstance(error, each)), "input")
        answer["error"] = {"kind": kind, "what": error.what, "where": error.where, "hint": error.hint}
    except OSError as error:
        answer["error"] = _system_error(error, request)
    except MemoryError:
        answer["error"] = {"kind": "memory"}
    answer |= {"compressions": source.compressions, "n_chunks": source.n_chunks, "notes": source.notes}
    json.dump(answer, sys.stdout)


def _system_error(error: OSError, request: dict[str, Any]) -> dict[str, Any]:
    """Return the answer for what can't be written: beyond the bound of this process, or for the system's reason."""
    is_bound = error.errno == errno.EFBIG and os.fstat(request["target"]).st_size >= request["limits"]["file"]
    return {"kind": "size"} if is_bound else {"kind": "system", "errno": error.errno}


def _convert(request: dict[str, Any], source: SourceFormat) -> None:
    if request["folder"] is not None:
        Path(request["folder"]).mkdir(mode=0o700)
        tempfile.tempdir = request["folder"]
    file = InputFile(request["file"], request["name"])
    journals = None
    if request["journals"] is not None:
        journals = [InputFile(descriptor, name) for descriptor, name in request["journals"]]
    with os.fdopen(request["target"], "wb", closefd=False) as target:
        convert_bag(file, source, journals, ReadBounds(**request["bounds"]), target)


def _limit_resources(limits: dict[str, int]) -> None:
    """Bound what this process may take; where the system has no such limit, without it.

    Args:
        limits: `memory` beyond what is in use, and `file`, in bytes; `cpu` in seconds; `files`, open at once.
    """
    try:
        import resource
    except ImportError:
        return
    wanted = {"RLIMIT_CPU": limits["cpu"], "RLIMIT_FSIZE": limits["file"], "RLIMIT_NOFILE": limits["files"]}
    wanted |= {"RLIMIT_CORE": 0, "RLIMIT_NPROC": 0}
    with suppress(OSError, ValueError, IndexError):
        n_pages = int(Path("/proc/self/statm").read_text().split()[0])
        wanted["RLIMIT_AS"] = n_pages * os.sysconf("SC_PAGE_SIZE") + limits["memory"]
    for name, value in wanted.items():
        kind = getattr(resource, name, None)
        if kind is not None:
            with suppress(OSError, ValueError):
                _, hard = resource.getrlimit(kind)
                most = value if hard == resource.RLIM_INFINITY else min(value, hard)
                # the signal of the first limit tells that it was processor time; the second one kills
                resource.setrlimit(kind, (most, most + 1 if name == "RLIMIT_CPU" and most == value else most))


def _leave_network() -> None:
    """Give up the network, where the system lets a process do so."""
    # a privileged user keeps his own name, by which the files were opened
    flags = CLONE_NEWNET | (0 if os.geteuid() == 0 else CLONE_NEWUSER)
    _call_system("unshare", flags)


def _end_with_parent(folder: str | None, parent: int) -> None:
    """Have the system end this process when its parent ends; a private folder is removed then."""

    def leave(number: int, frame: object) -> None:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
        os._exit(EXIT_TERMINATED)

    signal.signal(signal.SIGTERM, leave)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's matter
    _call_system("prctl", PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it has ended already
        os._exit(EXIT_TERMINATED)


def _call_system(name: str, *arguments: int) -> None:
    """Call a function of the C library, where there is one; its failure changes nothing."""
    if not sys.platform.startswith("linux"):
        return
    with suppress(ImportError, OSError, AttributeError):
        import ctypes

        getattr(ctypes.CDLL(None), name)(*arguments)
