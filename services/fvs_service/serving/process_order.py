"""The order that a supervisor gives to a process that it starts."""

from fvs_engine.records import Record
from fvs_service.settings import Settings

GATEWAY, WORKER = "gateway", "worker"
CLUSTER = "cluster"
"""The id of the worker on a Ray cluster, of which there is one."""


class ProcessOrder(Record):
    """Settings and identity of a child process; ``name`` is a worker's id, the same in every restart."""

    name: str
    parent: int
    settings: Settings
    log_json: bool
