"""The bounded process: it limits itself, runs a function, and says how that went (`cwcli.bounded_process`).

It is given a request of JSON on standard input, and answers with JSON on standard output.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import tempfile
import traceback
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from cwcli.errors import EXIT_TERMINATED, CwcliError

CLONE_NEWNET, CLONE_NEWUSER = 0x40000000, 0x10000000
"""Flags of `unshare(2)` for a network and for users of the process's own (linux/sched.h)."""
PR_SET_PDEATHSIG = 1
"""The request of `prctl(2)` for a signal when the parent ends (linux/prctl.h)."""


def serve_request() -> None:
    """Read the request from standard input, run its function, and write the answer to standard output."""
    envelope = json.load(sys.stdin)
    module, _, name = envelope["function"].partition(":")
    function = getattr(import_module(module), name)  # what it imports is not of the file's making
    answers = os.fdopen(os.dup(1), "w")  # the function may give standard output to another file
    _end_with_parent(envelope["folder"], envelope["parent"])
    _give_up_network_access()
    _limit_resources(envelope["limits"])
    if envelope["folder"] is not None:
        Path(envelope["folder"]).mkdir(mode=0o700)
        tempfile.tempdir = envelope["folder"]
    try:
        answer: dict[str, Any] = {"answer": function(envelope["request"])}
    except CwcliError as error:
        error_fields = {"what": error.what, "where": error.where, "found": list(error.found), "hint": error.hint}
        answer = {"error": {"kind": type(error).__name__, **error_fields}}
    except BrokenPipeError:
        answer = {"error": {"kind": "pipe"}}
    except OSError as error:
        answer = {"error": {"kind": "system", "errno": error.errno}}
    except MemoryError:
        answer = {"error": {"kind": "memory"}}
    except Exception:
        answer = {"error": {"kind": "bug", "trace": traceback.format_exc()}}
    sys.stdout.flush()
    with answers:
        json.dump(answer, answers)
    os._exit(0)  # what the libraries do when Python ends is of no use, and may hang


def limit_process_and_execute_program() -> None:
    """Limit this process, and go on as the program that the arguments name (`bounded_process.command_with_limits`)."""
    envelope = json.loads(sys.argv[1])
    _end_with_parent(None, envelope["parent"])
    if envelope["has_no_network"]:
        _give_up_network_access()
    _limit_resources(envelope["limits"])
    command = sys.argv[2:]
    try:
        os.execvp(command[0], command)
    except OSError as error:
        sys.exit(f"{command[0]}: {error.strerror}")


def _limit_resources(limits: dict[str, Any]) -> None:
    """Bound what this process may take (`cwcli.bounded_process.Limits`), as far as the system has such limits."""
    try:
        import resource
    except ImportError:
        return
    limit_by_resource = {
        "RLIMIT_CPU": limits["cpu_s"],
        "RLIMIT_FSIZE": limits["file_bytes"],
        "RLIMIT_NOFILE": limits["n_files"],
    }
    limit_by_resource |= {"RLIMIT_CORE": 0} | ({} if limits["has_threads"] else {"RLIMIT_NPROC": 0})
    if limits["data_bytes"] is not None:
        limit_by_resource["RLIMIT_DATA"] = limits["data_bytes"]
    if limits["address_bytes"] is not None:
        with suppress(OSError, ValueError, IndexError):
            n_pages = int(Path("/proc/self/statm").read_text().split()[0])
            limit_by_resource["RLIMIT_AS"] = n_pages * os.sysconf("SC_PAGE_SIZE") + limits["address_bytes"]
    for name, value in limit_by_resource.items():
        kind = getattr(resource, name, None)
        if kind is not None:
            with suppress(OSError, ValueError):
                _, hard = resource.getrlimit(kind)
                most = value if hard == resource.RLIM_INFINITY else min(value, hard)
                # the signal of the first limit tells that it was processor time; the second one kills
                resource.setrlimit(kind, (most, most + 1 if name == "RLIMIT_CPU" and most == value else most))


def _give_up_network_access() -> None:
    """Give up the network, where the system lets a process do so."""
    # a privileged user keeps his own name, by which the files were opened
    flags = CLONE_NEWNET | (0 if os.geteuid() == 0 else CLONE_NEWUSER)
    _call_c_library_function("unshare", flags)


def _end_with_parent(folder: str | None, parent: int) -> None:
    """Have the system end this process when its parent ends; a private folder is removed then."""

    def remove_folder_and_exit(number: int, frame: object) -> None:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
        os._exit(EXIT_TERMINATED)

    signal.signal(signal.SIGTERM, remove_folder_and_exit)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's matter
    _call_c_library_function("prctl", PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it has ended already
        os._exit(EXIT_TERMINATED)


def _call_c_library_function(name: str, *arguments: int) -> None:
    """Call a function of the C library, where there is one; its failure changes nothing."""
    if not sys.platform.startswith("linux"):
        return
    with suppress(ImportError, OSError, AttributeError):
        import ctypes

        getattr(ctypes.CDLL(None), name)(*arguments)
