"""Logs on a Ray cluster. Ray decides where and when, and begins a log again whose worker died."""

from __future__ import annotations

import socket
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

from cwcli.errors import UsageError, install_hint
from cwcli.fleet.local import WorkerDied
from cwcli.fleet.plan import Plan, Task
from cwcli.fleet.worker import Done, work

RETRIES = 1
LOCAL = "local"
CONNECT_S = 5.0


def run_ray(
    tasks: Sequence[Task], plan: Plan, address: str, jobs: int | None
) -> Iterator[tuple[Task, Done | WorkerDied]]:
    """Do the logs on a Ray cluster; yields each as it ends.

    Inputs and the output folder must be reachable under the same names from every machine of the cluster.

    Args:
        tasks, plan: What is to be done.
        address: Of the cluster; `auto` for the one that this machine belongs to, `local` for one of its own.
        jobs: With `local`, how many processors it gets; None: all.

    Raises:
        UsageError: Ray is not installed, or the cluster does not answer.
        OutputError: The output folder can't be written.
    """
    ray = _started(address, jobs)
    try:
        remote = ray.remote(max_retries=RETRIES, num_cpus=1)(work)
        shared = ray.put(plan)
        running = {remote.remote(task, shared): task for task in tasks}
        while running:
            ended, _ = ray.wait(list(running))
            for reference in ended:
                task = running.pop(reference)
                try:
                    yield task, ray.get(reference)
                except (ray.exceptions.WorkerCrashedError, ray.exceptions.OutOfMemoryError):
                    yield task, WorkerDied()
                except ray.exceptions.RayTaskError as error:
                    raise error.cause from error
    finally:
        for reference in running:
            with suppress(Exception):
                ray.cancel(reference, force=True)
        ray.shutdown()


def _answers(address: str) -> None:
    """Fail at once where nobody listens; Ray itself would try for minutes.

    Raises:
        OSError: Nobody does.
    """
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if port.isdecimal():
        socket.create_connection((host.strip("[]"), int(port)), CONNECT_S).close()


def _started(address: str, jobs: int | None) -> Any:
    """Ray, connected."""
    try:
        import ray
    except ImportError as error:
        raise UsageError("--ray needs a package that is not installed", hint=install_hint("ray")) from error
    # what `cwcli.cli.main` sets for this process, also on a cluster that somebody else has started
    quiet: dict[str, Any] = {
        "log_to_driver": False,
        "logging_level": "ERROR",
        "runtime_env": {"env_vars": {"OPENBLAS_NUM_THREADS": "1"}},
    }
    try:
        _answers(address)
        if address == LOCAL:
            ray.init(address=LOCAL, num_cpus=jobs, include_dashboard=False, **quiet)
        else:
            ray.init(address=address, **quiet)
    except (ConnectionError, RuntimeError, ValueError, OSError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        hint = "start one with `ray start --head`, name its address, or use --ray local"
        raise UsageError(f"no Ray cluster answers at {address}: {reason}", hint=hint) from error
    return ray
