"""Where a campaign's runs are carried out: worker processes of this machine, or a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import threading
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import wait
from typing import TYPE_CHECKING, Any

from fin_plant.start import interrupt_held_back

if TYPE_CHECKING:
    from collections.abc import Iterator
    from concurrent.futures import Executor, Future


def _end_with_parent() -> None:
    """End this worker when the campaign is gone: a killed one cannot tell its workers to."""
    parent = multiprocessing.parent_process()
    if parent is not None:

        def watch() -> None:
            wait([parent.sentinel])
            os._exit(1)

        threading.Thread(target=watch, daemon=True).start()


class _Processes(ProcessPoolExecutor):
    """Worker processes that Ctrl-C finds either not begun or known, so that all of them can be ended."""

    def submit(self, *arguments: Any, **named: Any) -> Future[Any]:
        """Start what is submitted, and a worker for it where one is missing."""
        with interrupt_held_back():
            return super().submit(*arguments, **named)


@contextmanager
def open_executor(workers: int, dask: str | None) -> Iterator[Executor]:
    """Yield where the runs are carried out: processes of this machine, or a Dask cluster.

    Raises:
        ValueError: No scheduler answers at the address, or dask.distributed is not installed.
    """
    if dask is None:
        # Not forked from this process, which has threads: from a server that has imported the experiments once.
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["fin_optimizer.paper.experiments"])
        # Ctrl-C on a terminal reaches the server and the workers too, while they import as well: it is this process's
        # to answer. They inherit the mask; a signal that comes meanwhile reaches this process behind it. The tracker
        # of resources, which is started too, would lift the mask again.
        resource_tracker.ensure_running()
        with interrupt_held_back():
            forkserver.ensure_running()
        with _Processes(workers, mp_context=context, initializer=_end_with_parent) as pool:
            try:
                yield pool
            except KeyboardInterrupt:
                for worker in multiprocessing.active_children():
                    worker.terminate()
                raise
        return
    try:
        with interrupt_held_back():  # one that comes while a library loads can be an ImportError
            from distributed import Client  # noqa: PLC0415  (needed by those who have a cluster only)
    except ImportError:
        msg = "--dask needs the package distributed: pip install -r requirements/bench.txt"
        raise ValueError(msg) from None
    try:
        client = Client(dask, timeout=10, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        msg = f"no Dask scheduler at {dask} ({type(error).__name__}: {error}): start one with `dask scheduler`"
        raise ValueError(msg) from None
    with client, client.get_executor() as executor:
        yield executor
