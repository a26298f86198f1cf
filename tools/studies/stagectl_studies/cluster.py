"""The same function over many items: on a Dask cluster, where one is named.

A worker that dies loses the item it was at, which another one takes up again; after three workers have died of one item
it is given up, when all others are done.  Workers must see the same files under the same paths as who asks.  The extra
``cluster`` brings Dask.
"""

import importlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from stagectl.units import StageError

A = TypeVar("A")
B = TypeVar("B")
PATIENCE = 20.0  # s until a scheduler must have answered


class ClusterError(StageError):
    """A cluster that cannot be reached, or that has given up."""


def on_cluster(function: Callable[[A], B], items: Sequence[A], address: str, retries: int = 0) -> Iterator[B]:
    """`function` of each item on the cluster whose scheduler listens at `address`, as they come.

    An item whose function raises is tried as often again as `retries` says; what it raised last comes after all else.
    Raises ClusterError where there is no Dask, no scheduler, or no worker that lives through an item.
    """
    try:
        distributed: Any = importlib.import_module("distributed")  # untyped, and slow to load
    except ImportError as error:
        raise ClusterError("--scheduler needs Dask: pip install 'stagectl[cluster]'") from error
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise ClusterError(f"--scheduler {address}: no Dask scheduler answers there within {PATIENCE:g} s") from error
    with client:
        futures = [client.submit(function, item, pure=False, retries=retries) for item in items]
        failed = []
        try:
            for future in distributed.as_completed(futures, loop=client.loop):
                if future.status == "finished":
                    yield future.result()
                else:
                    failed.append(future)
            for future in failed:
                future.result()  # raises what its function raised
        except distributed.KilledWorker as error:
            raise ClusterError(f"--scheduler {address}: several workers died of one item: {error}") from error
        finally:
            client.cancel(futures)
