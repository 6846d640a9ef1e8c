"""The quarantined images of a folder: they crash pycolmap, so no further job gets them."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from pydantic import Field

from fvs_engine.errors import NativeJobError, ReconstructionError
from fvs_engine.files.record import read_record, write_record
from fvs_engine.records import Record
from fvs_schema.findings import Finding, FindingCode


class CulpritError(ReconstructionError):
    """The image ``name`` crashed a native job with ``error`` in every run; ``reason`` is the finding."""

    def __init__(self, name: str, error: NativeJobError) -> None:
        super().__init__(f"{name} cannot be used: {error.message}", hint="Leave it out.")
        self.name = name
        self.reason = Finding.of(FindingCode.QUARANTINED, [name], stage=error.stage, how=error.how)


class _Quarantined(Record):
    images: dict[str, Finding] = Field(default={})


class Quarantine:
    """The file with the names of quarantined images and the reasons; each change is on disk at once."""

    def __init__(self, file: Path) -> None:
        self._file = file

    @property
    def reasons(self) -> Mapping[str, Finding]:
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

    def _write(self, images: Mapping[str, Finding]) -> None:
        self._file.parent.mkdir(parents=True, exist_ok=True)
        write_record(self._file, _Quarantined(images=dict(images)))
