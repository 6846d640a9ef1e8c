"""What the gateway asks of the runner that holds a scene's warm model.

Everything here is in the model's frame: the gateway alone knows the world. ``fvs_engine.geometry`` types are
used as they are, so neither side converts twice.
"""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

from fvs_engine.geometry import PinholeCamera, RigidTransform


class Picture(StrEnum):
    """What can be drawn of a view."""

    RENDER = "render"
    SPECTRUM = "spectrum"


@dataclass(frozen=True, eq=False)
class RunnerView:
    """A view to be scored or drawn; ``distance_m`` breaks ties, None when it is not known."""

    id: str
    camera: PinholeCamera
    camera_from_model: RigidTransform
    distance_m: float | None = None


@dataclass(frozen=True, eq=False)
class RankViews:
    """Score ``views`` by ``method`` with the model of a scene.

    ``snapshot_id`` is the snapshot to use when ``pinned``; else the newest good state of the model may be
    used, which has the same frame. ``budget`` is how many photographs are still to be taken.
    """

    scene_id: str
    snapshot_id: str
    method: str
    views: tuple[RunnerView, ...]
    pinned: bool = False
    budget: int = 1
    seed: int = 0


@dataclass(frozen=True)
class RankedView:
    """One view's place: ``status`` is ``ranked``, ``low-coverage`` or ``out-of-model``."""

    id: str
    rank: int | None
    score: float | None
    status: str
    coverage: float | None


@dataclass(frozen=True)
class RankedViews:
    """All views, the first to be photographed first, and the state of the model that was used.

    ``snapshot_id`` is the snapshot that the state was, or grew from; ``iterations`` says how far it had come.
    ``fallback`` names the rule that chose when the method could not, else None. ``seconds`` is what scoring
    took, ``waited_s`` how long other questions to the same runner went before.
    """

    snapshot_id: str
    iterations: int
    gaussians: int
    views: tuple[RankedView, ...]
    fallback: str | None = None
    seconds: float = 0.0
    waited_s: float = 0.0


@dataclass(frozen=True, eq=False)
class DrawView:
    """Draw one view of a snapshot as a PNG."""

    scene_id: str
    snapshot_id: str
    view: RunnerView
    picture: Picture = field(default=Picture.RENDER)


class SceneRunners(Protocol):
    """The runners of all scenes: finds the one that holds a scene's lease, or has a worker warm it.

    Called from many threads at once. Both raise ``UnavailableError`` (with ``retry_after_s``) when no runner
    can answer now, and what ``fvs_service.errors.from_engine`` makes of the engine's errors.
    """

    @property
    def methods(self) -> tuple[str, ...]:
        """The names of the scorers and selectors that ``rank`` takes."""
        ...

    def rank(self, request: RankViews) -> RankedViews:
        """Rank views; every id of the request comes back exactly once."""
        ...

    def draw(self, request: DrawView) -> bytes:
        """A PNG of the view."""
        ...
