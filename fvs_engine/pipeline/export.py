"""Export of a trained model for other programs: Gaussians, cameras and points, where they are on Earth."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from fvs_engine.choices import ExportFormat, ExportFrame
from fvs_engine.errors import InvalidInputError
from fvs_engine.export.cameras import write_cameras, write_moved_colmap
from fvs_engine.export.crs import ProjectedCrs, geoid_height_m
from fvs_engine.export.footprints import write_footprints
from fvs_engine.export.gltf import GLTF_FROM_CAMERA_AXES, GLTF_FROM_WORLD, write_gltf
from fvs_engine.export.laz import write_laz
from fvs_engine.export.placement import GeoreferenceRecord, Placement
from fvs_engine.export.tiles import write_tiles
from fvs_engine.files.record import write_record
from fvs_engine.files.storage import storage_errors
from fvs_engine.geometry import SimilarityTransform
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.export_source import ExportSource, opened
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.moved import moved
from fvs_engine.splat.ply import write_ply
from fvs_engine.splat.spz import position_step, write_spz
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.scenes import AlignmentStatus, AltitudeDatum

_FILES: Mapping[ExportFormat, str] = {
    "ply": "point_cloud.ply",
    "spz": "point_cloud.spz",
    "gltf": "point_cloud.glb",
    "3d-tiles": "tileset.json",
    "cameras": "cameras.json",
    "colmap": "colmap",
    "geojson": "cameras.geojson",
    "laz": "points.laz",
}
_ON_EARTH: frozenset[ExportFormat] = frozenset({"3d-tiles", "geojson", "laz"})
"""Formats that have no meaning in the model frame."""
GEOREFERENCE = "georeference.json"
_MAX_STEP_M = 0.001


@dataclass(frozen=True, eq=False)
class _Export:
    """A model in the frame of its export; ``placement`` and ``crs`` are None in the model frame."""

    source: ExportSource
    placement: Placement | None
    crs: ProjectedCrs | None

    @property
    def frame_from_model(self) -> SimilarityTransform:
        return SimilarityTransform.identity() if self.placement is None else self.placement.world_from_model

    @cached_property
    def gaussians(self) -> Gaussians:
        return moved(self.source.gaussians, self.frame_from_model)

    def warnings(self, wanted: Sequence[ExportFormat]) -> Iterator[Finding]:
        """What limits the use of the formats in the world frame."""
        if self.placement is None:
            return
        if self.placement.alignment.status is AlignmentStatus.ILL_CONDITIONED:
            yield Finding.of(FindingCode.ILL_CONDITIONED)
        if "3d-tiles" in wanted and self.placement.origin.altitude_datum is not AltitudeDatum.ELLIPSOID:
            surface = self.placement.origin.altitude_datum.in_words
            yield Finding.of(FindingCode.HEIGHTS_NOT_ELLIPSOIDAL, surface=surface)
        step_m = position_step(self.gaussians) if {"spz", "3d-tiles"} & set(wanted) else 0.0
        if step_m > _MAX_STEP_M:
            farthest_m = float(self.gaussians.means.abs().max())
            yield Finding.of(FindingCode.COARSE_POSITIONS, step_m=step_m, farthest_m=farthest_m)

    def write(self, kind: ExportFormat, path: Path) -> None:
        """Write one format; those that need a place on Earth have it."""
        writers: Mapping[ExportFormat, Callable[[], None]] = {
            "ply": lambda: write_ply(path, self.gaussians),
            "spz": lambda: write_spz(path, self.gaussians),
            "gltf": lambda: write_gltf(path, self._in_gltf()),
            "cameras": lambda: write_cameras(path, self.source.views, self.frame_from_model),
            "colmap": lambda: write_moved_colmap(path, self.source.colmap, self.frame_from_model),
        }
        if self.placement is not None and self.crs is not None:
            placement, crs, points = self.placement, self.crs, self.source.points
            writers = {
                **writers,
                "3d-tiles": lambda: write_tiles(path, self.gaussians, placement),
                "geojson": lambda: write_footprints(path, self.source.views, points.xyz, placement),
                "laz": lambda: write_laz(path, points, placement, crs),
            }
        writers[kind]()

    def _in_gltf(self) -> Gaussians:
        gltf_from_frame = GLTF_FROM_CAMERA_AXES if self.placement is None else GLTF_FROM_WORLD
        return moved(self.source.gaussians, gltf_from_frame @ self.frame_from_model)


def export_model(
    root: Path,
    *,
    formats: Sequence[ExportFormat] = (),
    frame: ExportFrame = "world",
    epsg: int | None = None,
    geoid: Path | float | None = None,
    clean: bool = False,
    out: Path | None = None,
    monitor: Monitor | None = None,
) -> tuple[Path, ...]:
    """Write the model of ``root`` in the ``formats`` (none: all that the frame has) and return the paths.

    ``root`` is an output folder, or one with the artifacts of a snapshot. The world frame is metres east,
    north and up of the middle of the photographs' positions, or of the scene's origin if that is near;
    ``georeference.json`` says where that is. ``epsg``: the CRS of points, by default UTM. ``geoid``, a grid
    or a height, makes altitudes above sea level those above the ellipsoid, which globes have. ``clean``
    leaves floaters out (``splat.floaters``). The files go to ``out``, or to ``export/`` in ``root``.

    Raises what ``opened`` raises, ``InvalidInputError`` for a model without a place on Earth, formats
    that need one, a CRS or geoid that cannot be used, and ``StorageError``.
    """
    monitor = monitor or Monitor()
    wanted = tuple(dict.fromkeys(formats)) or tuple(
        kind for kind in _FILES if frame == "world" or kind not in _ON_EARTH
    )
    misplaced = [kind for kind in wanted if frame == "model" and kind in _ON_EARTH]
    if misplaced:
        raise InvalidInputError(
            f"{misplaced[0]} needs a place on Earth, which the model frame has not.",
            hint="Export it in the world frame.",
        )
    if out is not None and out.resolve() == root.resolve():
        raise InvalidInputError(
            f"Files of {out}, the model itself, would be overwritten.",
            hint="Choose another output folder.",
            path=out,
        )
    chosen = None if epsg is None else ProjectedCrs(epsg)
    with opened(root) as source:
        placement = None if frame == "model" else _placement(source, geoid)
        crs = None
        if placement is not None:
            crs = chosen or ProjectedCrs.at(placement.position)
            crs.require_covers(placement.position)
        export = _Export(source.without_floaters(monitor) if clean else source, placement, crs)
        for finding in export.warnings(wanted):
            monitor.warn(finding)
        return _write(export, wanted, out or Workspace(root).export, monitor)


def _placement(source: ExportSource, geoid: Path | float | None) -> Placement:
    placement = source.place()
    if geoid is not None:
        placement = placement.on_ellipsoid(geoid_height_m(geoid, placement.position))
    centres = [view.centre for view in source.views]
    return placement.near(placement.world_from_model.apply(np.median(centres, axis=0)))


def _write(
    export: _Export, wanted: Sequence[ExportFormat], folder: Path, monitor: Monitor
) -> tuple[Path, ...]:
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for kind in wanted:
            monitor.check()
            export.write(kind, folder / _FILES[kind])
    paths = [folder / _FILES[kind] for kind in wanted]
    if export.placement is not None and export.crs is not None:
        write_record(folder / GEOREFERENCE, GeoreferenceRecord.of(export.placement, export.crs))
        paths.append(folder / GEOREFERENCE)
    return tuple(paths)
