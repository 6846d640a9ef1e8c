"""What a scene takes of its node, from which Ray chooses the node."""

from dataclasses import dataclass, replace
from typing import Any

from sqlalchemy.orm import Session

from fvs_schema.images import Registration
from fvs_schema.jobs import JobKind
from fvs_service.host.worker.resources import job_need_bytes
from fvs_service.images.repository import usable_images
from fvs_service.jobs.repository import find_job, needs_of
from fvs_service.jobs.stages import Work
from fvs_service.jobs.states import Turn
from fvs_service.settings import WorkerSettings

_CPUS = 2
_NEW_IMAGES = 16
"""An update with so many new images registers them on a node without a GPU, where there are GPUs."""
_SMALLEST_BYTES = 1 << 30


@dataclass(frozen=True)
class Resources:
    """CPUs, GPUs (also a share of one), and bytes of memory.

    ``trains``: updates go on with training there when their images are registered; else they are left to
    another host of the scene.
    """

    cpus: float
    gpus: float
    memory_bytes: int
    trains: bool = True

    def cover(self, need: "Resources") -> bool:
        """Whether ``need`` is within these."""
        return need.trains <= self.trains and not need.exceeds(self)

    def exceeds(self, other: "Resources") -> bool:
        """Whether there is more of anything than in the other ones."""
        return self.cpus > other.cpus or self.gpus > other.gpus or self.memory_bytes > other.memory_bytes

    def plus(self, more: "Resources") -> "Resources":
        """These and some more."""
        return replace(
            self,
            cpus=self.cpus + more.cpus,
            gpus=self.gpus + more.gpus,
            memory_bytes=self.memory_bytes + more.memory_bytes,
        )

    def minus(self, taken: "Resources") -> "Resources":
        """These without what is taken."""
        return self.plus(Resources(-taken.cpus, -taken.gpus, -taken.memory_bytes))

    def help(self, short: "Resources") -> bool:
        """Whether these have something of what is short, that is above 0."""
        return (
            (short.cpus > 0 and self.cpus > 0)
            or (short.gpus > 0 and self.gpus > 0)
            or (short.memory_bytes > 0 and self.memory_bytes > 0)
        )

    @property
    def options(self) -> dict[str, float]:
        """The options of a Ray actor that takes them."""
        return {"num_cpus": self.cpus, "num_gpus": self.gpus, "memory": self.memory_bytes}

    @classmethod
    def of_node(cls, node: dict[str, Any]) -> "Resources":
        """All that a node has, by its entry in ``ray.nodes()``."""
        total = node["Resources"]
        return cls(total.get("CPU", 0.0), total.get("GPU", 0.0), int(total.get("memory", 0)))


def cpus_of(settings: WorkerSettings) -> int:
    """The CPUs of a scene."""
    return settings.threads or _CPUS


def need_to_rank(settings: WorkerSettings, memory_bytes: int, gpus: float) -> Resources:
    """What a scene takes that only ranks; ``gpus``: for training. It never waits for a GPU."""
    return Resources(cpus_of(settings), 0.0, _rounded(memory_bytes), trains=not gpus)


def need_of(session: Session, turn: Turn, settings: WorkerSettings, gpus: float) -> Resources:
    """What a scene takes for a turn; ``gpus``: for training. Raises ``NotFoundError`` for a deleted job."""
    request = find_job(session, turn.job_id).request
    images = usable_images(session, turn.scene_id)
    to_train = gpus
    if request.kind is JobKind.FRAMES:
        gpus = 0.0
    elif needs_of(session, turn.job_id) is Work.SFM:
        known = (Registration.REGISTERED, Registration.UNREGISTERED)
        if sum(image.registration not in known for image in images) >= _NEW_IMAGES:
            gpus = 0.0
    memory_bytes = _rounded(job_need_bytes(request, images, settings))
    return Resources(cpus_of(settings), gpus, memory_bytes, trains=gpus == to_train)


def _rounded(memory_bytes: int) -> int:
    """The next power of two: a scene that grows keeps its host until it needs twice the memory."""
    return int(max(_SMALLEST_BYTES, 1 << (memory_bytes - 1).bit_length()))
