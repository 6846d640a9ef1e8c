"""The size of a job, on which its time depends."""

from collections.abc import Sequence

from fvs_engine.images.pixels import reduced_size
from fvs_service.images.model import Image, Registration
from fvs_service.jobs.model import Job, JobKind
from fvs_service.jobs.timing import JobSize
from fvs_service.settings import WorkerSettings

_MEGAPIXEL = 1e6


def size_of(job: Job, images: Sequence[Image], first: bool, settings: WorkerSettings) -> JobSize:
    """The size of a job on ``images``; ``first`` is whether the scene has no model yet."""
    fine = job.kind is JobKind.FINE
    known = (Registration.REGISTERED, Registration.UNREGISTERED)
    new = len(images) if first or fine else sum(image.registration not in known for image in images)
    side = job.request.long_side_px or settings.long_side_px
    areas, reduced = [0.0], [0.0]
    for image in images:
        width, height = image.width_px or side, image.height_px or side
        areas.append(width * height / _MEGAPIXEL)
        small = reduced_size(width, height, side)
        reduced.append(small[0] * small[1] / _MEGAPIXEL)
    if fine:
        iterations = job.request.iterations or settings.fine_iterations
    else:
        usual = max(settings.initial_iterations, settings.iterations_per_image * len(images))
        iterations = job.request.iterations or usual
    return JobSize(
        first=first,
        images=len(images),
        new=new,
        megapixels=sum(areas) / max(1, len(images)),
        train_megapixels=sum(reduced) / max(1, len(images)),
        iterations=iterations,
    )
