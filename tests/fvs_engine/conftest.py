"""One reconstruction of the small photographs, shared by all tests of the engine that only look at it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.reconstruct import SfmResult, reconstruct
from fvs_engine.sfm.settings import SfmSettings
from fvs_engine.simulate import SimulatedCamera, courtyard, orbit, write_photographs


@pytest.fixture(scope="session")
def kermit_names(kermit_dir: Path) -> list[str]:
    return sorted(path.name for path in kermit_dir.iterdir())


@pytest.fixture(scope="session")
def kermit_sfm(kermit_dir: Path, kermit_names: list[str], made_once: Callable[..., Any]) -> SfmResult:
    """Read-only: tests that change something copy its folder."""
    # A second reconstruction in the same folder reads the first one's model.
    return made_once(
        "kermit_sfm",
        lambda folder: reconstruct(kermit_dir, kermit_names, folder, SfmSettings(), Monitor()),
    )


@pytest.fixture(scope="session")
def yard_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine photographs of 320×240 px, half way around a synthetic scene, and the truth in transforms.json.

    22.5° from each to the next: neighbours register, what is three apart does not. Read-only.
    """
    folder = tmp_path_factory.mktemp("yard", numbered=False)
    camera = SimulatedCamera.like_a_drone(320, 240)
    write_photographs(folder, courtyard(0), camera, orbit(16)[:9], Monitor())
    return folder
