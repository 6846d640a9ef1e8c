"""Comparison of selectors on a dataset, in an output folder; see ``fvs_engine.lab.evaluate.experiment``."""

from collections.abc import Sequence
from pathlib import Path

from fvs_engine.images.catalog import require_usable
from fvs_engine.lab.evaluate.experiment import run_experiment
from fvs_engine.lab.evaluate.protocol import Protocol
from fvs_engine.lab.evaluate.report import Summary
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.select import locked_output, open_outside
from fvs_engine.scene.dataset import link_masks
from fvs_engine.splat.raster import create_rasterizer


def evaluate_selectors(
    folder: Path,
    out: Path,
    protocol: Protocol,
    methods: Sequence[str],
    seeds: Sequence[int],
    *,
    colmap: Path | None = None,
    transforms: Path | None = None,
    calibrated: bool = False,
    backend: str = "auto",
    threads: int | None = None,
    monitor: Monitor | None = None,
) -> Summary:
    """Run ``methods`` × ``seeds`` on the dataset in ``folder``; results go to the folder ``out``.

    The same call on the same ``out`` resumes; other methods and seeds are added to those
    there. Raises what ``open_dataset`` and ``run_experiment`` raise.
    """
    monitor = monitor or Monitor()
    dataset = open_outside(out, folder, colmap, transforms, monitor)
    if not (out / "experiment.json").exists():  # a truncated image would end runs half-way
        require_usable(dataset.image_dir, dataset.names, dataset.masks, monitor=monitor)
    rasterizer = create_rasterizer(backend, monitor)
    with locked_output(out):
        return run_experiment(
            out,
            link_masks(dataset, out),
            protocol,
            methods,
            seeds,
            rasterizer,
            calibrated=calibrated,
            threads=threads,
            monitor=monitor,
        )
