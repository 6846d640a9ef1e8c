"""Control points of an output folder: its model is placed on Earth by what was surveyed there."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

from PIL import Image

from fvs_engine.control.marks import sight_of
from fvs_engine.control.residuals import align_by_control
from fvs_engine.control.triangulation import Sight
from fvs_engine.errors import InvalidInputError
from fvs_engine.files.json_input import read_text
from fvs_engine.files.record import read_record, write_record
from fvs_engine.files.storage import storage_errors
from fvs_engine.geometry.geodetic import GeodeticPosition, middle_position
from fvs_engine.images.names import match_names
from fvs_engine.images.pixels import orientation_of
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.manifest import ImageRecord, Manifest
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.records import Record
from fvs_engine.sfm.colmap.model import read_colmap
from fvs_engine.sfm.stages import SfmFolder
from fvs_schema.control_points import ControlPoints, ControlResiduals
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.gcp_list import GcpListError, read_gcp_list
from fvs_schema.scenes import Alignment, AltitudeDatum, Origin


class ControlRecord(Record):
    """``control.json``: the ``points`` that were given, the alignment that they determine, and residuals."""

    version: Literal[1] = 1
    points: ControlPoints
    origin: Origin
    alignment: Alignment
    residuals: ControlResiduals


def align_folder(
    root: Path,
    file: Path,
    *,
    check: Sequence[str] = (),
    heights: AltitudeDatum | None = None,
    monitor: Monitor | None = None,
) -> ControlRecord:
    """Align the model in ``root`` with the points of a ``gcp_list.txt``, and write ``control.json``.

    ``check``: patterns of the names of check points. ``heights``: what they are measured from; by default as
    the CRS says, else sea level. Raises ``InvalidInputError`` for a file that cannot be used, and for points
    that determine no alignment or contradict the model; an earlier ``control.json`` then stays.
    """
    monitor = monitor or Monitor()
    workspace = Workspace.existing(root)
    manifest = workspace.read_manifest()
    if manifest is None or manifest.cameras is None:
        raise InvalidInputError(
            f"{root} holds no cameras yet.", hint="Run the same `fvs reconstruct` again to go on.", path=root
        )
    try:
        points = read_gcp_list(read_text(file), file, check)
    except GcpListError as error:
        raise InvalidInputError(error.message, hint=error.hint, path=file) from error
    if heights is not None:
        points = points.model_copy(update={"altitude_datum": heights})
    sights = _Marked(workspace, manifest, points, monitor).sights()
    result = align_by_control(points, sights, near=_middle_of_gps(workspace, manifest))
    for finding in result.findings:
        monitor.warn(finding)
    record = ControlRecord(
        points=points, origin=result.origin, alignment=result.alignment, residuals=result.residuals
    )
    write_record(workspace.control, record)
    return record


def _middle_of_gps(workspace: Workspace, manifest: Manifest) -> GeodeticPosition | None:
    """The middle of the photographs' positions at sea level; None where they have none, or do not count."""
    if not manifest.settings.gps:
        return None
    names = (record.normalised_name for record in manifest.images.photographs)
    found = [
        GeodeticPosition(priors.latitude_deg, priors.longitude_deg, 0.0)
        for priors in map(workspace.read_priors, names)
        if priors.latitude_deg is not None and priors.longitude_deg is not None
    ]
    return middle_position(found) if found else None


def read_control(workspace: Workspace) -> ControlRecord | None:
    """The alignment by control points; None without one."""
    return read_record(workspace.control, ControlRecord, "Run `fvs align` again, or delete the file.")


class _Marked:
    """The marks of points in the registered photographs of a folder."""

    def __init__(
        self, workspace: Workspace, manifest: Manifest, points: ControlPoints, monitor: Monitor
    ) -> None:
        self._workspace, self._points = workspace, points
        self._folder = Path(manifest.images.folder)
        self._records = {record.normalised_name: record for record in manifest.images.photographs}
        aliases = {name: name for name in self._records}
        aliases |= {record.name: record.normalised_name for record in manifest.images.photographs}
        marked = sorted({mark.image for point in points.points for mark in point.marks})
        matches = match_names(marked, aliases)
        matches.require_unambiguous()
        self._names = matches.found
        for finding in matches.findings():
            monitor.warn(finding)
        if matches.missing:
            monitor.warn(Finding.of(FindingCode.MARKED_IMAGES_UNKNOWN, matches.missing))
        views = read_colmap(SfmFolder(workspace.sfm).sparse).views
        self._views = {view.name: view for view in views}
        self._orientations: dict[str, int] = {}

    def sights(self) -> Mapping[str, Sequence[Sight]]:
        """The marks in registered photographs, by the name of their point."""
        return {
            point.name: [
                sight_of(point.name, mark, view, self._orientation(view.name))
                for mark in point.marks
                if (view := self._views.get(self._names.get(mark.image, ""))) is not None
            ]
            for point in self._points.points
        }

    def _orientation(self, name: str) -> int:
        """How the photograph's stored pixels were turned for the reconstruction."""
        if name not in self._orientations:
            self._orientations[name] = self._read_orientation(self._records[name])
        return self._orientations[name]

    def _read_orientation(self, record: ImageRecord) -> int:
        copy = self._workspace.images / record.normalised_name
        with storage_errors(copy):
            if record.as_stored or hashlib.sha256(copy.read_bytes()).hexdigest() == record.sha256:
                return 1
        photograph = self._folder / record.name
        try:
            with Image.open(photograph) as image:
                return orientation_of(image)
        except OSError as error:
            raise InvalidInputError(
                f"{photograph} cannot be read, and only it tells which way its marks count.",
                hint="Put the photographs back where they were reconstructed from.",
                path=photograph,
            ) from error
