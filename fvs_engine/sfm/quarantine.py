"""The quarantined images of a folder: they crash pycolmap, so no further job gets them."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from pydantic import Field

from fvs_engine.errors import NativeJobError, ReconstructionError
from fvs_engine.files.record import read_record, write_record
from fvs_engine.records import Record


class CulpritError(ReconstructionError):
    """The image ``name`` crashes a native job; ``reason`` names the stage and the cause."""

    def __init__(self, name: str, reason: str) -> None:
        super().__init__(f"{name} cannot be used: {reason}", hint="Leave it out.")
        self.name = name
        self.reason = reason

    @classmethod
    def of(cls, name: str, error: NativeJobError) -> "CulpritError":
        """For the image that crashed a job with ``error`` in every run."""
        return cls(name, f"{error.message} It does so whenever it gets this image.")


class _Quarantined(Record):
    images: dict[str, str] = Field(default={})


class Quarantine:
    """The file with the names of quarantined images and the reasons; each change is on disk at once."""

    def __init__(self, file: Path) -> None:
        self._file = file

    @property
    def reasons(self) -> Mapping[str, str]:
        """Name of each quarantined image → why."""
        found = read_record(self._file, _Quarantined, "Delete it; the images are then tried again.")
        return {} if found is None else found.images

    def add(self, culprit: CulpritError) -> None:
        """Quarantine an image; raises ``culprit`` when it was quarantined before, and a job got it again."""
        if culprit.name in self.reasons:
            raise culprit
        self._write({**self.reasons, culprit.name: culprit.reason})

    def release(self, names: Iterable[str]) -> None:
        """Forget these images, so that they are tried again."""
        before, released = self.reasons, set(names)
        if released & before.keys():
            self._write({name: reason for name, reason in before.items() if name not in released})

    def _write(self, images: Mapping[str, str]) -> None:
        self._file.parent.mkdir(parents=True, exist_ok=True)
        write_record(self._file, _Quarantined(images=dict(images)))


def warning(name: str, reason: str) -> str:
    """The sentence for the user about a quarantined image."""
    return f"{name} is quarantined: {reason}"
