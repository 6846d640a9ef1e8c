"""Ranking of candidate views by a trained model."""

import logging
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from pydantic import AwareDatetime, Field

from fvs_engine.candidates import RankedCandidate
from fvs_engine.choices import RankingMethod
from fvs_engine.files.record import write_record
from fvs_engine.files.storage import storage_errors
from fvs_engine.geometry import quaternion_from_matrix
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.candidates import candidates_of
from fvs_engine.pipeline.contact_sheet import SheetEntry, contact_sheet
from fvs_engine.pipeline.model import open_model
from fvs_engine.plan.clearance import FreeSpace
from fvs_engine.plan.registrable import ELSEWHERE, NEARER, few_registrable, none_feasible
from fvs_engine.records import Record
from fvs_engine.scene.matter import matter_of
from fvs_engine.score import MedianFrequency, MedianFrequencyEstimate, MedianFrequencyFast, Scorer, rank
from fvs_engine.score.feasibility import FeasibilityCheck
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.render import render_color
from fvs_engine.splat.torch_threads import torch_threads_for
from fvs_engine.views import PinholeView
from fvs_schema.stages import Stage

_log = logging.getLogger(__name__)

SHEET_CANDIDATES = 12
"""Number of candidates on the contact sheet by default."""
MOST_ON_SHEET = 48
"""Maximum number: all renders of a sheet are in memory at once."""


@dataclass(frozen=True, kw_only=True)
class RankedPose(RankedCandidate):
    """A ranked candidate with its pose, model_from_camera."""

    position: tuple[float, float, float]
    orientation_wxyz: tuple[float, float, float, float]


class Ranking(Record):
    """``ranking.json``: the candidates in order, and how they were compared."""

    version: int = 1
    created: AwareDatetime = Field(default_factory=lambda: datetime.now(UTC))
    method: str
    iterations: int
    gaussians: int
    width_px: int
    height_px: int
    candidates: tuple[RankedPose, ...]


def rank_candidates(
    root: Path,
    candidates_file: Path | None,
    *,
    out: Path | None = None,
    top: int | None = None,
    method: RankingMethod = "median-frequency",
    safety: float = 0.0,
    rank_all: bool = False,
    backend: str = "auto",
    monitor: Monitor | None = None,
) -> tuple[Ranking, Path]:
    """Rank the candidates of a file by the model in ``root``; write ranking.json and contact_sheet.png.

    Without a file the held-out views and poses halfway between neighbouring training views are ranked.
    Those in matter, too close to it or unlikely to be registered get no rank, but with ``rank_all``: see
    ``FeasibilityCheck``. ``safety`` is the least distance from matter, in units of the model.
    The contact sheet shows the first ``top``, at most ``MOST_ON_SHEET``; so many are exact by the ``method``
    ``median-frequency-fast``. Returns the ranking and the folder
    written: ``out``, or ``ranking/`` in ``root``. Raises ``InvalidInputError`` for a file that cannot be
    used or a folder without a model, ``StorageError`` when ``out`` cannot be written, ``Cancelled``.
    """
    monitor = monitor or Monitor()
    model = open_model(root)
    candidates = candidates_of(model, candidates_file)
    rasterizer = create_rasterizer(backend, monitor)
    gaussians = model.gaussians.to(rasterizer.device)
    scorer = _scorer(method, top)
    check = FeasibilityCheck(model.gaussians, model.training_views, model.observations)
    assessment = check.assess(
        candidates, FreeSpace(matter_of(model.gaussians), safety, monitor=monitor), monitor
    )
    scored = candidates if rank_all else assessment.feasible(candidates)
    with torch_threads_for(rasterizer.device):
        scores = scorer.score(gaussians, scored, rasterizer, monitor=monitor) if scored else ()
    ranked = assessment.complete(rank(scores))
    for message, hint in (
        (few_registrable(assessment.registrable, len(candidates)), NEARER),
        (none_feasible(item.status for item in ranked), ELSEWHERE),
    ):
        if message is not None:
            _log.warning("%s %s", message, hint)
    by_name = {candidate.name: candidate for candidate in candidates}
    ranking = Ranking(
        method=scorer.name,
        iterations=model.training.iterations,
        gaussians=len(gaussians),
        width_px=candidates[0].camera.width,
        height_px=candidates[0].camera.height,
        candidates=tuple(_ranked_pose(item, by_name[item.name]) for item in ranked),
    )
    folder = out or model.workspace.ranking
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    write_record(folder / "ranking.json", ranking)
    first = ranked[: min(top or SHEET_CANDIDATES, MOST_ON_SHEET)]
    shown = []
    for done, item in enumerate(first, start=1):
        monitor.check()
        shown.append(SheetEntry(item, render_color(gaussians, by_name[item.name], rasterizer)))
        monitor.report(Stage.CONTACT_SHEET, done, len(first))
    contact_sheet(folder / "contact_sheet.png", shown, title=f"Next views · {root.absolute().name}")
    return ranking, folder


def _scorer(method: RankingMethod, top: int | None) -> Scorer:
    match method:
        case "median-frequency":
            return MedianFrequency()
        case "median-frequency-fast":
            return MedianFrequencyFast() if top is None else MedianFrequencyFast(first=top)
        case "median-frequency-estimate":
            return MedianFrequencyEstimate()


def _ranked_pose(ranked: RankedCandidate, view: PinholeView) -> RankedPose:
    model_from_camera = view.camera_from_model.inverse()
    return RankedPose(
        **asdict(ranked),
        position=tuple(model_from_camera.translation.tolist()),
        orientation_wxyz=tuple(quaternion_from_matrix(model_from_camera.rotation).tolist()),
    )
