"""The order that a supervisor gives to a process that it starts."""

from fvs_engine.records import Record
from fvs_service.settings import Settings

GATEWAY, WORKER = "gateway", "worker"
CLUSTER = "cluster"
"""The id of the worker on a Ray cluster, of which there is one."""
EXIT_REPLACED = 7
"""The exit status of a worker's process when another one has begun as the same worker."""


class ProcessOrder(Record):
    """Settings and identity of a child process; ``name`` is a worker's id, the same in every restart."""

    name: str
    parent: int
    settings: Settings
    log_json: bool
