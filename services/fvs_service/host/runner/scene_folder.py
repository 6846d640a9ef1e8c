"""The folder of a scene on a worker's disk."""

from dataclasses import dataclass
from pathlib import Path

from fvs_service.images.files import IMAGES


@dataclass(frozen=True)
class SceneFolder:
    """The paths in a scene's folder ``root``."""

    root: Path

    @property
    def images(self) -> Path:
        """The images, as files for the engine."""
        return self.root / IMAGES

    @property
    def growing(self) -> Path:
        """The folder of the ``Scene``."""
        return self.root / "growing"

    @property
    def choice(self) -> Path:
        """The ``SceneChoice``."""
        return self.root / "choice.json"

    def fine(self, job_id: str) -> Path:
        """The cameras and the checkpoint of a fine model."""
        return self.root / "fine" / job_id

    def outcome(self, job_id: str) -> Path:
        """The artifacts that a job has written and its worker has not committed yet."""
        return self.root / "outcome" / job_id
