"""A process that has imported `cwcli` and forks for each command, so that a test does not wait for the imports again.

Each command is a process all the same: with its own folder, environment, streams, signals and exit code. Run with the
number of a socket, this module is that process.
"""

from __future__ import annotations

import atexit
import gc
import importlib
import io
import os
import pickle
import pkgutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
AT_START = (
    *("PYTHON", "LC_", "LANG", "MALLOC", "LD_", "TZ", "OMP_", "OPENBLAS_", "MKL_", "ARROW_", "NPY_", "OPENCV_"),
    *("FORCE_COLOR", "TERMINAL_WIDTH"),
)
"""Beginnings of the names of variables that Python or a library reads when it starts."""
LENGTH = struct.Struct("<q")


class WarmProcess:
    """The side of the tests; `also` names modules of other packages that are imported, too."""

    def __init__(self, *also: str) -> None:
        self._also = also
        self.environment = {name: value for name, value in os.environ.items() if not name.startswith("CWCLI_")}
        self._start()

    def _start(self) -> None:
        self._channel, far = socket.socketpair()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.cli.warm_process", str(far.fileno()), *self._also],
            cwd=ROOT,
            env=self.environment | {"PYTHONPATH": str(ROOT)},
            pass_fds=[far.fileno()],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            start_new_session=True,
        )
        far.close()

    def close(self) -> None:
        """End it."""
        self._channel.close()
        self._process.wait()

    def serves(self, environment: dict[str, str], settings: dict[str, Any]) -> bool:
        """Whether a command can be forked: only its streams are its own, and nothing that Python reads at its start."""
        names = {name for name in (*environment, *self.environment) if name.startswith(AT_START)} - {"PYTHONPATH"}
        same = all(environment.get(name) == self.environment.get(name) for name in names)
        return same and environment.get("PYTHONPATH") == str(ROOT) and not settings.keys() - {"input", "stdin"}

    def run(
        self,
        arguments: list[str],
        folder: Path,
        environment: dict[str, str],
        timeout_s: float,
        source: str = "from cwcli.cli.main import main; main()",
        **streams: Any,
    ) -> subprocess.CompletedProcess[bytes]:
        """Run a command, or other code; its output is caught, and `input` or `stdin` is as for `subprocess.run`."""
        given: bytes | None = streams.get("input")
        reads, writes = zip(*(os.pipe() for _ in range(3)), strict=True)
        stdin = streams.get("stdin")
        fds = (reads[0] if given is not None else 0 if stdin is None else stdin.fileno(), *writes[1:])
        request = pickle.dumps((source, arguments, str(folder), environment))
        socket.send_fds(self._channel, [LENGTH.pack(len(request))], fds)
        self._channel.sendall(request)
        for fd in (reads[0], *writes[1:]):
            os.close(fd)
        caught = [b"", b""]
        threads = [threading.Thread(target=_send, args=(writes[0], given or b""))]
        threads += [threading.Thread(target=_catch, args=(reads[k + 1], caught, k)) for k in range(2)]
        for thread in threads:
            thread.start()
        self._channel.settimeout(timeout_s)
        try:
            reply = self._channel.recv(LENGTH.size, socket.MSG_WAITALL)
        except TimeoutError:
            os.killpg(self._process.pid, signal.SIGKILL)
            self.close()
            self._start()  # for the tests that follow
            raise subprocess.TimeoutExpired(["cwcli", *arguments], timeout_s) from None
        assert len(reply) == LENGTH.size, "the warm process ended"
        (code,) = LENGTH.unpack(reply)
        for thread in threads:
            thread.join()
        return subprocess.CompletedProcess(["cwcli", *arguments], code, *caught)


def _send(fd: int, data: bytes) -> None:
    with suppress(BrokenPipeError), open(fd, "wb") as stream:
        stream.write(data)


def _catch(fd: int, caught: list[bytes], k: int) -> None:
    with open(fd, "rb") as stream:
        caught[k] = stream.read()


def serve(channel: socket.socket, *also: str) -> str:
    """Fork for each request until the tests are gone; returns in a child, with the code that it is to run."""
    _import_everything(also)
    while head := socket.recv_fds(channel, LENGTH.size, 3):
        data, fds = head[0], head[1]
        if not data:
            sys.exit()
        request = channel.recv(LENGTH.unpack(data)[0], socket.MSG_WAITALL)
        child = os.fork()
        if not child:
            channel.close()
            source, arguments, folder, environment = pickle.loads(request)
            _become(arguments, folder, environment, fds)
            return str(source)
        for fd in fds:
            os.close(fd)
        channel.sendall(LENGTH.pack(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])))
    sys.exit()


def _import_everything(also: tuple[str, ...]) -> None:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `cwcli` does
    import cwcli

    for module in pkgutil.walk_packages(cwcli.__path__, "cwcli."):
        if not module.name.endswith("__main__"):
            with suppress(ImportError):  # of a library that is not installed
                importlib.import_module(module.name)
    for name in also:
        importlib.import_module(name)
    assert threading.active_count() == 1
    assert tempfile.tempdir is None
    gc.freeze()  # no child's search for cycles touches what is here


def _become(arguments: list[str], folder: str, environment: dict[str, str], fds: list[int]) -> None:
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    for number, fd in enumerate(fds):
        os.dup2(fd, number)
        os.close(fd)
    sys.path[0] = folder
    sys.argv = [str(ROOT / "cwcli" / "__main__.py"), *arguments]
    for name, mode, fd in (("stdin", "rb", 0), ("stdout", "wb", 1), ("stderr", "wb", 2)):
        old = getattr(sys, name)
        new = io.TextIOWrapper(
            open(fd, mode, closefd=False),  # noqa: SIM115 - a descriptor
            encoding=old.encoding, errors=old.errors, line_buffering=fd == 2,
        )  # fmt: skip
        setattr(sys, name, new)
        setattr(sys, f"__{name}__", new)


def run_and_end(source: str) -> None:
    """Run code, and end without taking every module apart, which takes as long as a start."""
    code: Any = 0
    try:
        exec(source, {"__name__": "__main__"})
    except SystemExit as left:
        code = left.code
        if isinstance(code, str):
            print(code, file=sys.stderr)
    except BaseException:
        sys.excepthook(*sys.exc_info())
        code = 1
    threading._shutdown()  # type: ignore[attr-defined]  # waits for threads, and lets pools end theirs
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            code = 120  # as Python says it
    os._exit(code if isinstance(code, int) else 0 if code is None else 1)


if __name__ == "__main__":
    run_and_end(serve(socket.socket(fileno=int(sys.argv[1])), *sys.argv[2:]))
