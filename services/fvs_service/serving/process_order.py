"""The order that a supervisor gives to a process that it starts."""

from fvs_engine.records import Record
from fvs_service.settings import Settings

GATEWAY, WORKER = "gateway", "worker"


class ProcessOrder(Record):
    """Settings and identity of a child process; ``name`` is a worker's id, the same in every restart."""

    name: str
    parent: int
    settings: Settings
    log_json: bool
