"""Expected failures of the engine, with hints for the user.

Every expected failure of the engine is an ``EngineError``: its message names what is
wrong and where, and its ``hint`` the remedy. The command line and the service map
``code`` to an exit code or a problem document; they never parse messages.
"""

from pathlib import Path


class EngineError(Exception):
    """An expected failure, with a stable ``code`` and a ``hint`` for the user.

    ``path``: the file or folder that it is about, as message and hint name it.
    """

    code = "engine-error"

    def __init__(self, message: str, *, hint: str = "", path: Path | str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.path = path

    def __str__(self) -> str:
        return f"{self.message} {self.hint}".strip()


class Cancelled(EngineError):  # noqa: N818 - requested, not a fault
    """The work was stopped on request; what was finished is on disk."""

    code = "cancelled"


class InvalidInputError(EngineError):
    """An argument or a file's content cannot be used."""

    code = "invalid-input"


class OtherSettingsError(InvalidInputError):
    """A folder was made with other settings, or by a version whose settings differ."""


class NoImagesError(InvalidInputError):
    """The input has no usable photograph, or too few."""

    code = "no-images"


class ReconstructionError(EngineError):
    """Structure from motion found no model that the evidence supports."""

    code = "reconstruction-failed"


class ContradictedModelsError(ReconstructionError):
    """Every model contradicts the images' matches or positions."""


class ContradictedPositionsError(ReconstructionError):
    """Every model contradicts something, at least one the positions of its images, which may be wrong."""


class NativeJobError(ReconstructionError):
    """The native job of a ``stage`` failed; ``how``: its error message, exit status or signal.

    ``crashed``: by itself, not because its process was killed.
    """

    wording = "Stage {stage!r} failed: {how}."

    def __init__(
        self, stage: str, how: str, *, crashed: bool = True, hint: str = "", path: Path | None = None
    ) -> None:
        super().__init__(self.wording.format(stage=stage, how=how), hint=hint, path=path)
        self.stage = stage
        self.how = how
        self.crashed = crashed


class ProcessDiedError(NativeJobError):
    """The process of a native job died."""

    code = "process-died"
    wording = "The process of stage {stage!r} died ({how})."


class NoProcessError(EngineError):
    """The system gave no process to a native job, which did not start: memory or process ids ran out."""

    code = "no-process"


class TrainingError(EngineError):
    """Training cannot start or cannot continue (nothing to train on, or the numbers diverged)."""

    code = "training-failed"


class StorageError(EngineError):
    """The output cannot be written or an earlier output cannot be read."""

    code = "storage"


class OutputExistsError(StorageError):
    """The output folder holds something that must not be overwritten or mixed with this run."""

    code = "output-exists"


class DamagedOutputError(StorageError):
    """An earlier output is damaged, so that no run can continue from it."""


class BackendUnavailableError(EngineError):
    """The requested rasteriser cannot run on this machine."""

    code = "backend-unavailable"


class DeviceMemoryError(EngineError):
    """The GPU has too little memory for a training or a rendering."""

    code = "device-memory"
