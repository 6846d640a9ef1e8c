"""The gateway as a process of its own; it says on standard output where it listens."""

import sys

from fvs_service.gateway.server import run_gateway
from fvs_service.serving.child import receive_order
from fvs_service.worker.backend import WORKERS


def main() -> None:
    """Be the gateway that standard input asks for, until it is asked to stop."""
    order = receive_order()
    run_gateway(order.settings, WORKERS, announce=lambda url: print(url, flush=True))  # noqa: T201
    sys.stdout.flush()


if __name__ == "__main__":
    main()
