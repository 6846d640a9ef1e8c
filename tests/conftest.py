"""Fixtures that several packages' tests share."""

import os
import shutil
from pathlib import Path

import pytest

_REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real photographs: $FVS_DATA, or ../shared/data beside the repository."""
    folder = Path(os.environ.get("FVS_DATA", _REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"the real photographs are not here: {folder} is missing (set FVS_DATA to their folder)")
    return folder


@pytest.fixture(scope="session")
def kermit_dir(data_dir: Path) -> Path:
    """Eleven photographs of 640×480 px, read-only."""
    return data_dir / "kermit" / "images"


@pytest.fixture
def kermit_copy(kermit_dir: Path, tmp_path: Path) -> Path:
    """The same photographs in a folder that the test may change."""
    folder = tmp_path / "kermit"
    folder.mkdir()
    for photograph in sorted(kermit_dir.iterdir()):
        shutil.copyfile(photograph, folder / photograph.name)
    return folder
