"""The stages of jobs in one table, and the kinds of work that they belong to.

An update begins with structure from motion, on the CPU, and continues with training, where a GPU helps; a
fine model is training alone, and frames are taken where structure from motion is computed.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum

from fvs_engine.records import Record
from fvs_schema.jobs import JobKind
from fvs_schema.stages import Stage

FIRST_IMAGES = 10
"""The images of a first model: the fewest that usually make a model that ranks."""


class Work(StrEnum):
    """What a job needs next."""

    SFM = "sfm"
    TRAINING = "training"


def first_work(kind: JobKind) -> Work:
    """What a job of this kind begins with."""
    return Work.TRAINING if kind is JobKind.FINE else Work.SFM


def has_first_model(*, first: bool, images: int) -> bool:
    """Whether an update has a first model: the ``first`` of a scene, of at least twice as many images."""
    return first and images >= 2 * FIRST_IMAGES


class JobSize(Record):
    """What a job's time depends on: images in all and new ones, their megapixels, those trained on."""

    first: bool
    images: int
    new: int
    megapixels: float
    train_megapixels: float
    iterations: int


def _constant(_size: JobSize) -> float:
    return 1.0


def _per_image(size: JobSize) -> float:
    return float(size.images)


def _per_new_image(size: JobSize) -> float:
    return float(size.new)


def _per_new_pixel(size: JobSize) -> float:
    return size.new * size.megapixels


def _per_pair(size: JobSize) -> float:
    return float(size.new * size.images)


def _per_training_pixel(size: JobSize) -> float:
    return size.iterations * size.train_megapixels


@dataclass(frozen=True)
class StageOfJob:
    """What a stage means for a job.

    ``update``, ``fine``, ``frames`` and ``first_model``: the shares of a job of each kind, or of the first
    model, where the stage begins and ends. ``work``: what its time is proportional to. ``trains``: it resumes
    where it was stopped, so that a job loses nothing there; other stages start again.
    """

    update: tuple[float, float] = (0.0, 0.0)
    fine: tuple[float, float] = (0.0, 0.0)
    frames: tuple[float, float] = (0.0, 0.0)
    first_model: tuple[float, float] = (0.0, 0.0)
    work: Callable[[JobSize], float] = _per_image
    trains: bool = False

    def part_of(self, kind: JobKind) -> tuple[float, float]:
        """Where it begins and ends as shares of a job of this kind."""
        return {JobKind.UPDATE: self.update, JobKind.FINE: self.fine, JobKind.FRAMES: self.frames}[kind]


STAGES: Mapping[Stage, StageOfJob] = {
    Stage.START: StageOfJob(work=_constant),
    Stage.RESTORE: StageOfJob(),
    Stage.FRAMES: StageOfJob(frames=(0.00, 1.00), work=_per_new_image),
    Stage.IMAGES: StageOfJob(update=(0.00, 0.02), fine=(0.00, 0.01), work=_per_new_pixel),
    Stage.NORMALISE: StageOfJob(update=(0.02, 0.04), fine=(0.01, 0.02), work=_per_new_pixel),
    Stage.COMPILE: StageOfJob(update=(0.04, 0.05), work=_constant),
    Stage.FIRST_MODEL: StageOfJob(update=(0.05, 0.10)),
    Stage.FEATURES: StageOfJob(update=(0.10, 0.14), first_model=(0.0, 0.4), work=_per_new_pixel),
    Stage.PAIRS: StageOfJob(update=(0.14, 0.15), work=_per_pair),
    Stage.MATCHING: StageOfJob(update=(0.15, 0.25), first_model=(0.4, 0.5), work=_per_pair),
    Stage.CALIBRATION: StageOfJob(update=(0.25, 0.26)),
    # Of a first model only where the first mapper's model leaves doubt.
    Stage.GLOBAL_MAPPING: StageOfJob(update=(0.26, 0.33), first_model=(0.7, 0.7)),
    Stage.INCREMENTAL_MAPPING: StageOfJob(update=(0.33, 0.42), first_model=(0.5, 0.65)),
    Stage.REGISTRATION: StageOfJob(update=(0.33, 0.42), work=_per_new_image),
    Stage.LOCALISATION: StageOfJob(work=_per_new_image),
    Stage.TRIANGULATION: StageOfJob(),
    Stage.EVIDENCE: StageOfJob(update=(0.42, 0.43), first_model=(0.65, 0.7)),
    Stage.LOAD: StageOfJob(update=(0.43, 0.46), fine=(0.02, 0.04), first_model=(0.7, 0.75)),
    Stage.EVALUATE: StageOfJob(fine=(0.97, 0.98)),
    Stage.QUICK_TRAINING: StageOfJob(
        update=(0.46, 0.55), first_model=(0.75, 1.0), work=_per_training_pixel, trains=True
    ),
    Stage.QUICK_SNAPSHOT: StageOfJob(update=(0.55, 0.56)),
    Stage.TRAINING: StageOfJob(update=(0.56, 0.97), fine=(0.04, 0.96), work=_per_training_pixel, trains=True),
    Stage.CLEANING: StageOfJob(fine=(0.96, 0.97)),
    Stage.SNAPSHOT: StageOfJob(update=(0.97, 1.00), fine=(0.98, 1.00)),
    Stage.COMMIT: StageOfJob(),
}
"""The stages that a job may have, as they follow each other."""


def stage_of_job(stage: Stage) -> StageOfJob:
    """What a stage means for a job; one of commands alone means nothing."""
    return STAGES.get(stage, StageOfJob())
