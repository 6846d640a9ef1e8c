"""Evidence for given views from the matches of their images, and sparse points where they have none."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap

from fvs_engine.errors import InvalidInputError, ReconstructionError
from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.images.names import match_files
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.mapping import read_model_evidence, registered_names
from fvs_engine.sfm.batch.reconstruct import SfmResult, finished_result
from fvs_engine.sfm.colmap.database import image_ids, verified_pair_count
from fvs_engine.sfm.colmap.imports import fit_camera
from fvs_engine.sfm.colmap.model import from_pycolmap, open_colmap, to_pycolmap
from fvs_engine.sfm.jobs import TriangulatePoints
from fvs_engine.sfm.matching.features import extract_features
from fvs_engine.sfm.matching.match import match_features
from fvs_engine.sfm.quarantine import CulpritError
from fvs_engine.sfm.reconstruction import PointCloud, Reconstruction
from fvs_engine.sfm.report import GIVEN, CandidateReport, SfmReport
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.sfm.stages import SfmFolder, Stages, fresh_folder, rename_over
from fvs_engine.sfm.verification.pair_check import MIN_PAIR_MATCHES
from fvs_engine.views import AnyView
from fvs_schema.findings import Finding, FindingCode, Severity
from fvs_schema.stages import Stage

_MIN_VIEWS = 2


def triangulate(
    cameras: Reconstruction, image_dir: Path, out_dir: Path, settings: SfmSettings, monitor: Monitor
) -> SfmResult:
    """Triangulate points for the views of ``cameras``, whose poses and intrinsics do not change; resumable.

    ``images.names.match_files`` finds the views' images in ``image_dir``; views without one are left out and
    named in the report. A view's camera is scaled to the image's size. Features and matches are those of
    ``reconstruct``. Points that ``cameras`` have are kept instead. The report has the matches' evidence for
    the given poses, with a warning when they contradict.

    Raises ``InvalidInputError`` for fewer than two views, ambiguous names and images of another shape than
    their cameras, ``ReconstructionError`` when no point is seen twice, ``Cancelled``.
    """
    quarantine = SfmFolder(out_dir).quarantine
    while True:
        try:
            return _triangulate(cameras, image_dir, out_dir, settings, monitor)
        except CulpritError as culprit:
            quarantine.add(culprit)


def _triangulate(
    cameras: Reconstruction, image_dir: Path, out_dir: Path, settings: SfmSettings, monitor: Monitor
) -> SfmResult:
    views, missing = _views_with_images(cameras.views, image_dir)
    quarantined = SfmFolder(out_dir).quarantine.reasons
    views = [view for view in views if view.name not in quarantined]
    if len(views) < _MIN_VIEWS:
        raise InvalidInputError(
            f"{len(views)} of the {len(cameras.views)} given cameras have a usable image in {image_dir}"
            + (f"; {missing[0]} has none." if missing else "."),
            hint="Give the folder of photographs that these cameras were computed from.",
            path=image_dir,
        )
    names = [view.name for view in views]
    stages = Stages(SfmFolder(out_dir), image_dir, settings, monitor)
    stages.open(names, _MIN_VIEWS)
    finished = finished_result(stages.folder)
    if (
        finished is not None
        and finished.report.mapper == GIVEN
        and _same(finished.reconstruction, views, cameras.points)
    ):
        return finished
    extract_features(stages, names)
    match_features(stages, names)
    if len(cameras.points) > 0:
        ids = image_ids(stages.folder.database)
        posed = [view for view in views if view.name in ids]
        model = to_pycolmap(posed, points=cameras.points, image_ids=ids)
        error_px = float(np.mean(cameras.point_errors_px))
    else:
        model = _with_points(stages, views)
        error_px = model.compute_mean_reprojection_error()
    report = _report(stages, model, error_px, names, missing)
    stages.write_model(model)
    write_text_atomically(stages.folder.report, report.model_dump_json(indent=2))
    return SfmResult(from_pycolmap(model), report, stages.folder.sparse)


def _same(finished: Reconstruction, views: Sequence[AnyView], points: PointCloud) -> bool:
    """Whether a finished result has these views and points, and not those that a file held earlier."""
    if len(points) > 0 and not np.array_equal(
        np.sort(finished.points.xyz, axis=0), np.sort(points.xyz, axis=0)
    ):
        return False
    return len(finished.views) == len(views) and all(
        (old.name, old.camera) == (new.name, new.camera)
        and np.allclose(old.camera_from_model.matrix, new.camera_from_model.matrix, rtol=0, atol=1e-9)
        for old, new in zip(finished.views, views, strict=True)
    )


def _views_with_images(views: Sequence[AnyView], image_dir: Path) -> tuple[list[AnyView], tuple[str, ...]]:
    matches = match_files([view.name for view in views], image_dir)
    found = [
        replace(view, name=name, camera=fit_camera(view.camera, image_dir / name))
        for view in views
        if (name := matches.found.get(view.name)) is not None
    ]
    return sorted(found, key=lambda view: view.name), matches.missing


def _with_points(stages: Stages, views: Sequence[AnyView]) -> pycolmap.Reconstruction:
    folder = stages.folder
    posed = folder.root / "given"
    ids = image_ids(folder.database)
    known = {view.name: view for view in views if view.name in ids}
    target = folder.mapping(GIVEN)
    partial = folder.partial(target)

    def request(some: Sequence[str]) -> TriangulatePoints:
        to_pycolmap([known[name] for name in some], image_ids=ids).write_binary(fresh_folder(posed))
        return TriangulatePoints(
            database=folder.database,
            image_dir=stages.image_dir,
            model_dir=posed,
            out_dir=fresh_folder(partial),
            threads=stages.settings.threads,
        )

    stages.monitor.report(Stage.TRIANGULATION, 0, 1)
    with stages.timed("triangulation"):
        points = stages.native_over(list(known), request)
    rename_over(partial, target)
    stages.monitor.report(Stage.TRIANGULATION, 1, 1)
    if points == 0:
        raise ReconstructionError(
            "No point is seen from two of the given cameras.",
            hint="Check that the poses belong to these images, and that a transforms.json has OpenGL axes, "
            "camera to world.",
        )
    return open_colmap(target)


def _report(
    stages: Stages,
    model: pycolmap.Reconstruction,
    error_px: float,
    names: Sequence[str],
    missing: Sequence[str],
) -> SfmReport:
    evidence = read_model_evidence(stages).of(model, stages.monitor)
    doubt = evidence is None or evidence.match_support < stages.settings.gate.min_match_support
    severity = Severity.DOUBT if doubt else Severity.NOTE
    reason = (
        Finding.of(FindingCode.NO_PAIRS, severity=severity)
        if evidence is None
        else Finding.of(FindingCode.MATCH_SUPPORT, severity=severity, support=evidence.match_support)
    )
    warnings = [*stages.warnings, *stages.folder.quarantine.reasons.values()]
    if doubt:
        warnings.append(reason)
    if missing:
        warnings.append(Finding.of(FindingCode.NO_IMAGE_OF_CAMERA, missing))
    registered = registered_names(model)
    candidate = CandidateReport(
        mapper=GIVEN,
        registered=len(registered),
        points=model.num_points3D(),
        mean_reprojection_error_px=error_px,
        evidence=evidence,
        verdict="doubtful" if doubt else "accepted",
        reasons=(reason,),
    )
    return SfmReport(
        mapper=GIVEN,
        verdict=candidate.verdict,
        images=len(names),
        registered=len(registered),
        unregistered=tuple(name for name in names if name not in registered),
        points=model.num_points3D(),
        mean_reprojection_error_px=error_px,
        pairs_matched=stages.pairs_matched,
        pairs_verified=verified_pair_count(stages.folder.database, MIN_PAIR_MATCHES),
        candidates=(candidate,),
        agreements=(),
        other_components=(),
        warnings=tuple(warnings),
        seconds=stages.seconds,
    )
