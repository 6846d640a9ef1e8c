"""How the suite runs, and the photographs that several packages' tests share.

Every test has exactly one of the marks of ``_KINDS``; they are given here (``_kind``).
A unit or integration test that starts a process, listens on a port or reads a real photograph fails
(``_Watch``).
"""

import contextlib
import fcntl
import functools
import gc
import math
import os
import shutil
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import pytest
from PIL import Image
from xdist.scheduler import LoadScopeScheduling

# Whichever test imports pymavlink first.
os.environ["MAVLINK20"] = "1"

# Triton's kernels run in its interpreter where there is no device; it is asked when they are defined.
_HAS_DEVICE = Path("/dev/nvidia0").exists()
if not _HAS_DEVICE:
    os.environ["TRITON_INTERPRET"] = "1"

# How long an example takes says how busy the machine is.
hypothesis.settings.register_profile("quick", deadline=None, max_examples=25)
hypothesis.settings.register_profile("thorough", deadline=None, max_examples=200)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "quick"))

_TESTS = Path(__file__).resolve().parent
_DATA = Path(os.environ.get("FVS_DATA", _TESTS.parent.parent / "shared" / "data"))

# Fixtures that start a process or a server, or whose photographs go through structure from motion, which has
# a process of its own; and the files and folders whose tests do so.
_STARTS_PROCESSES = {"gateway", "open_gateway", "serve", "running", "script", "service", "serving"}
_STARTS_PROCESSES |= {"real_service", "played_service", "fvs", "fvs_command", "fvs_until", "yard_dir"}
_PROCESS_FILES = (
    "clients/test_command_line.py",
    "clients/test_ranking_commands.py",
    "console/",
    "contract/test_access_rule.py",
    "contract/test_released_contract.py",
    "clients/generated/",
    "deploy/test_proxy.py",
    "docs/test_code_blocks.py",
    "docs/test_site.py",
    "faults/",
    "fuzz/",
    "fvs_engine/compilation/test_ahead.py",
    "fvs_engine/pipeline/test_workspace.py",
    "fvs_engine/sfm/batch/",
    "fvs_engine/sfm/growing/test_reconstruction.py",
    "fvs_engine/sfm/matching/test_features.py",
    "fvs_engine/sfm/test_native_process.py",
    "fvs_engine/splat/test_processes.py",
    "fvs_service/rankings/test_abandoned_rankings.py",
    "fvs_service/webhooks/test_deliveries.py",
    "fvs_service/webhooks/test_sending.py",
    "fvs_service/rankings/test_streamed_rankings.py",
    "fvs_service/gateway/test_connection.py",
    "fvs_service/serving/test_serve.py",
    "fvs_service/serving/test_stop_signals.py",
    "fvs_service/test_tracing.py",
    "fvs_service/host/test_gpu_memory.py",
    "fvs_service/host/test_lease_watch.py",
    "fvs_service/host/test_async_connection.py",
    "fvs_service/host/test_listener.py",
    "fvs_service/host/test_protocol.py",
    "fvs_service/host/test_queue.py",
)
# Tests that train models, render pictures, plan flights or run threads, in this process.
_INTEGRATION_FILES = (
    "contract/test_worst_messages.py",
    "fvs_engine/cli/test_simulate.py",
    "fvs_engine/geometry/alignment/test_world.py",
    "fvs_engine/lab/evaluate/",
    "fvs_engine/lab/simulate/",
    "fvs_engine/plan/test_flight.py",
    "fvs_engine/plan/test_generate.py",
    "fvs_engine/plan/test_volumes.py",
    "fvs_engine/scene/",
    "fvs_engine/score/estimate/test_estimate.py",
    "fvs_engine/score/test_median_frequency_fast.py",
    "fvs_engine/select/",
    "fvs_engine/sfm/native/test_pose_review.py",
    "fvs_engine/sfm/native/test_pose_uncertainty.py",
    "fvs_engine/sfm/verification/test_scale.py",
    "fvs_engine/splat/raster/test_agreement.py",
    "fvs_engine/splat/raster/test_cuda.py",
    "fvs_engine/splat/test_trainer.py",
    "fvs_service/cli/test_operator_commands.py",
    "fvs_service/host/test_request_queue.py",
    "fvs_service/host/test_work.py",
)
_KINDS = ("unit", "integration", "process", "real")
# Tests that share a session's expensive fixtures run in one worker: beginning of a file's path → their group.
_IN_ONE_WORKER = {
    "console/": "console",
    "contract/": "contract",
    "docs/test_code_blocks.py": "code blocks",
    "fvs_engine/cli/reconstructed/": "a reconstruction",
    "fvs_service/host/test_life_of_a_scene.py": "a whole service",
    "fvs_engine/sfm/": "kermit_sfm",
    "fvs_engine/pipeline/test_cameras.py": "kermit_sfm",
}


def pytest_configure(config: pytest.Config) -> None:
    """With several workers, give each one thread: the machine has no more cores than workers; heed SIGINT."""
    if getattr(config.option, "numprocesses", None):
        os.environ.setdefault("OMP_NUM_THREADS", "1")
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # A shell's background jobs ignore it, and so would the processes that tests interrupt.
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_sessionstart(session: pytest.Session) -> None:
    """In a worker: have the kernels compiled once, by the first worker that gets here."""
    if not hasattr(session.config, "workerinput"):
        return
    import numba

    from fvs_engine.score.log_magnitude_median import compile_kernels
    from fvs_engine.splat.raster import create_rasterizer

    numba.set_num_threads(1)
    with _one_worker_at_a_time(_shared(session.config._tmp_path_factory) / "kernels"):
        create_rasterizer("cpu")
        compile_kernels()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what kind of test each is, and skip those of a GPU where there is none."""
    for item in items:
        if item.get_closest_marker("cuda") and not _has_cuda_device():
            item.add_marker(pytest.mark.skip("needs a CUDA device: run it on a machine with one, and gsplat"))
        fixtures = set(getattr(item, "fixturenames", ()))
        kind = _kind(item, fixtures)
        if item.get_closest_marker(kind) is None:
            item.add_marker(kind)


def pytest_collection_finish() -> None:
    """Do not look for garbage among what is imported and collected: a look takes seconds."""
    gc.collect()
    gc.freeze()


@functools.cache
def _has_cuda_device() -> bool:
    import torch

    return torch.cuda.is_available()


def _kind(item: pytest.Item, fixtures: set[str]) -> str:
    marked = [kind for kind in _KINDS if item.get_closest_marker(kind)]
    if len(marked) > 1:
        raise pytest.UsageError(f"{item.nodeid} is marked {' and '.join(marked)}; a test is of one kind.")
    if marked:
        return marked[0]
    if "data_dir" in fixtures:
        return "real"
    file = item.path.relative_to(_TESTS).as_posix()
    if fixtures & _STARTS_PROCESSES or file.startswith(_PROCESS_FILES):
        return "process"
    return "integration" if file.startswith(_INTEGRATION_FILES) else "unit"


class _Scheduling(LoadScopeScheduling):
    """Gives a worker one test at a time, or all tests that share an expensive fixture.

    These are the tests of a file with fixtures of its module, and those of a group in ``_IN_ONE_WORKER``.
    (The mark ``xdist_group`` has no effect with pytest 9.2: xdist 3.8 sets an attribute that is gone.)
    """

    def _split_scope(self, nodeid: str) -> str:
        file = nodeid.partition("::")[0]
        return _group(file.removeprefix("tests/")) or nodeid


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> _Scheduling:
    """Share the tests out by ``_Scheduling``, whatever ``--dist`` says."""
    return _Scheduling(config, log)


@functools.cache
def _group(file: str) -> str | None:
    group = next((group for path, group in _IN_ONE_WORKER.items() if file.startswith(path)), None)
    return group or (file if 'scope="module"' in (_TESTS / file).read_text(encoding="utf-8") else None)


class _Watch:
    """Fails a test in this process for forbidden actions, even where the code catches every exception."""

    EVENTS = ("subprocess.Popen", "os.fork", "os.forkpty", "os.posix_spawn", "socket.bind")
    if _HAS_DEVICE:
        EVENTS = EVENTS[-1:]  # Triton compiles for it in the first test, whichever that is, by processes

    def __init__(self) -> None:
        self.on = False
        self.seen: list[str] = []
        self.data = str(_DATA) + os.sep

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self.on:
            return
        if event == "open":
            if isinstance(arguments[0], str) and arguments[0].startswith(self.data):
                self._object(f"reads {arguments[0]}; it is a test of kind `real`: take `data_dir`")
        elif event in self.EVENTS:
            # Compiling the kernels is the first test's, whichever that is.
            if event == "subprocess.Popen" and "fvs_engine.compilation.child" in arguments[1]:
                return
            said = f"{event} {arguments!r}"[:300]
            self._object(
                f"does {said}; it is a test of kind `process`: mark it, or add it to tests/conftest.py"
            )

    def _object(self, what: str) -> None:
        self.seen.append(what)
        raise RuntimeError(f"This test {what}.")


_watch = _Watch()
sys.addaudithook(_watch)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    """Watch unit and integration tests from their fixtures on."""
    _watch.on = any(item.get_closest_marker(kind) for kind in ("unit", "integration"))
    return (yield)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown() -> Iterator[None]:
    """Fail a test for what it did, whatever became of the exception."""
    try:
        return (yield)
    finally:
        _watch.on = False
        seen, _watch.seen = _watch.seen, []
        assert not seen, f"This test {seen[0]}."


def _shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that all workers of this run share."""
    base = tmp_path_factory.getbasetemp()
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base


@contextlib.contextmanager
def _one_worker_at_a_time(path: Path) -> Iterator[None]:
    with path.with_name(f"{path.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real photographs: $FVS_DATA, or ../shared/data beside the repository.

    Where it is missing, tests skip; in CI (CI=true) or with FVS_REQUIRE_DATA=1 they fail.
    """
    if not _DATA.is_dir():
        missing = f"the real photographs are not here: {_DATA} is missing (set FVS_DATA to their folder)"
        if os.environ.get("CI") == "true" or os.environ.get("FVS_REQUIRE_DATA") == "1":
            pytest.fail(missing)
        pytest.skip(missing)
    return _DATA


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


@pytest.fixture(scope="session")
def room_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A synthetic dataset, read-only: photographs of a tiled room, and a COLMAP model that is exactly right.

    Twenty-four views of 96 × 72 px, two rounds about the middle, 0.8 units from each to the next; ``images/``
    and ``sparse/0``. The room is convex: whoever faces a point sees it.
    """
    from fvs_engine.geometry import PinholeCamera, look_at, quaternion_from_matrix

    folder = tmp_path_factory.mktemp("room")
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    (folder / "images").mkdir()
    half, views, points = 4.0, 24, 300
    draw = np.random.default_rng(0)
    camera = PinholeCamera(96, 72, 77.0, 77.0, 48.0, 36.0)
    tiles, grain = draw.uniform(0, 1, (6, 16, 16, 3)), draw.uniform(0, 1, (6, 64, 64, 3))

    def colors(on_walls: np.ndarray) -> np.ndarray:
        axis = np.abs(on_walls).argmax(axis=-1)
        wall = 2 * axis + (np.take_along_axis(on_walls, axis[..., None], -1)[..., 0] > 0)
        across = np.array([[1, 2], [0, 2], [0, 1]])[axis]
        place = np.clip((np.take_along_axis(on_walls, across, -1) + half) / (2 * half), 0, 1 - 1e-9)
        coarse, fine = (place * 16).astype(int), (place * 64).astype(int)
        return (
            0.65 * tiles[wall, coarse[..., 0], coarse[..., 1]]
            + 0.35 * grain[wall, fine[..., 0], fine[..., 1]]
        )

    axis = draw.integers(0, 6, points)
    xyz = draw.uniform(-half, half, (points, 3))
    xyz[np.arange(points), axis // 2] = np.where(axis % 2 == 0, half, -half)
    y, x = np.mgrid[:144, :192] / 2 + 0.25  # four rays per pixel
    rays = camera.unproject(np.stack([x, y], axis=-1))
    images, tracks = [], [""] * points
    for i in range(views):
        angle = 4 * math.pi * i / views
        centre = [1.55 * math.cos(angle), 1.55 * math.sin(angle), 0.3 + 0.6 * i / views]
        model_from_camera = look_at(centre, [0, 0, 0], [0, 0, 1])
        directions = rays @ model_from_camera.rotation.T
        lengths = ((np.sign(directions) * half - centre) / directions).min(axis=-1, keepdims=True)
        pixels = colors(centre + lengths * directions).reshape(72, 2, 96, 2, 3).mean(axis=(1, 3))
        Image.fromarray((255 * pixels).round().astype(np.uint8)).save(folder / "images" / f"{i:02d}.png")

        camera_from_model = model_from_camera.inverse()
        seen_at = camera.project(camera_from_model.apply(xyz))
        seen = np.flatnonzero((seen_at > 0).all(axis=1) & (seen_at < [96, 72]).all(axis=1))
        for number, point in enumerate(seen):
            tracks[point] += f" {i + 1} {number}"
        pose = [*quaternion_from_matrix(camera_from_model.rotation), *camera_from_model.translation]
        images += [" ".join(map(str, [i + 1, *pose, 1, f"{i:02d}.png"]))]
        images += [" ".join(f"{seen_at[p][0]} {seen_at[p][1]} {p + 1}" for p in seen)]
    rgb = (255 * colors(xyz)).round().astype(int)
    lines = [
        f"{p + 1} {' '.join(map(str, [*xyz[p], *rgb[p]]))} 0.1{tracks[p]}"
        for p in range(points)
        if tracks[p].count(" ") >= 4
    ]
    (model / "cameras.txt").write_text("1 PINHOLE 96 72 77 77 48 36\n")
    (model / "images.txt").write_text("\n".join(images) + "\n")
    (model / "points3D.txt").write_text("\n".join(lines) + "\n")
    return folder
