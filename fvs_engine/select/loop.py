"""The loop of the paper's Algorithm 1: learn a little, choose the next view, fly there, again."""

from pathlib import Path

from fvs_engine.monitor import Monitor
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.growing_scene import GrowingScene
from fvs_engine.select.loop_records import AlignmentRecord, RankedRecord, StepRecord, StepSeconds, StopReason
from fvs_engine.select.loop_settings import LoopSettings
from fvs_engine.splat.raster import Rasterizer

__all__ = [
    "AlignmentRecord",
    "LoopSettings",
    "RankedRecord",
    "SelectionLoop",
    "StepRecord",
    "StepSeconds",
    "StopReason",
]


class SelectionLoop:
    """A selection of views of one dataset, on disk after every step.

    ``scene`` is the growing scene, trained on what was visited; ``records`` are the steps so far.
    """

    scene: GrowingScene
    settings: LoopSettings
    dataset: Dataset
    records: tuple[StepRecord, ...]
    test_names: tuple[str, ...]
    """The held-out views, in order of capture."""
    initial: tuple[str, ...]
    """The initial views, in the order of their visit."""

    @classmethod
    def open(
        cls, folder: Path, dataset: Dataset, settings: LoopSettings, rasterizer: Rasterizer, monitor: Monitor
    ) -> "SelectionLoop":
        """Begin a selection in ``folder``, or go on with the one that is there."""
        ...

    @property
    def visited(self) -> tuple[str, ...]:
        """The initial and the chosen views, in the order of their visit."""
        return self.initial + tuple(record.chosen for record in self.records)

    @property
    def travel(self) -> float:
        """The way through the visited views, centre to centre, in the dataset's unit."""
        ...

    def begin(self, monitor: Monitor) -> None:
        """Learn what was visited so far; ``step`` does it too. Nothing is done twice."""
        ...

    def step(self, monitor: Monitor) -> StepRecord | StopReason:
        """Choose the next view, visit it and learn from it, or say why the selection ends here."""
        ...
