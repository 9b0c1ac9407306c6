"""The process that forks workers: it imports shared modules once and talks to its parent through pipes only.

Python's own fork server listens on a socket with a name in the folder for temporary files, and a run that is killed
leaves that folder behind. This one is given its end of a pair of sockets when it starts; for each worker the parent
sends one end of another pair through it. None of them has a name, so a killed run leaves nothing.

A worker reads (function, arguments) and answers (is an error, value), pickled, until its socket is closed. It ends at
once when the pipe of which the parent alone holds the other end is closed: the parent has gone, or says so.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for

from cwcli.estimation.track import WORKER_ENVIRONMENT_VARIABLE
from cwcli.fleet.worker_call import PipeWorker, WorkerLost


class ForkServer:
    """Starts worker processes, which all end when they are stopped or when this process ends.

    Raises:
        OSError: No process can be started.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._control, far = socket.socketpair()
        held, self._parent_pipe = os.pipe()
        # it imports from where this process does, and not from the current folder, as `-c` alone would
        path = f"import sys; sys.path[:] = {sys.path!r}"
        command = f"{path}; from {__name__} import serve_worker_requests; serve_worker_requests({far.fileno()}, {held})"
        # Ctrl-C is this process's matter: while it imports, the server would print a traceback
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", command], pass_fds=(far.fileno(), held), stdin=subprocess.DEVNULL
            )
        except BaseException:
            self._control.close()
            os.close(self._parent_pipe)
            raise
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            far.close()
            os.close(held)

    def start_worker(self) -> PipeWorker:
        """Fork a new worker.

        Raises:
            WorkerLost: The server has gone, or was stopped.
        """
        near, far = socket.socketpair()
        with far:
            try:
                with self._lock:
                    socket.send_fds(self._control, [b"w"], [far.fileno()])
            except OSError as error:
                near.close()
                raise WorkerLost from error
        return PipeWorker(Connection(near.detach()))

    def stop_workers(self) -> None:
        """End all workers at once."""
        with self._lock:
            parent_pipe, self._parent_pipe = self._parent_pipe, -1
            if parent_pipe >= 0:
                os.close(parent_pipe)
            self._control.close()

    def wait_until_stopped(self) -> None:
        """Wait until the server has gone; it goes when its last worker has gone."""
        self._process.wait()


def serve_worker_requests(control: int, parent_pipe: int) -> None:
    """Run the server: import, then fork a worker for each socket that is received, until the parent has gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    for descriptor in (control, parent_pipe):
        os.set_inheritable(descriptor, False)
    os.environ[WORKER_ENVIRONMENT_VARIABLE] = "1"
    import cwcli.fleet.warm  # noqa: F401

    children: set[int] = set()
    with socket.socket(fileno=control) as calls:
        while True:
            try:
                message, descriptors, *_ = socket.recv_fds(calls, 1, 1)
            except OSError:
                break
            if not message:
                break
            children -= {child for child in children if _has_child_ended(child)}
            for descriptor in descriptors:
                os.set_inheritable(descriptor, False)
                child = os.fork()
                if not child:
                    calls.close()
                    _run_worker_loop(descriptor, parent_pipe)
                os.close(descriptor)
                children.add(child)
    for child in children:
        with suppress(ChildProcessError):
            os.waitpid(child, 0)


def _has_child_ended(child: int) -> bool:
    return os.waitpid(child, os.WNOHANG)[0] != 0


def _run_worker_loop(descriptor: int, parent_pipe: int) -> None:
    """Answer calls until the connection closes, then exit the process; does not return."""
    code = 1
    try:
        threading.Thread(target=_exit_when_parent_pipe_closes, args=(parent_pipe,), daemon=True).start()
        with Connection(descriptor) as connection, suppress(OSError, EOFError):
            while True:
                function, arguments = connection.recv()
                try:
                    answer = False, function(*arguments)
                except Exception as error:
                    answer = True, error
                connection.send(answer)
        code = 0
    finally:
        with suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _exit_when_parent_pipe_closes(parent_pipe: int) -> None:
    wait_for([parent_pipe])
    os._exit(1)
