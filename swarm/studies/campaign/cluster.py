"""The places where a study's runs are flown: this process, this machine's cores, or any dask cluster.

The only file that knows dask. An order goes out as one task; dask sends it to another worker where the first one died,
and gives it up after the `allowed-failures` of its configuration. TLS is dask's own too: a `tls://` address, with the
certificates that its configuration names.
"""

import logging
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from swarm.errors import SwarmError
from swarm.studies.campaign.task import LOST, Flown, Order, fly

if TYPE_CHECKING:
    from distributed import Client, Future

Fleet = Callable[[Sequence[Order]], Iterator[Flown]]
"""Flies orders, and yields how each ended, in the order in which they end."""
CONNECT_S = 10.0


def in_this_process(orders: Sequence[Order]) -> Iterator[Flown]:
    """Fly one run after the other: the plain loop that every other way must equal."""
    yield from map(fly, orders)


@contextmanager
def on_this_machine(workers: int | None = None) -> Iterator[Fleet]:
    """Start worker processes with one thread each, reached from nowhere else.

    workers: their number; default: one per core.
    """
    import dask
    from distributed import Client, LocalCluster

    quiet = {"distributed.logging.distributed": "critical", "distributed.admin.system-monitor.gil.enabled": False}
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with dask.config.set(quiet):
        with _workers_deaf_to_ctrl_c():
            cluster = LocalCluster(
                n_workers=workers or cores(),
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            )
        with cluster, Client(cluster) as client:
            yield lambda orders: _fly_on(client, orders)


@contextmanager
def on_cluster(address: str) -> Iterator[Fleet]:
    """Connect to the scheduler at `address`, such as tcp://host:8786. Raises SwarmError where none answers."""
    from distributed import Client

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=CONNECT_S)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        reason = str(error).partition("\n")[0]
        raise SwarmError(f"--scheduler {address}: no dask scheduler answers there ({reason})") from None
    with client:
        yield lambda orders: _fly_on(client, orders)


@contextmanager
def _workers_deaf_to_ctrl_c() -> Iterator[None]:
    """Keep the terminal's Ctrl-C from what is started in the block: it is for this process to stop the workers.

    This process does not get it either, for the few seconds of the block: only what is ignored is inherited.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _fly_on(client: "Client", orders: Sequence[Order]) -> Iterator[Flown]:
    from distributed import as_completed

    futures = {
        # Keys of this client alone: another one's results, of another day, are not ours.
        client.submit(fly, order, key=f"{client.id}-{order.number}", pure=False): order
        for order in orders
    }
    try:
        for future in as_completed(list(futures)):
            yield _ended(future, futures.pop(future))
    finally:
        # Stopped by its user: nothing more is to be flown for nobody.
        if futures:
            client.cancel(list(futures), force=True)


def _ended(future: "Future", order: Order) -> Flown:
    if future.status == "finished":
        flown: Flown = future.result()
        return flown
    if future.status == "cancelled":
        raise SwarmError("the dask scheduler is gone; what was finished is kept, and --resume continues")
    error = future.exception()
    name = type(error).__name__
    reason = "its worker died, and so did those that tried again" if name == "KilledWorker" else f"{name}: {error}"
    return Flown(order.number, order.key, LOST, reason, 0.0, {})
