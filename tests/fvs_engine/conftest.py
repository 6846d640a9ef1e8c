"""One reconstruction of the small photographs, shared by all tests of the engine that only look at it."""

import contextlib
import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from fvs_engine.errors import ReconstructionError
from fvs_engine.lab.simulate import SimulatedCamera, courtyard, orbit, write_photographs
from fvs_engine.monitor import Monitor
from fvs_engine.records import Record
from fvs_engine.sfm import stages
from fvs_engine.sfm.batch import undistort
from fvs_engine.sfm.batch.reconstruct import SfmResult, reconstruct
from fvs_engine.sfm.jobs import REQUESTS, Answer, Request
from fvs_engine.sfm.native.jobs import find_job
from fvs_engine.sfm.pose_priors import ImageSet
from fvs_engine.sfm.settings import SfmSettings


@pytest.fixture(scope="module")
def coarse_pictures() -> Iterator[None]:
    """Draw plots and trajectories with few pixels, which is quicker."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fvs_engine.lab.evaluate.plots._DPI", 50)
        patch.setattr("fvs_engine.select.trajectory._DPI", 50)
        yield


@pytest.fixture(scope="session")
def kermit_names(kermit_dir: Path) -> list[str]:
    return sorted(path.name for path in kermit_dir.iterdir())


def _run_here(
    request: Request[Answer],
    log_file: Path,
    monitor: Monitor,
    *,
    on_tick: Callable[[], None] | None = None,
    on_event: Callable[[int], None] | None = None,
) -> Answer:
    """Like ``run_native``, in this process: nothing can stop the job, and its output is not in the log.

    Jobs have one thread: pytest's process cannot be forked, and results are the same at every run.
    """
    monitor.check()
    log_file.parent.mkdir(parents=True, exist_ok=True)
    order = json.loads(json.dumps(request.model_dump(mode="json")))
    for plain in (order, order.get("registration", {})):
        if "threads" in plain:
            plain["threads"] = 1
    try:
        report = on_event or (lambda _event: None)
        result = find_job(request.job)(REQUESTS[request.job].model_validate(order), report)
    except Exception as error:
        message = f"Stage {request.job!r} failed: {error}"
        raise ReconstructionError(message, hint="It ran in this process.") from error
    if on_tick is not None:
        on_tick()
    monitor.check()
    plain = result.model_dump(mode="json") if isinstance(result, Record) else result
    return request.read(json.loads(json.dumps(plain)))


@contextlib.contextmanager
def _without_children() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stages, "run_native", _run_here)
        patch.setattr(undistort, "run_native", _run_here)
        yield


@pytest.fixture(scope="session")
def kermit_sfm(
    kermit_dir: Path, kermit_names: list[str], tmp_path_factory: pytest.TempPathFactory
) -> SfmResult:
    """Read-only: tests that change something copy its folder.

    All tests that use it run in one worker: who reads a SQLite database makes files beside it for a moment.
    """
    folder = tmp_path_factory.mktemp("kermit") / "sfm"
    with _without_children():
        return reconstruct(ImageSet(kermit_dir, kermit_names), folder, SfmSettings(), Monitor())


@pytest.fixture(scope="session")
def without_children() -> Callable[[], AbstractContextManager[None]]:
    """Run the native jobs in this process in a ``with`` block: most take less time than a child's start."""
    return _without_children


@pytest.fixture
def native_here() -> Iterator[None]:
    """Run a test's native jobs in this process; not for tests of the child and of how it is stopped."""
    with _without_children():
        yield


@pytest.fixture(scope="module")
def all_native_here() -> Iterator[None]:
    """``native_here`` for all tests and fixtures of a module."""
    with _without_children():
        yield


@pytest.fixture(scope="session")
def yard_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine photographs of 320×240 px, half way around a synthetic scene, and the truth in transforms.json.

    22.5° from each to the next: neighbours register, what is three apart does not. Read-only.
    """
    folder = tmp_path_factory.mktemp("yard", numbered=False)
    camera = SimulatedCamera.like_a_drone(320, 240)
    write_photographs(folder, courtyard(0), camera, orbit(16)[:9], Monitor())
    return folder
