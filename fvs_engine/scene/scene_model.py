"""A trained model of a scene with its views: it ranks candidates, plans flights and renders."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from fvs_engine.candidates import RankedCandidate
from fvs_engine.geometry import PinholeCamera
from fvs_engine.monitor import Monitor
from fvs_engine.plan.clearance import FreeSpace, Matter
from fvs_engine.plan.familiarity import Observations
from fvs_engine.plan.flight import free_legs
from fvs_engine.plan.forecast import Seen
from fvs_engine.plan.plan import make_plan
from fvs_engine.plan.plan_records import Plan
from fvs_engine.plan.plan_warnings import candidates_too_close
from fvs_engine.plan.reach import Reach
from fvs_engine.plan.targets import Targets
from fvs_engine.plan.tours import Budget
from fvs_engine.plan.volumes import AnyVolume
from fvs_engine.score.appearance import with_appearance
from fvs_engine.score.feasibility import FeasibilityCheck, matter_of
from fvs_engine.score.selectors.interface import SelectionContext, Selector, select
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.floaters import without_floaters
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.ply import write_ply
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.render import log_magnitude, render_color
from fvs_engine.splat.spz import write_spz
from fvs_engine.splat.trainer import Trainer, read_gaussians
from fvs_engine.splat.views import TrainingView
from fvs_engine.views import PinholeView

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Situation:
    """Where a vehicle is that asks for a ranking, and what it can still do; all in the model frame.

    ``here`` is its camera centre [3] (None: at the last image) and ``reach`` what a step can reach (None:
    everything). ``budget``: how many photographs are still to be taken. ``taken`` views count as visited,
    though they have no image yet; ``later`` are views out of reach now. ``distances`` (by name, in the
    caller's unit) break ties. ``seed`` is the only source of chance.
    """

    here: Array | None = None
    reach: Reach | None = None
    budget: int = 1
    taken: tuple[PinholeView, ...] = ()
    later: tuple[PinholeView, ...] = ()
    distances: Mapping[str, float] | None = None
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Ranking:
    """All candidates in order.

    ``fallback`` names the rule that ordered candidates when the method could not, else None. ``registrable``:
    how many are likely to be registered (None: poses are known).
    """

    candidates: tuple[RankedCandidate, ...]
    fallback: str | None
    registrable: int | None


@dataclass(frozen=True, eq=False, kw_only=True)
class SceneModel:
    """Gaussians after ``iterations`` of training, and what ranks, plans and renders with them.

    They are rendered with harmonics up to ``sh_degree``. ``views`` are those that they were trained on, named
    after their images; ``held_out`` are other views of the model. ``read_observations`` reads the sparse
    points and who saw them, which renders do not need (None: poses are known). A model never changes.
    """

    gaussians: Gaussians
    sh_degree: int
    iterations: int
    views: tuple[PinholeView, ...] = ()
    held_out: tuple[PinholeView, ...] = ()
    read_observations: Callable[[], Observations | None] = lambda: None

    @classmethod
    def of(cls, trainer: Trainer) -> "SceneModel":
        """The model of a finished training; it shares the trainer's tensors."""
        tensors = {name: tensor.detach() for name, tensor in trainer.gaussians.tensors().items()}
        return cls(gaussians=Gaussians(**tensors), sh_degree=trainer.sh_degree, iterations=trainer.iteration)

    @classmethod
    def read(cls, checkpoint: Path, device: torch.device) -> "SceneModel":
        """The model of a finished training's checkpoint; raises ``StorageError`` when it cannot be read."""
        gaussians, sh_degree, iterations = read_gaussians(checkpoint)
        return cls(gaussians=gaussians.to(device), sh_degree=sh_degree, iterations=iterations)

    def without_floaters(
        self,
        views: Sequence[TrainingView],
        points: PointCloud,
        rasterizer: Rasterizer,
        monitor: Monitor,
    ) -> "SceneModel":
        """The model, trained on ``views`` from ``points``, without its floaters. Raises ``Cancelled``."""
        masks = {view.name: view.mask for view in views if view.mask is not None}
        kept = without_floaters(self.gaussians, views, points.xyz, rasterizer, monitor, masks)
        return replace(self, gaussians=kept)

    @cached_property
    def registered(self) -> tuple[PinholeView, ...]:
        """All views of the model."""
        if not self.held_out:
            return self.views
        return tuple(sorted((*self.views, *self.held_out), key=lambda view: view.name))

    @cached_property
    def visited(self) -> tuple[PinholeView, ...]:
        """The views, with a prefix that keeps their names apart from those of candidates."""
        return tuple(replace(view, name=f"visited:{view.name}") for view in self.views)

    @property
    def camera(self) -> PinholeCamera:
        """The camera that most views have."""
        return usual_camera(self.views)

    @property
    def up(self) -> Array:
        """The direction [3] that is up in most views; not a unit vector."""
        rotations = np.stack([view.camera_from_model.rotation for view in self.views])
        return np.asarray(-rotations[:, 1].mean(axis=0))

    @cached_property
    def observations(self) -> Observations | None:
        """The sparse points and the cameras that saw them; None where poses are known."""
        return self.read_observations()

    @cached_property
    def matter(self) -> Matter:
        """What the Gaussians show to be solid."""
        return matter_of(self.gaussians)

    @cached_property
    def _feasibility(self) -> FeasibilityCheck:
        return FeasibilityCheck(self.gaussians, self.visited, self.observations)

    def space(
        self, safety: float = 0.0, no_fly: Sequence[AnyVolume] = (), monitor: Monitor | None = None
    ) -> FreeSpace:
        """Where a vehicle may be: farther than ``safety`` from matter, and in no ``no_fly`` zone."""
        return FreeSpace(self.matter, safety, no_fly, monitor=monitor or Monitor())

    def rank(
        self,
        candidates: Sequence[PinholeView],
        selector: Selector,
        rasterizer: Rasterizer,
        *,
        space: FreeSpace | None = None,
        situation: Situation | None = None,
        rank_all: bool = False,
        monitor: Monitor | None = None,
    ) -> Ranking:
        """Rank the feasible ones of ``candidates``, or with ``rank_all`` all of them; the others follow.

        Stages ``feasibility`` and the selector's. Raises what ``select`` raises, and ``Cancelled``.
        """
        situation = situation or Situation()
        assessment = self._feasibility.assess(candidates, space or self.space(monitor=monitor), monitor)
        scored = tuple(candidates) if rank_all else assessment.feasible(candidates)
        selection = None
        if scored:
            context = self._context(scored, situation, rasterizer)
            selection = select(context, selector, situation.distances or {}, monitor)
        return Ranking(
            assessment.complete(selection.ranked if selection else (), situation.distances),
            selection.fallback if selection else None,
            assessment.registrable,
        )

    def _context(
        self, candidates: tuple[PinholeView, ...], situation: Situation, rasterizer: Rasterizer
    ) -> SelectionContext:
        visited = (*self.visited, *situation.taken)
        names = (*(view.name for view in visited), *sorted(view.name for view in candidates))
        return SelectionContext(
            gaussians=self.gaussians,
            rasterizer=rasterizer,
            sh_degree=self.sh_degree,
            visited=visited,
            candidates=candidates,
            order={name: number for number, name in enumerate(names)},
            budget=len(visited) + situation.budget,
            seed=situation.seed,
            step=0,
            later=(*candidates, *situation.later),
            reach=situation.reach,
            observations=self.observations,
            here=situation.here,
        )

    def plan(
        self,
        candidates: Sequence[PinholeView],
        budget: Budget,
        starts: Sequence[Array],
        calibration: Callable[[float], Sequence[Seen]],
        *,
        targets: tuple[PinholeView, ...] = (),
        taken: tuple[PinholeView, ...] = (),
        space: FreeSpace | None = None,
        monitor: Monitor | None = None,
    ) -> Plan:
        """Plan a flight through some of ``candidates``, for vehicles at ``starts`` [3] each.

        ``targets`` are what the model must serve (none: its views and the candidates). ``taken`` views count
        as visited. In a ``space`` legs go around what is in the way; without one they are straight.
        ``calibration`` gives what is known of the quality of renders, by the spread of the targets: it
        calibrates the forecast. Raises ``InvalidInputError`` for what cannot be flown, and ``Cancelled``.
        """
        monitor = monitor or Monitor()
        assessment = self._feasibility.assess(candidates, space or self.space(monitor=monitor), monitor)
        possible = assessment.possible(candidates)
        served = Targets(
            self.views,
            possible,
            targets or (*self.registered, *possible),
            self.observations,
            taken=taken,
            monitor=monitor,
        )
        legs = None if space is None else free_legs(served.centres, np.stack(starts), space)
        plan = make_plan(served, budget, starts, calibration(served.spread), legs, monitor)
        plan = with_appearance(plan, possible, self.gaussians, monitor)
        left_out = candidates_too_close(len(candidates) - len(possible), len(candidates))
        return plan.model_copy(update={"warnings": (*left_out, *plan.warnings)})

    def render(self, view: PinholeView, rasterizer: Rasterizer) -> NDArray[np.float32]:
        """The view on black, [H, W, 3] in [0, 1]."""
        return render_color(self.gaussians, view, rasterizer, sh_degree=self.sh_degree)

    def spectrum(self, view: PinholeView, rasterizer: Rasterizer) -> NDArray[np.float32]:
        """The spectrum ln |F| of a view in shares of its range, [H, W]; 0 cycles/px in the middle."""
        found = log_magnitude(self.render(view, rasterizer))
        finite = found[np.isfinite(found)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
        shares = (np.nan_to_num(found, neginf=low) - low) / max(high - low, 1e-6)
        return np.asarray(np.clip(shares, 0.0, 1.0))

    def export(self, file: Path, origin: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        """Write the Gaussians to ``file``, a PLY for splat viewers, and compressed to an SPZ beside it.

        The PLY says where the ``origin`` [3] of the model frame is in the user's coordinates.
        """
        write_ply(file, self.gaussians, origin)
        write_spz(file.with_suffix(".spz"), self.gaussians)


def usual_camera(views: Sequence[PinholeView]) -> PinholeCamera:
    """The camera that most views have; of equally frequent ones the first."""
    return Counter(view.camera for view in views).most_common(1)[0][0]
