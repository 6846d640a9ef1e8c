"""Comparing selectors on a dataset, into an output folder; see ``fvs_engine.evaluate.experiment``."""

from collections.abc import Callable, Sequence
from pathlib import Path

from fvs_engine.errors import InvalidInputError
from fvs_engine.evaluate.experiment import run_experiment
from fvs_engine.evaluate.protocol import Protocol
from fvs_engine.evaluate.report import Summary
from fvs_engine.files.lock import locked_folder
from fvs_engine.files.storage import storage_errors
from fvs_engine.images.catalog import require_usable
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset_folder import open_dataset
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
    warn: Callable[[str], None] = lambda _sentence: None,
) -> Summary:
    """Run ``methods`` × ``seeds`` on the dataset in ``folder``; results go to the folder ``out``.

    The same call on the same ``out`` does what is left to do; other methods and seeds join those that are
    there. Raises what ``open_dataset`` and ``run_experiment`` raise.
    """
    monitor = monitor or Monitor()
    for given in (folder, colmap, transforms):
        if given is not None and given.resolve().is_relative_to(out.resolve()):
            raise InvalidInputError(
                f"{given} lies inside the output folder {out}.", hint="Choose an output folder outside."
            )
    dataset = open_dataset(folder, colmap, transforms)
    for warning in dataset.warnings:
        warn(warning)
    if not (out / "experiment.json").exists():  # one that is cut off would end its runs half-way
        require_usable(dataset.image_dir, dataset.names, monitor=monitor)
    rasterizer = create_rasterizer(backend, monitor)
    with storage_errors(out):
        out.mkdir(parents=True, exist_ok=True)
    with locked_folder(out), storage_errors(out):
        return run_experiment(
            out,
            dataset,
            protocol,
            methods,
            seeds,
            rasterizer,
            calibrated=calibrated,
            threads=threads,
            monitor=monitor,
            warn=warn,
        )
