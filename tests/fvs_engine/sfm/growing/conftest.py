"""The courtyard of ``growing_yard``, grown once for all tests of a process."""

import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest
from growing_yard import Grown, grow

from fvs_engine.sfm.colmap.transforms_json import import_transforms_json
from fvs_engine.sfm.reconstruction import Reconstruction


@pytest.fixture(scope="session")
def images(yard_dir: Path) -> Path:
    """Read-only."""
    return yard_dir / "images"


@pytest.fixture
def images_copy(images: Path, tmp_path: Path) -> Path:
    """The same photographs in a folder that the test may change."""
    return shutil.copytree(images, tmp_path / "images")


@pytest.fixture(scope="session")
def truth(yard_dir: Path) -> Reconstruction:
    return import_transforms_json(yard_dir / "transforms.json")


@pytest.fixture(scope="session")
def grown(
    images: Path,
    tmp_path_factory: pytest.TempPathFactory,
    without_children: Callable[[], AbstractContextManager[None]],
) -> Grown:
    with without_children():
        return grow(images, tmp_path_factory.mktemp("grown") / "growing")
