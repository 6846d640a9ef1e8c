"""Ranking of candidate views by a trained model."""

from dataclasses import asdict, dataclass, replace
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
from fvs_engine.pipeline.ground import above_ground, ground_check
from fvs_engine.pipeline.model import FolderModel, open_model
from fvs_engine.plan.plan_warnings import few_registrable, none_feasible, unknown_ground
from fvs_engine.records import Record
from fvs_engine.score import MedianFrequency, MedianFrequencyEstimate, MedianFrequencyFast, Scorer
from fvs_engine.score.selectors.renders import ScorerSelector
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.views import PinholeView
from fvs_schema.candidates import CandidateStatus
from fvs_schema.stages import Stage

SHEET_CANDIDATES = 12
"""Number of candidates on the contact sheet by default."""
MOST_ON_SHEET = 48
"""Maximum number: all renders of a sheet are in memory at once."""


@dataclass(frozen=True, kw_only=True)
class RankedPose(RankedCandidate):
    """A ranked candidate with its pose, model_from_camera, in the coordinates of imported cameras."""

    position: tuple[float, float, float]
    orientation_wxyz: tuple[float, float, float, float]


class RankingResult(Record):
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
    terrain: str | None = None,
    backend: str = "auto",
    monitor: Monitor | None = None,
) -> tuple[RankingResult, Path]:
    """Rank the candidates of a file by the model in ``root``; write ranking.json and contact_sheet.png.

    Without a file the held-out views and poses halfway between neighbouring training views are ranked.
    Those in matter, too close to it or unlikely to be registered get no rank unless ``rank_all``, see
    ``FeasibilityCheck``. ``safety`` is the least distance from matter, in units of the model. Candidates
    under the ground of a ``terrain``, see ``ground_check``, get no rank in any case.
    The contact sheet shows the first ``top``, at most ``MOST_ON_SHEET``. By the method
    ``median-frequency-fast`` the scores of the first ``top`` are exact.
    Returns the ranking and the folder written: ``out``, or ``ranking/`` in ``root``.
    Raises ``InvalidInputError`` for a file that cannot be used or a folder without a model, what
    ``ground_check`` raises, ``StorageError`` when ``out`` cannot be written, ``Cancelled``.
    """
    monitor = monitor or Monitor()
    model = open_model(root)
    candidates = candidates_of(model, candidates_file)
    ground = ground_check(model, candidates, terrain)
    above = above_ground(candidates, ground)
    rasterizer = create_rasterizer(backend, monitor)
    model = replace(model, gaussians=model.gaussians.to(rasterizer.device))
    selector = ScorerSelector(_scorer(method, top))
    ranked = model.rank(
        above,
        selector,
        rasterizer,
        space=model.space(safety, monitor=monitor),
        rank_all=rank_all,
        monitor=monitor,
    )
    in_order = (
        *ranked.candidates,
        *(RankedCandidate(None, name, None, CandidateStatus.UNDER_GROUND, None) for name in ground.under),
    )
    for finding in (
        *few_registrable(ranked.registrable, len(above)),
        *none_feasible(item.status for item in in_order),
        *unknown_ground(ground),
    ):
        monitor.warn(finding)
    by_name = {candidate.name: candidate for candidate in candidates}
    ranking = RankingResult(
        method=selector.name,
        iterations=model.iterations,
        gaussians=len(model.gaussians),
        width_px=candidates[0].camera.width,
        height_px=candidates[0].camera.height,
        candidates=tuple(_ranked_pose(item, by_name[item.name], model) for item in in_order),
    )
    folder = out or model.workspace.ranking
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    write_record(folder / "ranking.json", ranking)
    first = ranked.candidates[: min(top or SHEET_CANDIDATES, MOST_ON_SHEET)]
    shown = []
    for done, item in enumerate(first, start=1):
        monitor.check()
        shown.append(SheetEntry(item, model.render(by_name[item.name], rasterizer)))
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


def _ranked_pose(ranked: RankedCandidate, view: PinholeView, model: FolderModel) -> RankedPose:
    model_from_camera = view.camera_from_model.inverse()
    return RankedPose(
        **asdict(ranked),
        position=model.in_user_frame(tuple(model_from_camera.translation)),
        orientation_wxyz=tuple(quaternion_from_matrix(model_from_camera.rotation).tolist()),
    )
