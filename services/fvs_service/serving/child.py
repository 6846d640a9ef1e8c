"""What the supervisor's children have in common: how they are told what to be, and when they end."""

import os
import sys
import threading
import time

from pydantic import BaseModel, ConfigDict

from fvs_service.settings import Settings
from fvs_service.telemetry import configure_logging
from fvs_service.worker.runner.process import die_with_parent

_WATCH_S = 0.5


class ChildOrder(BaseModel):
    """What a child is told first, as a line on standard input."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    parent: int
    settings: Settings
    log_json: bool


def receive_order() -> ChildOrder:
    """Read the order, and from now on end when the supervisor does."""
    order = ChildOrder.model_validate_json(sys.stdin.buffer.readline())
    die_with_parent(order.parent)
    threading.Thread(target=_watch, args=(order.parent,), daemon=True).start()
    configure_logging(machine=order.log_json)
    return order


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_WATCH_S)
    os._exit(1)
