"""Control points of a scene: what a job's model makes of them."""

import hashlib
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from PIL import Image as Pillow

from fvs_engine.control.marks import sight_of
from fvs_engine.control.residuals import align_by_control
from fvs_engine.control.triangulation import Sight
from fvs_engine.errors import InvalidInputError
from fvs_engine.images.names import match_names
from fvs_engine.images.pixels import orientation_of
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.colmap.model import read_colmap
from fvs_schema.control_points import ControlPoints
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.images import Image
from fvs_schema.scenes import Origin
from fvs_service.host.protocol.messages import ControlOutcome
from fvs_service.storage.blob_keys import image_key
from fvs_service.storage.blobs import Blobs


@dataclass(frozen=True)
class StoredImages:
    """The images of a job by the names of their files in ``folder``; their originals are in ``blobs``."""

    files: Mapping[str, Image]
    folder: Path
    blobs: Blobs

    def orientation(self, name: str) -> int:
        """How the stored pixels of an image were turned for its file."""
        image = self.files[name]
        if hashlib.sha256((self.folder / name).read_bytes()).hexdigest() == image.sha256:
            return 1
        with Pillow.open(io.BytesIO(self.blobs.read(image_key(image.scene_id, image.sha256)))) as original:
            return orientation_of(original)


def control_outcome(
    control: ControlPoints, origin: Origin | None, images: StoredImages, model: Path, monitor: Monitor
) -> ControlOutcome | None:
    """The alignment of the COLMAP model in the folder ``model``; None when the points determine none.

    Warnings say why, and which points and marks are not used.
    """
    views = {view.name: view for view in read_colmap(model).views}
    marked = _files_of(control, images.files, monitor)
    orientation = cache(images.orientation)
    try:
        sights: Mapping[str, Sequence[Sight]] = {
            point.name: [
                sight_of(point.name, mark, views[file], orientation(file))
                for mark in point.marks
                if (file := marked.get(mark.image)) in views and file is not None
            ]
            for point in control.points
        }
        result = align_by_control(control, sights, origin)
    except InvalidInputError as error:
        why, remedy = error.message, error.hint
        monitor.warn(Finding.of(FindingCode.CONTROL_POINTS_UNUSED, why=why, remedy=remedy))
        return None
    for finding in result.findings:
        monitor.warn(finding)
    points = tuple(
        point.model_copy(
            update={"wrong_marks": tuple(images.files[name].digest for name in point.wrong_marks)}
        )
        for point in result.residuals.points
    )
    residuals = result.residuals.model_copy(update={"points": points})
    return ControlOutcome(alignment=result.alignment, residuals=residuals)


def _files_of(control: ControlPoints, files: Mapping[str, Image], monitor: Monitor) -> Mapping[str, str]:
    """The files of the images that have marks, by the names or digests that the marks have."""
    names = Counter(image.name for image in files.values())
    aliases = {image.name: file for file, image in files.items() if names[image.name] == 1}
    aliases |= {image.digest: file for file, image in files.items()}
    matches = match_names(sorted({mark.image for point in control.points for mark in point.marks}), aliases)
    for finding in matches.findings():
        monitor.warn(finding)
    unknown = (*matches.missing, *matches.ambiguous)
    if unknown:
        monitor.warn(Finding.of(FindingCode.MARKED_IMAGES_UNKNOWN, unknown))
    return matches.found
