"""A synthetic dataset for experiments, and synthetic runs for reports."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from PIL import Image

from fvs_engine.geometry import PinholeCamera, look_at
from fvs_engine.lab.evaluate.protocol import Protocol
from fvs_engine.lab.evaluate.results import Calibration, Evaluation, RankCorrelation, Run, ViewQuality
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.sparse_points import SparsePoints
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.views import View

VIEWS, POINTS = 14, 150


@pytest.fixture(scope="session")
def ring(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Fourteen 64 × 48 px photographs of 150 Gaussians from a circle; a view sees the points on its side."""
    draw = torch.Generator().manual_seed(3)
    model = Gaussians(
        means=0.6 * torch.randn((POINTS, 3), generator=draw),
        log_scales=-2.0 + 0.3 * torch.randn((POINTS, 3), generator=draw),
        quaternions_wxyz=torch.randn((POINTS, 4), generator=draw),
        opacity_logits=1.0 + torch.randn(POINTS, generator=draw),
        sh_dc=torch.randn((POINTS, 3), generator=draw),
        sh_rest=torch.zeros(POINTS, 0, 3),
    )
    folder = tmp_path_factory.mktemp("ring")
    camera = PinholeCamera(64, 48, 64.0, 64.0, 32.0, 24.0)
    points = model.means.numpy().astype(np.float64)
    rasterizer = create_rasterizer("cpu")
    views, tracks = [], []
    for index, angle in enumerate(np.linspace(0, 2 * np.pi, VIEWS, endpoint=False)):
        place = [4 * np.cos(angle), 4 * np.sin(angle), 0.5]
        camera_from_world = look_at(place, [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]).inverse()
        view = View(f"{index:02d}.png", camera, camera_from_world)
        color = rasterizer.render(model, camera, camera_from_world).color.clamp(0, 1).numpy()
        Image.fromarray((color * 255).round().astype(np.uint8)).save(folder / view.name)
        seen = np.flatnonzero(points @ view.centre > -0.5)
        tracks.append(np.stack([np.full(len(seen), index), seen], axis=1))
        views.append(view)
    pairs = np.concatenate(tracks)
    cloud = PointCloud(points, np.full((POINTS, 3), 128, np.uint8))
    names = tuple(view.name for view in views)
    return Dataset("ring", folder, tuple(views), SparsePoints(cloud, names, pairs[:, 0], pairs[:, 1]))


@pytest.fixture(scope="session")
def quick() -> Protocol:
    """A protocol for ``ring`` whose models are its sparse points, hardly trained."""
    return Protocol(
        name="quick",
        initial=3,
        initial_choice="farthest",
        view_counts=(3, 5),
        poses="known",
        reach="all",
        test_every=4,
        long_side_px=64,
        initial_iterations=4,
        iterations_per_view=2,
        max_gaussians=POINTS,
    )


@pytest.fixture
def make_run() -> Callable[..., Run]:
    """Builds a finished run of 4 initial views; ``psnr_db`` maps view counts to numbers."""

    def build(
        method: str,
        seed: int,
        psnr_db: dict[int, float],
        *,
        correlations: dict[str, float | None] | None = None,
        lpips: float | None = None,
    ) -> Run:
        last = max(psnr_db)
        return Run(
            method=method,
            seed=seed,
            initial=4,
            order=tuple(f"{index:02d}.png" for index in range(last)),
            evaluations=tuple(
                Evaluation(
                    visited=count,
                    registered=count,
                    iterations=100 * count,
                    gaussians=1_000,
                    travel=2.0 * count,
                    psnr_db=value,
                    ssim=0.5,
                    lpips=lpips,
                    aligned_only=(),
                    views=(ViewQuality(name="x.png", psnr_db=value, ssim=0.5, lpips=lpips),),
                )
                for count, value in psnr_db.items()
            ),
            calibrations=tuple(
                Calibration(
                    visited=count,
                    selectors=tuple(
                        RankCorrelation(
                            method=name, all_candidates=value, in_reach=None, candidates=9, scored=9
                        )
                        for name, value in correlations.items()
                    ),
                )
                for count in (psnr_db if correlations else ())
            ),
            selection_s=tuple(0.5 for _ in range(last - 4)),
            fallbacks=0,
            worst_rms=None,
            stop=f"The budget of {last} views is used.",
            seconds=10.0,
        )

    return build
