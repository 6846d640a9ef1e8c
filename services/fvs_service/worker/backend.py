"""What computes for a gateway: workers, through their queue and their runners."""

from fvs_service.application import Backend
from fvs_service.worker.engine import DbosEngine
from fvs_service.worker.runners import LeasedRunners

WORKERS = Backend(engine=DbosEngine, runners=LeasedRunners)
