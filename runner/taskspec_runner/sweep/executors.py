"""Executors by their names: processes of this machine, or a cluster of Dask's."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec_runner.errors import InputError

DASK = "dask"


@dataclass(frozen=True, slots=True)
class Workers:
    """Who runs the worlds of a sweep.

    Attributes:
        executor: of `concurrent.futures`' kind; None for processes of this machine, or with one job
            for this one.
        jobs: how many worlds at once.
    """

    executor: Executor | None
    jobs: int


@contextmanager
def workers(named: str | None, jobs: int) -> Iterator[Workers]:
    """The workers that a user names.

    Args:
        named: `dask` for a cluster on this machine, `dask:ADDRESS` for one whose scheduler listens
            there; None for processes of this machine.
        jobs: how many, where they are of this machine.

    Raises:
        InputError: there is no such executor, its library is missing, or nobody answers.
    """
    if named is None:
        yield Workers(None, jobs)
        return
    kind, _, address = named.partition(":")
    if kind != DASK:
        raise InputError(f"--executor takes dask or dask:tcp://HOST:PORT, not {named!r}")
    try:
        # It has no types of its own.
        distributed: Any = importlib.import_module("distributed")
    except ImportError as error:
        message = "--executor dask needs dask.distributed: pip install 'taskspec-robotics[dask]'"
        raise InputError(message) from error
    if not address:
        with (
            distributed.LocalCluster(
                n_workers=jobs, threads_per_worker=1, dashboard_address=None
            ) as cluster,
            distributed.Client(cluster) as client,
        ):
            yield Workers(client.get_executor(), jobs)
        return
    try:
        client = distributed.Client(address, timeout=_PATIENCE)
    except (OSError, ValueError) as error:
        raise InputError(f"no scheduler of Dask answers at {address}: {error}") from error
    with client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise InputError(f"the scheduler at {address} has no workers")
        yield Workers(client.get_executor(), threads)


#: Seconds until a scheduler has to have answered.
_PATIENCE = 10
