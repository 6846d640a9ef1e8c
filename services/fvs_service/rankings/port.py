"""The port to the runners: ranks, plans and renders views with the model of a scene.

Views are in the model frame: only the gateway knows the world frame. The requests and results are also the
messages of the runners' protocol, so poses are not converted on the way.
"""

from collections.abc import AsyncGenerator, Mapping
from typing import Literal, Protocol, TypeAlias

from pydantic import Field

from fvs_engine.candidates import CandidateScore, RankedCandidate
from fvs_engine.geometry import PinholeCamera
from fvs_engine.plan.plan_records import Expectation, Plan
from fvs_engine.plan.volumes import Volume
from fvs_engine.records import Record
from fvs_engine.views import PinholeView
from fvs_schema.renders import RenderFormat, ViewImage
from fvs_service.rankings.packed_views import PackedViews


class ModelRequest(Record):
    """A request to the model of one scene. API key and timeout do not affect the result.

    ``endpoint`` is that of the scene's runner, if it is known already; it is not sent.
    """

    scene_id: str
    endpoint: str | None = Field(default=None, exclude=True, repr=False)
    snapshot_id: str
    api_key: str = ""
    timeout_s: float = 60.0


class Clearance(Record):
    """Constraints of vehicles, in the model frame: ``safety``, their distance from matter, and ``no_fly``."""

    safety: float = 0.0
    no_fly: tuple[Volume, ...] = ()


class RankViews(ModelRequest):
    """Rank ``views``, named by candidate id, of one camera, by ``method`` with the model of a scene.

    Views that are not feasible (``fvs_engine.score.feasibility``), or not clear by ``clearance``, are ranked
    only with ``rank_all``. ``distances`` (by id, in metres) break ties. ``budget`` is how many photographs
    are still to be taken. ``taken`` are views that count as visited, though they have no image yet. When
    ``streamed``, scores are sent before the result.

    For methods that plan: ``here`` is where the camera is, ``reach`` the length of a step (None: any), both
    in the model frame, and ``later`` are views that are out of reach now.
    """

    kind: Literal["rank"] = "rank"
    method: str
    views: PackedViews
    clearance: Clearance = Clearance()
    rank_all: bool = False
    distances: Mapping[str, float] = {}
    taken: PackedViews = ()
    later: PackedViews = ()
    here: tuple[float, float, float] | None = None
    reach: float | None = None
    budget: int = 1
    seed: int = 0
    streamed: bool = False


class RankedViews(Record):
    """All candidates in order, and the model that scored them: that of a snapshot, after ``iterations``.

    ``fallback`` names the rule that ordered candidates when the method could not, else None. ``registrable``:
    how many are likely to be registered (None: nothing to register with). ``seconds`` is the time of scoring,
    ``waited_s`` that in the runner's queue.
    """

    snapshot_id: str
    iterations: int
    gaussians: int
    candidates: tuple[RankedCandidate, ...] = ()
    fallback: str | None = None
    registrable: int | None = None
    seconds: float = 0.0
    waited_s: float = 0.0


RankingSteps: TypeAlias = AsyncGenerator[tuple[CandidateScore, ...] | RankedViews, None]
"""Scores as they become known, and last the ranking."""


class RenderView(ModelRequest):
    """Make an image of one view of a snapshot; the result over the protocol is the file in base 64."""

    kind: Literal["render"] = "render"
    view: PinholeView
    image: ViewImage = ViewImage.RENDER
    format: RenderFormat = RenderFormat.PNG


class UpdateQuality(Record):
    """The images (digests) that were new in a snapshot, and how well the one before rendered them.

    ``psnr_db`` is None where there was none before.
    """

    images: tuple[str, ...]
    psnr_db: float | None


class ViewsInVolume(Record):
    """Views of one ``camera`` to generate: ``count`` in a ``volume``, which look at ``aim``.

    ``aim`` is a point, the middle of the matter or its nearest part; ``level``: with a level camera. ``up``
    is the upward direction. All in the model frame.
    """

    volume: Volume
    count: int
    camera: PinholeCamera
    up: tuple[float, float, float]
    aim: Literal["middle", "nearest"] | tuple[float, float, float] = "middle"
    level: bool = False


class GenerateViews(ModelRequest):
    """Generate ``views``, clear of matter by ``clearance``."""

    kind: Literal["generate"] = "generate"
    views: ViewsInVolume
    clearance: Clearance


class GeneratedViews(Record):
    """Views, named by candidate id, in the model frame."""

    views: PackedViews


class PlanViews(ModelRequest):
    """Plan a flight through some of ``views``, named by candidate id; all in the model frame and its unit.

    With a ``clearance`` legs go around what is in the way; without one they are straight. ``targets`` are
    what the model must serve (empty: its images and the views), ``taken`` as in ``RankViews``, ``starts``
    where vehicles are (empty: one at the last image), ``budget``, ``distance``, ``home`` and ``scale`` as in
    the engine's ``Budget``. ``updates`` are the scene's so far, the oldest first: they calibrate the
    forecast.
    """

    kind: Literal["plan"] = "plan"
    views: PackedViews
    clearance: Clearance | None = None
    targets: PackedViews = ()
    taken: PackedViews = ()
    starts: tuple[tuple[float, float, float], ...] = ()
    budget: int
    distance: float | None = None
    home: bool = False
    scale: float = 1.0
    updates: tuple[UpdateQuality, ...] = ()


class ForecastViews(ModelRequest):
    """Forecast ``views``, named by candidate id, or at most ``surface`` places of the surface (None: views).

    ``after`` are views that count as visited, ``updates`` as in ``PlanViews``.
    """

    kind: Literal["forecast"] = "forecast"
    views: PackedViews = ()
    surface: int | None = None
    after: PackedViews = ()
    updates: tuple[UpdateQuality, ...] = ()


class ViewForecasts(Record):
    """What to expect of each view, and the ``places`` in the model frame where they are of the surface.

    Without calibration no view has a forecast of its PSNR.
    """

    calibrated: bool
    views: tuple[Expectation, ...]
    places: tuple[tuple[float, float, float], ...] = ()


class SceneRunners(Protocol):
    """The runners of all scenes: finds the one that has a scene's lease, or has a worker start one.

    Equal concurrent requests are computed once. A call that is cancelled stops the computation, unless others
    wait for it. All methods raise ``UnavailableError`` when no runner can answer now, ``LimitExceededError``
    when there are too many requests (both with ``retry_after_s``), ``DeadlineError`` after ``timeout_s``, and
    what ``fvs_service.engine_errors.from_engine`` makes of the engine's errors.
    """

    async def rank(self, request: RankViews) -> RankedViews:
        """Rank views; the result has every id of the request exactly once."""
        ...

    def stream(self, request: RankViews) -> RankingSteps:
        """Rank views as ``rank`` does; the scores that are known come before the result.

        When the runner moves meanwhile, scoring begins again, and scores come a second time.
        """
        ...

    async def render(self, request: RenderView) -> bytes:
        """The view's image, as a file of the request's format."""
        ...

    async def generate(self, request: GenerateViews) -> GeneratedViews:
        """Generate candidates in a volume; nothing is rendered."""
        ...

    async def plan(self, request: PlanViews) -> Plan:
        """Plan a flight; nothing is rendered."""
        ...

    async def forecast(self, request: ForecastViews) -> ViewForecasts:
        """Forecast views in the order of the request, or places of the surface; nothing is rendered."""
        ...

    async def close(self) -> None:
        """Close all connections; to be called on the event loop of the calls."""
        ...
