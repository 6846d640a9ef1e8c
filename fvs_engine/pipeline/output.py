"""Opening of a command's dataset, and of the output folder it writes to."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.lock import locked_folder
from fvs_engine.files.storage import storage_errors
from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset, open_dataset


def open_outside(
    out: Path, folder: Path, colmap: Path | None, transforms: Path | None, monitor: Monitor
) -> Dataset:
    """Open the dataset in ``folder`` and pass on its warnings.

    Raises ``InvalidInputError`` when anything of it lies inside ``out``, and what ``open_dataset`` raises.
    """
    for given in (folder, colmap, transforms):
        if given is not None and given.resolve().is_relative_to(out.resolve()):
            raise InvalidInputError(
                f"{given} lies inside the output folder {out}.", hint="Choose an output folder outside."
            )
    dataset = open_dataset(folder, colmap, transforms)
    for warning in dataset.warnings:
        monitor.warn(warning)
    return dataset


@contextlib.contextmanager
def locked_output(out: Path) -> Iterator[None]:
    """Create the folder ``out`` and keep other writers out; an ``OSError`` becomes a ``StorageError``."""
    with storage_errors(out):
        out.mkdir(parents=True, exist_ok=True)
        with locked_folder(out):
            yield
