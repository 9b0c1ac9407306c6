"""A call of a function in a worker process, and its answer."""

from __future__ import annotations

from multiprocessing.connection import Connection
from typing import Any


class WorkerLost(Exception):
    """A worker went away in the middle of its work."""


class PipeWorker:
    """A process that does one thing at a time; it reads what to do from a pipe or a socket, and answers there."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def call(self, function: Any, *arguments: Any) -> Any:
        """What a function of a module returns; what it raises is raised here.

        Raises:
            WorkerLost: The worker went away.
        """
        try:
            self._connection.send((function, arguments))
            is_error, value = self._connection.recv()
        except (OSError, EOFError) as error:
            raise WorkerLost from error
        if is_error:
            raise value
        return value

    def close(self) -> None:
        """Let it go when it is done."""
        self._connection.close()
