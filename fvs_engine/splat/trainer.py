"""The training loop: render a view, compare it with its photograph, update the Gaussians."""

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from pydantic import ValidationError
from torch import Tensor

from fvs_engine.compilation.faster_threads import FasterThreads
from fvs_engine.errors import InvalidInputError, StorageError, TrainingError
from fvs_engine.geometry import PinholeCamera
from fvs_engine.monitor import Monitor
from fvs_engine.splat.checkpoint import read_checkpoint, write_checkpoint
from fvs_engine.splat.conventions import NEAR_PLANE
from fvs_engine.splat.densification import (
    GradientStatistics,
    densify,
    is_due,
    reset_is_due,
    reset_opacities,
)
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.losses import photometric_loss
from fvs_engine.splat.on_device import on_device
from fvs_engine.splat.optimiser import GaussianAdam, learning_rates_at
from fvs_engine.splat.raster.interface import GuardedRasterizer, Rasterizer, Rendering
from fvs_engine.splat.settings import TrainingSettings
from fvs_engine.splat.triton_kernels.guard import PendingReport, StepGuard
from fvs_engine.splat.view_order import ViewOrder
from fvs_engine.splat.views import TrainingView, median_depth, scene_extent
from fvs_schema.stages import Stage

_RATE_SMOOTHING = 0.05
_LOSS_SMOOTHING = 0.05

_DIVERGED_HINT = (
    "The last checkpoint is still good. Check the cameras; if they are right, train again with "
    "another seed or more views."
)


@dataclass(frozen=True, eq=False)
class _Target:
    """The target of a view at the present level: ``image`` [H, W, 3] uint8.

    ``mask`` [H, W, 1] is 1 where the image counts, and 0 where it does not and is black; None: all counts.
    """

    camera: PinholeCamera
    image: Tensor
    mask: Tensor | None

    @staticmethod
    def of(view: TrainingView, device: torch.device) -> "_Target":
        image = torch.tensor(view.image, device=device)
        if view.mask is None:
            return _Target(view.camera, image, None)
        mask = torch.tensor(view.mask, device=device)[..., None]
        return _Target(view.camera, image * mask, mask.to(torch.float32))

    def loss(
        self, rendering: Rendering, ssim_weight: float, guard: StepGuard | None
    ) -> tuple[Tensor, Tensor]:
        """The loss of a rendering, and its gradient with respect to the colours [H, W, 3].

        Both images are black where nothing counts, and nothing is lost there.
        """
        if self.mask is None:
            return photometric_loss(rendering.color, self.image, ssim_weight, guard)
        loss, gradient = photometric_loss(rendering.color * self.mask, self.image, ssim_weight, guard)
        return loss, gradient * self.mask

    def seen(self, rendering: Rendering) -> Rendering:
        """The rendering, after the backward pass, without the Gaussians that no pixel showed that counts."""
        gradient = rendering.screen_means.grad if rendering.screen_means is not None else None
        if self.mask is None or gradient is None:
            return rendering
        counts = (gradient != 0).any(dim=1)
        return replace(rendering, radii_px=rendering.radii_px.detach() * counts)


@dataclass(frozen=True)
class _State:
    """What the host counts, before a step."""

    iteration: int
    steps: int
    order: ViewOrder


@dataclass(frozen=True)
class _Launched:
    """A step that a device was given: what was ``before`` it, its view, and the report that will come."""

    before: _State
    view: str
    report: PendingReport


class Trainer:
    """Trains Gaussians on views; deterministic for a seed on the CPU, whatever the number of threads.

    The result has the same bits in every process on a machine (see ``compilation``).

    ``gaussians`` are taken over (moved to the rasteriser's device, changed in place, replaced when their
    number changes): read them from the attribute. All randomness is derived from the seed and the
    iteration, so that a resumed run equals an uninterrupted one bit by bit.

    ``extent``: the length that learning rates and size limits are proportional to (``scene_extent``).
    ``repeats``: how often each view comes in an epoch, once by default.

    Raises ``TrainingError`` when there is no view or no Gaussian, or most are too near to be rendered.
    """

    def __init__(
        self,
        views: Sequence[TrainingView],
        gaussians: Gaussians,
        settings: TrainingSettings,
        rasterizer: Rasterizer,
        seed: int = 0,
        repeats: Sequence[int] | None = None,
    ) -> None:
        if not views:
            raise TrainingError("There is no view to train on.", hint="Hold out fewer views, or none.")
        if len(gaussians) == 0:
            raise TrainingError(
                "There is no Gaussian to train.", hint="The cameras need sparse points to start from."
            )
        if settings.sh_degree != gaussians.sh_degree:
            raise InvalidInputError(
                f"The settings have spherical harmonics of degree {settings.sh_degree}, "
                f"the Gaussians have {gaussians.sh_degree}.",
                hint="Initialise the Gaussians with the settings' degree.",
            )
        self.settings = settings
        self.rasterizer = rasterizer
        self.seed = seed
        self.iteration = 0
        self.views = tuple(views)
        means = gaussians.means.detach().cpu().numpy()
        if median_depth(views, means) < NEAR_PLANE:
            raise TrainingError(
                f"Most points are nearer than {NEAR_PLANE} to the cameras, and such are not rendered: the "
                "model's unit of length is too large.",
                hint="Scale the model, cameras and points alike, so that the cameras are about 1 apart.",
            )
        self.extent = scene_extent(views, means)
        with on_device(rasterizer.device):
            self.gaussians = _trainable(gaussians.to(rasterizer.device))
            self.optimiser = GaussianAdam(self.gaussians)
            self.statistics = GradientStatistics(len(gaussians), rasterizer.device)
        self._guard = StepGuard(rasterizer.device) if rasterizer.steps_on_device else None
        self._in_flight: list[_Launched] = []
        self._reduction = settings.reduction_at(0)
        self._targets: dict[int, _Target] = {}  # by the view's index, of the present level
        self._order = ViewOrder(seed, 0, [], [1] * len(views) if repeats is None else list(repeats))

    @property
    def sh_degree(self) -> int:
        """The degree of spherical harmonics in use: one more every ``sh_degree_interval``."""
        return self.settings.sh_degree_at(self.iteration)

    def _target(self, index: int) -> _Target:
        """The target of view ``index`` at the present level."""
        reduction = self.settings.reduction_at(self.iteration)
        if reduction != self._reduction:
            self._reduction, self._targets = reduction, {}
        if index not in self._targets:
            reduced = self.views[index].reduced(reduction)
            self._targets[index] = _Target.of(reduced, self.rasterizer.device)
        return self._targets[index]

    def train(self, until_iteration: int, monitor: Monitor, stage: Stage = Stage.TRAINING) -> None:
        """Train up to iteration ``until_iteration``; report each iteration to ``monitor`` as ``stage``.

        Raises ``Cancelled`` between two iterations: the trainer can go on or be saved. Raises
        ``TrainingError`` when the loss is no longer finite, before the optimiser uses it.
        """
        smooth_loss = smooth_s = None
        work = self.settings.work_until(until_iteration)
        threads = FasterThreads()
        with on_device(self.rasterizer.device):
            try:
                while self.iteration < until_iteration:
                    monitor.check()
                    start = time.perf_counter()
                    with threads.step():
                        loss = self._step(until_iteration)
                    elapsed = time.perf_counter() - start
                    smooth_s = _blend(smooth_s, elapsed, _RATE_SMOOTHING)
                    if loss is None:
                        continue
                    smooth_loss = _blend(smooth_loss, loss, _LOSS_SMOOTHING)
                    monitor.report(
                        stage,
                        self.iteration,
                        until_iteration,
                        worked=self.settings.work_until(self.iteration) / work,
                        loss=smooth_loss,
                        gaussians=len(self.gaussians),
                        iterations_per_s=1 / smooth_s,
                    )
            finally:
                self._settle(0)

    def _step(self, until_iteration: int) -> float | None:
        """One iteration; returns the last loss that is known: on a device that of the iteration before."""
        settings, gaussians, guard = self.settings, self.gaussians, self._guard
        before = _State(self.iteration, self.optimiser.steps, self._order.copy() if guard else self._order)
        index = self._order.next()
        view, target = self.views[index], self._target(index)
        sh_degree = self.sh_degree
        if guard is not None and isinstance(self.rasterizer, GuardedRasterizer):
            rendering = self.rasterizer.render_guarded(
                gaussians, target.camera, view.camera_from_model, guard, sh_degree=sh_degree
            )
        else:
            rendering = self.rasterizer.render(
                gaussians, target.camera, view.camera_from_model, sh_degree=sh_degree
            )
        loss, gradient = target.loss(rendering, settings.ssim_weight, guard)
        value = None if guard is not None else _finite(loss.item(), self.iteration, view.name)
        if rendering.color.requires_grad:
            rendering.color.backward(gradient)  # type: ignore[no-untyped-call]
            rendering = target.seen(rendering)
        rules = settings.densification
        if self.iteration < rules.last_iteration:
            self.statistics.add(rendering, guard)
        rates = learning_rates_at(settings.learning_rates, self.iteration, settings.iterations, self.extent)
        self.optimiser.step(gaussians, rates, rendering.radii_px.detach(), sh_degree, guard)
        self.iteration += 1
        due, reset = is_due(rules, self.iteration), reset_is_due(rules, self.iteration)
        if guard is not None:
            self._in_flight.append(_Launched(before, view.name, guard.report(loss)))
            value = self._settle(0 if due or reset or self.iteration == until_iteration else 1)
            if self.iteration <= before.iteration:
                return None
        if due:
            self._densify()
        if reset:
            with torch.no_grad():
                reset_opacities(self.gaussians, self.optimiser)
        return value

    def _settle(self, in_flight: int) -> float | None:
        """Wait until so many steps at most are in flight; the loss of the last that ended.

        If one had too little room, it and those after it changed nothing: go back to before it. Raises
        ``TrainingError`` if its loss was not finite.
        """
        loss = None
        while self._guard is not None and len(self._in_flight) > in_flight:
            launched = self._in_flight.pop(0)
            report = launched.report.wait()
            if report.overflowed or report.diverged:
                self._in_flight.clear()
                before = launched.before
                self.iteration, self.optimiser.steps, self._order = (
                    before.iteration,
                    before.steps,
                    before.order,
                )
                self._guard.reset()
                if report.overflowed:
                    self._guard.make_room(report.needed)
                    return None
            loss = _finite(report.loss, launched.before.iteration, launched.view)
        return loss

    def _densify(self) -> None:
        rules = self.settings.densification
        generator = torch.Generator().manual_seed(
            int(np.random.default_rng([self.seed, self.iteration]).integers(2**62))
        )
        grown = densify(
            self.gaussians,
            self.optimiser,
            self.statistics,
            rules,
            extent=self.extent,
            max_gaussians=self.settings.max_gaussians_at(self.iteration),
            prune_large=self.iteration > rules.opacity_reset_interval,
            generator=generator,
        )
        self.gaussians = _trainable(grown)
        self.statistics = GradientStatistics(len(grown), grown.device)

    def save(
        self,
        path: Path,
        *,
        owner_state: Mapping[str, Any] | None = None,
    ) -> None:
        """Write a checkpoint; an earlier one at ``path`` is replaced only when this one is whole.

        The owner's JSON state goes into the same file, under ``"owner"``. Raises ``StorageError`` when it
        cannot be written, ``TrainingError`` when the parameters are not finite: a good checkpoint is never
        replaced by a diverged model.
        """
        for name, tensor in self.gaussians.tensors().items():
            if not bool(torch.isfinite(tensor.detach()).all()):
                raise TrainingError(
                    f"The model has diverged: {name} holds numbers that are not finite.",
                    hint=_DIVERGED_HINT,
                )
        write_checkpoint(
            path,
            {
                **{f"gaussians.{name}": tensor for name, tensor in self.gaussians.tensors().items()},
                **{f"first.{name}": tensor for name, tensor in self.optimiser.first.items()},
                **{f"second.{name}": tensor for name, tensor in self.optimiser.second.items()},
                "gradients.total": self.statistics.total,
                "gradients.views": self.statistics.views,
            },
            {
                "settings": self.settings.model_dump(mode="json"),
                "iteration": self.iteration,
                "steps": self.optimiser.steps,
                "extent": self.extent,
                "seed": self.seed,
                "epoch": self._order.epoch,
                "remaining": self._order.remaining,
                "repeats": self._order.repeats,
                "views": [view.name for view in self.views],
                "owner": dict(owner_state or {}),
            },
        )

    @classmethod
    def resume(cls, path: Path, views: Sequence[TrainingView], rasterizer: Rasterizer) -> "Trainer":
        """Continue from a checkpoint, with the same views in the same order.

        Raises ``StorageError`` when the checkpoint cannot be used, ``InvalidInputError`` when the views
        are not those that it was trained on.
        """
        tensors, state = read_checkpoint(path)
        names = [view.name for view in views]
        if names != state["views"]:
            raise InvalidInputError(
                f"{path} was trained on {len(state['views'])} views, which are not the {len(names)} given.",
                hint="Give the same views in the same order, or train again.",
                path=path,
            )
        with _whole(path), on_device(rasterizer.device):
            settings = TrainingSettings.model_validate(state["settings"])
            gaussians, repeats = Gaussians(**_named(tensors, "gaussians.")), state["repeats"]
            trainer = cls(views, gaussians, settings, rasterizer, state["seed"], repeats)
            trainer.iteration = state["iteration"]
            trainer.extent = state["extent"]
            trainer._order = ViewOrder(state["seed"], state["epoch"], state["remaining"], repeats)
            trainer.optimiser.steps = state["steps"]
            trainer.optimiser.first = _named(tensors, "first.", rasterizer.device)
            trainer.optimiser.second = _named(tensors, "second.", rasterizer.device)
            trainer.statistics.total = tensors["gradients.total"].to(rasterizer.device)
            trainer.statistics.views = tensors["gradients.views"].to(rasterizer.device)
        return trainer


def read_gaussians(path: Path) -> tuple[Gaussians, int, int]:
    """The Gaussians of a checkpoint, their degree of spherical harmonics in use, and their iterations.

    Raises ``StorageError`` when it cannot be used.
    """
    tensors, state = read_checkpoint(path)
    with _whole(path):
        settings, iteration = TrainingSettings.model_validate(state["settings"]), int(state["iteration"])
        return Gaussians(**_named(tensors, "gaussians.")), settings.sh_degree_at(iteration), iteration


@contextmanager
def _whole(path: Path) -> Iterator[None]:
    """Raise ``StorageError`` where a part of the checkpoint is missing."""
    try:
        yield
    except (KeyError, TypeError, ValidationError) as error:
        raise StorageError(f"{path} is incomplete: {error}", hint="Train again.", path=path) from error


def _named(tensors: dict[str, Tensor], prefix: str, device: torch.device | str = "cpu") -> dict[str, Tensor]:
    return {n.removeprefix(prefix): t.to(device) for n, t in tensors.items() if n.startswith(prefix)}


def _trainable(gaussians: Gaussians) -> Gaussians:
    """The same values as contiguous leaf tensors with gradients."""
    leaves = {name: tensor.detach().contiguous() for name, tensor in gaussians.tensors().items()}
    return Gaussians(**leaves).requires_grad_()


def _finite(loss: float, iteration: int, view: str) -> float:
    """The loss; raises ``TrainingError`` if it is not finite."""
    if not math.isfinite(loss):
        raise TrainingError(
            f"Training diverged at iteration {iteration}: the loss on {view} is {loss}.", hint=_DIVERGED_HINT
        )
    return loss


def _blend(old: float | None, new: float, share: float) -> float:
    return new if old is None else old + share * (new - old)
