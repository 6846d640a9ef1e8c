"""The loop of the paper's Algorithm 1: train, choose the next view, visit it, repeat."""

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError, ReconstructionError
from fvs_engine.geometry.alignment.dataset import DatasetAlignment
from fvs_engine.hold_out import hold_out
from fvs_engine.monitor import Monitor
from fvs_engine.plan.distances import path_length
from fvs_engine.plan.forecast import Seen
from fvs_engine.plan.outlook import Expectations, look_ahead
from fvs_engine.plan.plan_records import Expectation
from fvs_engine.plan.reach import Reach, default_radius
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.scene import Scene
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.score.selectors.interface import SelectionContext, Selector, select
from fvs_engine.select.candidate_views import align, expected_views
from fvs_engine.select.initial_views import initial_views
from fvs_engine.select.loop_folder import LoopFolder, SelectionManifest, fingerprint
from fvs_engine.select.loop_records import (
    AlignmentRecord,
    Choice,
    StepRecord,
    StepSeconds,
    StopReason,
)
from fvs_engine.select.loop_settings import LoopSettings
from fvs_engine.select.stopping import (
    Clock,
    budget_spent,
    check_first_step,
    gain_too_small,
    grounded,
    quality_reached,
    time_is_up,
    too_far,
)
from fvs_engine.select.vehicles import Vehicle, Vehicles
from fvs_engine.splat.metrics import psnr
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.views import PinholeView
from fvs_schema.findings import Finding
from fvs_schema.stages import Stage

__all__ = [
    "AlignmentRecord",
    "Choice",
    "LoopSettings",
    "SelectionLoop",
    "StepRecord",
    "StepSeconds",
    "StopReason",
]


class SelectionLoop:
    """A selection of views of one dataset; on disk after every step, and resumed by opening it again.

    ``begin`` visits the initial views and trains on them. Each ``step`` ranks the views in reach by the quick
    model (``choose``), visits the first one, and trains on all visited ones.

    Positions and distances are camera centres in the dataset's frame; candidates are rendered in the
    model's, by ``DatasetAlignment``. Held-out views are never visited and never candidates. Models are
    trained on visited views alone, whatever else the dataset holds: a quick one after every visit, by which
    the next view is chosen. ``scene.train`` makes the full model where one is wanted; choices do not depend
    on it.

    A selection that was killed at any moment continues identically (on the CPU; see ``Scene``).
    """

    def __init__(
        self,
        folder: LoopFolder,
        manifest: SelectionManifest,
        dataset: Dataset,
        scene: Scene,
        settings: LoopSettings,
        selector: Selector,
        reach: Reach,
    ) -> None:
        self.dataset = dataset
        self.settings = settings
        self.scene = scene
        """The scene of the visited views."""
        self.reach = reach
        self.initial = manifest.initial
        """The initial views, in the order of their visit."""
        self.pool, self.held_out_names = hold_out(dataset.names, settings.test_every, settings.hold_out)
        """In order of capture: the views that may be visited, and the held-out ones."""
        records, self._pending = folder.read_steps()
        self._records = records
        self._folder = folder
        self._manifest = manifest
        self._selector = selector
        self._centres = dataset.centres()
        self._clock = Clock(settings.time_limit_s)
        self._begun = False

    @classmethod
    def open(
        cls,
        folder: Path,
        dataset: Dataset,
        settings: LoopSettings,
        selector: Selector,
        rasterizer: Rasterizer,
        monitor: Monitor,
    ) -> "SelectionLoop":
        """Create a selection in ``folder``, or resume the one there; computes nothing yet.

        ``selector`` is the one that ``settings.method`` names.

        Raises ``InvalidInputError`` for a pool that is smaller than the budget, and for a reach in which the
        first step finds nothing; ``OutputExistsError`` when the folder holds something else or another
        selection; ``StorageError``.
        """
        pool, held_out = hold_out(dataset.names, settings.test_every, settings.hold_out)
        if len(pool) < settings.budget:
            raise InvalidInputError(
                f"The budget is {settings.budget} views, but {dataset.name} has only {len(pool)} to visit: "
                f"{len(dataset.views)} photographs with poses, of which {len(held_out)} are held out.",
                hint=f"Give a budget of at most {len(pool)}.",
            )
        centres = dataset.centres()
        radius, nearest = settings.radius, settings.nearest
        if radius is None and nearest is None:
            radius = default_radius(np.stack([centres[name] for name in dataset.names]))
        reach = Reach(radius, nearest)
        initial = initial_views(
            [dataset.by_name[name] for name in pool],
            settings.initial,
            settings.initial_choice,
            settings.seed,
            settings.budget,
        )
        if settings.budget > settings.initial:
            unvisited = {name: centres[name] for name in pool if name not in initial}
            check_first_step(reach, settings.max_travel, centres[initial[-1]], unvisited)

        place = LoopFolder(folder)
        manifest = place.open(
            SelectionManifest(
                dataset=dataset.name, fingerprint=fingerprint(dataset), settings=settings, initial=initial
            )
        )
        scene = Scene.open(place.scene, dataset, settings.scene, rasterizer, monitor)
        return cls(place, manifest, dataset, scene, settings, selector, reach)

    def begin(self, monitor: Monitor) -> tuple[Finding, ...]:
        """Train on the initial views, or on what a resumed selection had visited; return warnings, once.

        ``step`` calls it if necessary. Raises ``ReconstructionError`` when the initial views do not overlap,
        and what training raises.
        """
        if self._begun:
            return ()
        monitor.report(Stage.SELECT, len(self.visited), self.settings.budget)
        warnings: tuple[Finding, ...] = ()
        if self._pending is None:  # otherwise ``step`` finishes the pending choice
            warnings, _ = self._add(self.visited, monitor)
            self._train(monitor)
        self._begun = True
        return warnings

    def step(self, monitor: Monitor) -> StepRecord | StopReason:
        """Choose the next view, visit it and train on it, or return why the selection ends here.

        Raises what ``choose`` raises.
        """
        choice = self.choose(monitor)
        if isinstance(choice, StopReason):
            return choice
        record = self._visit(choice, monitor)
        self._folder.write_step(record.choice, record)
        self._records.append(record)
        self._pending = None
        monitor.report(Stage.SELECT, len(self.visited), self.settings.budget, travel=record.travel)
        return record

    def choose(self, monitor: Monitor) -> Choice | StopReason:
        """Choose the view that ``step`` visits next, unless that was done; or return why the selection ends.

        Raises ``InvalidInputError`` when the dataset's poses contradict the photographs, ``Cancelled`` with
        everything on disk, and what ``begin`` raises.
        """
        self.begin(monitor)
        if self._pending is None:
            choice = self._next(monitor)
            stop = choice if isinstance(choice, StopReason) else None
            if stop != self._manifest.stop:
                self._manifest = self._manifest.model_copy(update={"stop": stop})
                self._folder.write_manifest(self._manifest)
            if isinstance(choice, StopReason):
                return choice
            self._pending = choice
            self._folder.write_step(self._pending, None)
        return self._pending

    def _next(self, monitor: Monitor) -> Choice | StopReason:
        """The choice of the first vehicle that has a candidate within its limit."""
        outcome: Choice | StopReason | None = budget_spent(len(self.visited), self.settings.budget)
        if outcome is not None:
            return outcome
        vehicles, last_step_s = self.vehicles, self._records[-1].seconds.total if self._records else 0.0
        landed = list(vehicles.landed)
        for vehicle in vehicles.in_turn:
            here, left = self._centres[vehicle.at], vehicles.left(vehicle)
            outcome = (
                grounded(self.reach, left, here, self._unvisited_centres())
                or time_is_up(self._clock, last_step_s)
                or self._choose(vehicle, left, landed, monitor)
            )
            if isinstance(outcome, Choice) or outcome.kind not in ("nothing-in-reach", "travel"):
                break
            landed.append(vehicle.number)
        assert outcome is not None
        return outcome

    def _choose(
        self, vehicle: Vehicle, left: float, landed: Sequence[int], monitor: Monitor
    ) -> Choice | StopReason:
        began = time.monotonic()
        distances = self.reach.distances(self._centres[vehicle.at], self._unvisited_centres())
        alignment = align(self.scene)
        context = self.context(distances, alignment, vehicle)
        targets = context.planning
        near = tuple(name for name, distance in distances.items() if distance <= left)
        outlook = look_ahead(targets, near, context.remaining, self._seen, context.fleet)
        stop = quality_reached(outlook, self.settings.stop_at_db) or gain_too_small(
            outlook, self.settings.stop_at_gain_db
        )
        if stop is not None:
            return stop
        if self.settings.registrable:
            context = replace(context, candidates=targets.registrable(context.candidates))
        selection = select(context, self._selector, distances, monitor=monitor)
        chosen = selection.chosen
        stop = too_far(chosen, distances[chosen], left)
        if stop is not None:
            return stop
        return Choice(
            step=len(self._records) + 1,
            method=self.settings.method,
            chosen=chosen,
            score=next(item.score for item in selection.ranked if item.name == chosen),
            ranked=selection.ranked,
            fallback=selection.fallback,
            distance=distances[chosen],
            travel=self.travel + distances[chosen],
            alignment=AlignmentRecord.of(alignment),
            seconds=time.monotonic() - began,
            outlook=outlook,
            variance=float(targets.own_variances()[targets.index[chosen]]),
            vehicle=vehicle.number,
            landed=tuple(landed),
        )

    def _visit(self, choice: Choice, monitor: Monitor) -> StepRecord:
        before = None if choice.before_db is not None else self.model
        warnings, add_s = self._add([choice.chosen], monitor)
        if before is not None:
            # Written before the model is trained on it: afterwards it cannot be measured again.
            choice = choice.model_copy(update={"before_db": self._psnr_db(before, choice.chosen)})
            self._folder.write_step(choice, None)
        train_s = self._train(monitor)
        return StepRecord(
            choice=choice,
            views=len(self.visited) + 1,
            registered=len(self.scene.views),
            unregistered=len(self.scene.unregistered),
            iterations=self.model.iterations,
            gaussians=len(self.model.gaussians),
            warnings=warnings,
            seconds=StepSeconds(score=choice.seconds, add=add_s, train=train_s),
        )

    def _psnr_db(self, model: SceneModel, name: str) -> float | None:
        """The PSNR of a view's photograph, rendered by ``model``; None where it is unregistered."""
        for view in self.scene.views:
            if view.name == name:
                return psnr(model.render(view, self.scene.rasterizer), view.image / 255.0, view.mask)
        return None

    def _add(self, names: Iterable[str], monitor: Monitor) -> tuple[tuple[Finding, ...], float]:
        """Add views; returns warnings and seconds."""
        began = time.monotonic()
        update = self.scene.add(tuple(names), monitor)
        if not self.scene.views:
            raise ReconstructionError(
                f"None of the {len(self.visited)} initial views could be registered: they do not overlap, or "
                "not enough.",
                hint="Begin with more views, or others (--initial, --initial-choice), or with --poses known.",
            )
        return update.warnings, time.monotonic() - began

    def _train(self, monitor: Monitor) -> float:
        """Train the quick model; returns seconds."""
        began = time.monotonic()
        self.scene.train("quick", monitor)
        return time.monotonic() - began

    @property
    def records(self) -> tuple[StepRecord, ...]:
        """The steps so far."""
        return tuple(self._records)

    @property
    def visited(self) -> tuple[str, ...]:
        """The initial and the chosen views, in the order of their visit."""
        return self.initial + tuple(record.chosen for record in self._records)

    @property
    def unvisited(self) -> tuple[str, ...]:
        """The views that may still be visited, in order of capture."""
        visited = set(self.visited)
        return tuple(name for name in self.pool if name not in visited)

    @property
    def travel(self) -> float:
        """The length of the path through the visited views, of all vehicles, in the dataset's unit."""
        initial = path_length([self._centres[name] for name in self.initial])
        return initial + sum(record.choice.distance for record in self._records)

    @property
    def vehicles(self) -> Vehicles:
        """Where the vehicles are, and how far each has flown since the initial views."""
        settings, choices = self.settings, [record.choice for record in self._records]
        return Vehicles(settings.vehicles, self.initial[-1], settings.max_travel, choices)

    @property
    def in_reach(self) -> dict[str, float]:
        """The unvisited views in reach of the vehicle whose turn is next, with their distances."""
        (vehicle, *_) = self.vehicles.in_turn
        return self.reach.distances(self._centres[vehicle.at], self._unvisited_centres())

    @property
    def model(self) -> SceneModel:
        """The quick model of the registered views, by which views are ranked; ``begin`` trains it."""
        return self.scene.train("quick", Monitor())

    def context(
        self, candidates: Iterable[str], alignment: DatasetAlignment, vehicle: Vehicle | None = None
    ) -> SelectionContext:
        """The input of a selector now, for ``candidates`` (names of views of the dataset).

        ``vehicle``: the one that flies next (None: the one whose turn it is).
        Unregistered visited views get their pose from the alignment: they were visited, and a method that
        spreads views must not choose them again.
        """
        model = self.model
        registered: dict[str, PinholeView] = {view.name: view for view in self.scene.views}
        expected = expected_views(self.scene, self.visited, alignment)
        visited = tuple(registered.get(view.name, view) for view in expected)
        vehicles, centres = self.vehicles, {view.name: view.centre for view in visited}
        vehicle = vehicle or (*vehicles.in_turn, *vehicles.all)[0]
        scale = alignment.model_from_world.scale
        return SelectionContext(
            gaussians=model.gaussians,
            rasterizer=self.scene.rasterizer,
            sh_degree=model.sh_degree,
            visited=visited,
            candidates=expected_views(self.scene, candidates, alignment),
            order={name: index for index, name in enumerate(self.pool)},
            budget=self.settings.budget,
            seed=self.settings.seed,
            step=len(self._records),
            later=expected_views(self.scene, self.unvisited, alignment),
            reach=self.reach.scaled(scale),
            observations=model.observations,
            here=centres[vehicle.at],
            fleet=vehicles.fleet(vehicle, centres, scale),
        )

    def expected(self) -> Expectation:
        """The quality to expect of all views that may be visited, rendered by the quick model."""
        targets = self.context(self.unvisited, align(self.scene)).planning
        return Expectations(self._seen).at(targets.variance.variance)

    def _unvisited_centres(self) -> Mapping[str, NDArray[np.float64]]:
        return {name: self._centres[name] for name in self.unvisited}

    @property
    def _seen(self) -> list[Seen]:
        """The photographs of all steps, as the models before them rendered them."""
        choices = (record.choice for record in self._records)
        return [Seen(c.variance, c.before_db) for c in choices if c.before_db is not None]
