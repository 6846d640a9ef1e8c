"""Arguments that several commands share."""

import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer


class Quality(StrEnum):
    """The training presets."""

    COARSE = "coarse"
    FINE = "fine"


class Backend(StrEnum):
    """The rasterisers."""

    AUTO = "auto"
    CPU = "cpu"
    CUDA = "cuda"
    REFERENCE = "reference"


DatasetArgument = Annotated[
    Path, typer.Argument(metavar="DATASET", help="A folder of photographs (or of images/) with poses.")
]
OutOption = Annotated[Path, typer.Option(metavar="DIR", help="Where the results go.")]
DatasetColmapOption = Annotated[
    Path | None, typer.Option(metavar="DIR", help="The COLMAP model with the dataset's poses.")
]
DatasetTransformsOption = Annotated[
    Path | None, typer.Option(metavar="FILE", help="The transforms.json with the dataset's poses.")
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="The result as JSON on stdout, progress as JSON lines on stderr.")
]
ThreadsOption = Annotated[
    int | None, typer.Option(min=1, help="Threads to compute with.", show_default="one per core")
]
BackendOption = Annotated[Backend, typer.Option(help="Rasteriser; auto is cuda where it can run, else cpu.")]


def limit_threads(threads: int | None) -> None:
    """Give the process's pools their budget, before the libraries that own them are imported."""
    if threads is not None:
        for pool in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
            os.environ[pool] = str(threads)
