"""Processes logs on a Ray cluster, which schedules them and repeats a log whose worker died."""

from __future__ import annotations

import socket
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

from cwcli.errors import UsageError, install_hint
from cwcli.fleet.local import WorkerDied
from cwcli.fleet.plan import FleetPlan, LogTask, TaskResult
from cwcli.fleet.worker import process_log

MAX_RETRIES_OF_LOG = 1
"""Repetitions of a log whose worker died; chosen as for local processes."""
LOCAL_CLUSTER_ADDRESS = "local"
"""Address that means a new cluster on this machine."""
CLUSTER_CONNECT_TIMEOUT_S = 5.0
"""Time after which a cluster counts as not answering, s; chosen by hand."""


def run_on_ray_cluster(
    tasks: Sequence[LogTask], plan: FleetPlan, address: str, jobs: int | None
) -> Iterator[tuple[LogTask, TaskResult | WorkerDied]]:
    """Process the logs on a Ray cluster; yield each task with its result as it ends.

    Inputs and the output folder must be reachable under the same names from every machine of the cluster.

    Args:
        tasks, plan: The logs, and what is done with each.
        address: Address of the cluster; `auto` for the one of this machine, `local` for a new one.
        jobs: With `local`, the number of processors; None for all.

    Raises:
        UsageError: Ray is not installed, or the cluster does not answer.
        OutputError: The output folder can't be written.
    """
    ray = _connect_to_ray(address, jobs)
    try:
        remote = ray.remote(max_retries=MAX_RETRIES_OF_LOG, num_cpus=1)(process_log)
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


def _check_cluster_answers(address: str) -> None:
    """Check that the cluster accepts connections; Ray itself would retry for minutes.

    Raises:
        OSError: It does not.
    """
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if port.isdecimal():
        socket.create_connection((host.strip("[]"), int(port)), CLUSTER_CONNECT_TIMEOUT_S).close()


def _connect_to_ray(address: str, jobs: int | None) -> Any:
    """Import Ray, connect it to the cluster, and return its module."""
    try:
        import ray
    except ImportError as error:
        raise UsageError("--ray needs a package that is not installed", hint=install_hint("ray")) from error
    # the same thread limit as `cwcli.cli.main` sets for this process
    quiet: dict[str, Any] = {
        "log_to_driver": False,
        "logging_level": "ERROR",
        "runtime_env": {"env_vars": {"OPENBLAS_NUM_THREADS": "1"}},
    }
    try:
        _check_cluster_answers(address)
        if address == LOCAL_CLUSTER_ADDRESS:
            ray.init(address=LOCAL_CLUSTER_ADDRESS, num_cpus=jobs, include_dashboard=False, **quiet)
        else:
            ray.init(address=address, **quiet)
    except (ConnectionError, RuntimeError, ValueError, OSError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        hint = "start one with `ray start --head`, name its address, or use --ray local"
        raise UsageError(f"no Ray cluster answers at {address}: {reason}", hint=hint) from error
    return ray
