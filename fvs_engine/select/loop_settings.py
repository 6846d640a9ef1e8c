"""Settings of the loop that selects views."""

from typing import Self

from pydantic import Field, model_validator

from fvs_engine.choices import MAX_VEHICLES, HoldOut, InitialChoice
from fvs_engine.records import Record
from fvs_engine.scene.settings import SceneSettings


class LoopSettings(Record):
    """Settings of the loop; stored with the selection.

    ``budget`` counts all views, the ``initial`` ones included. Candidates are the unvisited views within
    ``radius`` of the current camera centre (in the dataset's unit), or the ``nearest`` N views; a number as
    large as the dataset puts all views in reach, and without either the radius is derived from the dataset
    (``fvs_engine.plan.reach.default_radius``). ``test_every``: of the views in order of capture, those with
    index % test_every == 0 are neither visited nor candidates; 0 holds out none; with ``hold_out`` ``random``
    as many others (``fvs_engine.hold_out``). ``initial_choice``: the ``first`` views in order of capture, as
    in the paper; ``consecutive`` ones from an index that ``seed`` draws; those ``farthest`` from one another,
    beginning with one that it draws; or the best of those ``planned`` for the whole budget.
    ``time_limit_s`` bounds one run, not a selection that is resumed. ``stop_at_db``: end when the expected
    PSNR over all views that may be visited is that high; ``stop_at_gain_db``: when no view in reach is
    expected to add that much.
    ``max_travel``: how far each of the ``vehicles`` flies after the initial views, in the dataset's unit; a
    vehicle whose next view would exceed it flies no more. All begin at the last initial view.
    ``registrable``: with estimated poses, choose only among views that are likely to be registered.
    """

    scene: SceneSettings
    method: str = "median-frequency"
    initial: int = Field(default=10, ge=2)
    initial_choice: InitialChoice = "first"
    budget: int = Field(default=100, ge=2)
    radius: float | None = Field(default=None, gt=0)
    nearest: int | None = Field(default=None, ge=1)
    test_every: int = Field(default=8, ge=0)
    hold_out: HoldOut = "every"
    seed: int = Field(default=0, ge=0)
    time_limit_s: float | None = Field(default=None, gt=0)
    stop_at_db: float | None = Field(default=None, gt=0, le=100)
    stop_at_gain_db: float | None = Field(default=None, gt=0, le=100)
    max_travel: float | None = Field(default=None, gt=0)
    vehicles: int = Field(default=1, ge=1, le=MAX_VEHICLES)
    registrable: bool = True

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if self.radius is not None and self.nearest is not None:
            raise ValueError("candidates are within a radius or the nearest few: give one of the two")
        if self.budget < self.initial:
            raise ValueError(f"budget ({self.budget}) must not be less than initial ({self.initial})")
        return self
