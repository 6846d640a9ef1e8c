"""A worker as a process of its own."""

import os

from fvs_service.application import open_storage
from fvs_service.serving.child import receive_order
from fvs_service.worker.engine import DbosEngine


def main() -> None:
    """Be the worker that standard input asks for, until it is asked to stop."""
    order = receive_order()
    with open_storage(order.settings) as storage:
        DbosEngine(storage).run_worker(order.name)
    os._exit(0)  # attempts that were under way wait for the next process


if __name__ == "__main__":
    main()
