"""Calls a function in a worker process and receives its result."""

from __future__ import annotations

from multiprocessing.connection import Connection
from typing import Any


class WorkerLost(Exception):
    """A worker process ended during a call."""


class PipeWorker:
    """A worker process that makes one call at a time, through a pipe or a socket."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def call_function(self, function: Any, *arguments: Any) -> Any:
        """Call a function of a module in the worker and return its result; its errors are raised here.

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
        """Close the connection; the worker ends after its current call."""
        self._connection.close()
