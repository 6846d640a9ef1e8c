"""The first process on a machine, which finds nothing compiled, gives the same bits as any later one."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

RUN = """
import hashlib, json
import numpy as np
import torch
from fvs_engine.views import PinholeView
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.compilation.kernels import KERNELS
from fvs_engine.monitor import Monitor
from fvs_engine.score import MedianFrequency
from fvs_engine.splat.initialise import initialise_from_points
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.settings import Densification, TrainingSettings
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.views import TrainingView

draw = np.random.default_rng(0)
camera = PinholeCamera(64, 48, 60.0, 60.0, 32.0, 24.0)
poses = [RigidTransform(np.eye(3), np.array([x, 0.0, 4.0])) for x in (-0.5, 0.0, 0.5)]
views = [
    TrainingView(str(i), camera, pose, draw.integers(0, 256, (48, 64, 3), dtype=np.uint8))
    for i, pose in enumerate(poses)
]
settings = TrainingSettings(
    sh_degree=3, sh_degree_interval=10,
    densification=Densification(first_iteration=10, last_iteration=60, interval=10, gradient_threshold=1e-6),
)
reports = []
monitor = Monitor(lambda progress: reports.append(progress.stage))
rasterizer = create_rasterizer("cpu", monitor)
gaussians = initialise_from_points(
    draw.normal(size=(200, 3)), draw.integers(0, 256, (200, 3), dtype=np.uint8), 3
)
trainer = Trainer(views, gaussians, settings, rasterizer)
trainer.train(80, Monitor())
with torch.no_grad():
    (score,) = MedianFrequency(min_coverage=0.0).score(
        trainer.gaussians, [PinholeView("0", camera, poses[0])], rasterizer, monitor=monitor
    )
print(json.dumps({
    "gaussians": len(trainer.gaussians),
    "bits": {n: hashlib.sha256(t.detach().numpy().tobytes()).hexdigest()
             for n, t in trainer.gaussians.tensors().items()},
    "score": score.score.hex(),
    "compiled_here": [k.__name__ for k in KERNELS if sum(k.stats.cache_misses.values())],
    "stages": sorted(set(reports)),
}))
"""


@pytest.mark.slow
def test_the_first_process_trains_to_the_same_bits_as_the_second(tmp_path: Path) -> None:
    def run() -> Any:
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
        done = subprocess.run(
            [sys.executable, "-c", RUN], check=True, capture_output=True, text=True, env=environment
        )
        return json.loads(done.stdout)

    first, second = run(), run()
    assert "compile" in first.pop("stages")
    assert "compile" not in second.pop("stages")
    assert first["gaussians"] > 200
    assert first["compiled_here"] == []
    assert first == second
