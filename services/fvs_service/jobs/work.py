"""The kinds of work of jobs: each has a queue of its own where workers are set to do one kind.

An update begins with structure from motion, on the CPU, and continues with training, where a GPU helps; a
fine model is training alone. A job waits for a worker that does what it needs next.
"""

from enum import StrEnum

from fvs_schema.jobs import JobKind


class Work(StrEnum):
    """What a job needs next."""

    SFM = "sfm"
    TRAINING = "training"


ALL_WORK = frozenset(Work)


def first_work(kind: JobKind) -> Work:
    """What a job of this kind begins with."""
    return Work.SFM if kind is JobKind.UPDATE else Work.TRAINING


def work_of(setting: str) -> frozenset[Work]:
    """The kinds of work of a worker with this ``FVS_WORKER__WORK``."""
    return ALL_WORK if setting == "all" else frozenset({Work(setting)})
