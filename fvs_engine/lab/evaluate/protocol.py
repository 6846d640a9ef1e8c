"""Protocols of a comparison: the settings that all its runs share."""

from typing import Annotated, Literal, Self

from pydantic import Field, ValidationError, model_validator

from fvs_engine.choices import MAX_VEHICLES, HoldOut, InitialChoice, Poses, ProtocolName
from fvs_engine.errors import InvalidInputError
from fvs_engine.hold_out import hold_out
from fvs_engine.plan.distances import path_length
from fvs_engine.records import Record, first_error
from fvs_engine.scene.dataset import Dataset

QUARTERS = (0.25, 0.5, 0.75, 1.0)


class Protocol(Record):
    """The settings of a comparison; frozen, and stored beside its results.

    ``initial`` views are given: the ``first`` of the capture, ``consecutive`` ones from an index that the
    seed draws, or the ``farthest`` from one another, beginning with one that it draws. Then views are chosen
    one by one among the unvisited ones in ``reach`` of the current camera until ``budget`` are visited:
    ``all``; those within a ``radius`` of its centre, in the dataset's unit (None: as the loop derives it from
    the dataset); or the ``nearest`` N views. Quality is measured when the numbers in ``view_counts``
    are reached, on every ``test_every``-th photograph by name, or as many ``random`` ones (``hold_out``),
    which no selector has access to.

    With ``travel_shares`` travel is a budget, too: each of the ``vehicles`` flies at most ``max_travel``
    after the initial views (None: the length of the capture, see ``for_dataset``), and quality is also
    measured before the view that would take a vehicle beyond each of these shares of it.

    ``poses``: ``known``, those of the dataset; ``sfm``, estimated from the visited images. With ``sfm``
    and ``priors`` the dataset's poses are their pose priors, with noise: ``position_noise_percent`` of the
    spread of its cameras in each coordinate, ``orientation_noise_deg`` about each axis. With ``registrable``
    views are chosen only among those that are likely to be registered.
    The full model, which is measured, has ``iterations_per_view`` iterations for every view, at least
    ``initial_iterations``; views are chosen by a quick one (``SceneSettings``). Of the views at the end of a
    run as many full models as ``trainings`` are trained, each by a seed of its own, and their means count:
    that separates the choice of views from the luck of training. ``time_limit_s`` ends a run early, which the
    report mentions.

    What the seed changes: which views are given (not with ``first``), the choices of selectors that draw at
    random, the noise of priors, and the order of views and the splits of Gaussians in training. Nothing else,
    so that runs of one seed differ by the selector alone.
    """

    name: str
    initial: int = Field(ge=2)
    initial_choice: InitialChoice
    view_counts: tuple[int, ...] = Field(min_length=1)
    poses: Poses
    priors: bool = True
    position_noise_percent: float = Field(default=2.0, ge=0, le=100)
    orientation_noise_deg: float = Field(default=5.0, ge=0, le=180)
    reach: Literal["all", "radius", "nearest"]
    radius: float | None = Field(default=None, gt=0)
    nearest: int | None = Field(default=None, ge=1)
    test_every: int = Field(default=8, ge=2)
    hold_out: HoldOut = "every"
    long_side_px: int = Field(default=640, ge=64)
    initial_iterations: int = Field(default=1_000, ge=1)
    iterations_per_view: int = Field(default=100, ge=0)
    max_gaussians: int = Field(default=300_000, ge=1)
    time_limit_s: float | None = Field(default=None, gt=0)
    registrable: bool = True
    trainings: int = Field(default=1, ge=1, le=100)
    max_travel: float | None = Field(default=None, gt=0)
    travel_shares: tuple[Annotated[float, Field(gt=0, le=1)], ...] = ()
    vehicles: int = Field(default=1, ge=1, le=MAX_VEHICLES)

    @model_validator(mode="after")
    def _counts_rise_from_the_initial_views(self) -> Self:
        counts = self.view_counts
        if list(counts) != sorted(set(counts)) or counts[0] < self.initial:
            raise ValueError(
                f"view_counts must rise and begin at no less than the {self.initial} initial views, "
                f"not {', '.join(map(str, counts))}"
            )
        return self

    @model_validator(mode="after")
    def _one_reach(self) -> Self:
        fits = {
            "all": self.radius is None and self.nearest is None,
            "radius": self.nearest is None,
            "nearest": self.radius is None and self.nearest is not None,
        }
        if not fits[self.reach]:
            raise ValueError(
                "candidates are all, those within a radius, or the nearest few: give one of the three"
            )
        return self

    @model_validator(mode="after")
    def _shares_rise_to_the_whole(self) -> Self:
        shares = self.travel_shares
        if shares and (list(shares) != sorted(set(shares)) or shares[-1] != 1):
            raise ValueError(f"travel_shares must rise to 1, not {', '.join(map(str, shares))}")
        if self.max_travel is not None and not shares:
            raise ValueError("a max_travel needs travel_shares, at which to measure")
        return self

    def for_dataset(self, dataset: Dataset) -> "Protocol":
        """The protocol with the travel that follows from the dataset where it is a budget and not given.

        Raises ``InvalidInputError`` where all views have one position.
        """
        if not self.travel_shares or self.max_travel is not None:
            return self
        pool, _ = hold_out(dataset.names, self.test_every, self.hold_out)
        capture = path_length([dataset.by_name[name].centre for name in pool])
        if capture <= 0:
            raise InvalidInputError(
                f"All views of {dataset.name} have the same position: no travel follows from its capture.",
                hint="Compare by views instead (--preset fisherrf).",
            )
        return self.model_copy(update={"max_travel": capture})

    @property
    def budget(self) -> int:
        """Number of views visited in all."""
        return self.view_counts[-1]


PRESETS: dict[ProtocolName, Protocol] = {
    "paper": Protocol(
        name="paper",
        initial=10,
        initial_choice="first",
        view_counts=(10, 20, 40, 60, 80, 100),
        poses="sfm",
        reach="radius",
    ),
    "fisherrf": Protocol(
        name="fisherrf",
        initial=4,
        initial_choice="farthest",
        view_counts=(5, 10, 15, 20),
        poses="known",
        reach="all",
    ),
    "nearest5": Protocol(
        name="nearest5",
        initial=4,
        initial_choice="consecutive",
        view_counts=(5, 10, 15, 20),
        poses="known",
        reach="nearest",
        nearest=5,
    ),
    "travel": Protocol(
        name="travel",
        initial=4,
        initial_choice="consecutive",
        view_counts=(20,),
        poses="known",
        reach="all",
        travel_shares=QUARTERS,
    ),
}
"""``paper``: the method's own setting, Algorithm 1 with its schedule. ``fisherrf``: FisherRF's 20 views on
Mip-NeRF360, any view may be next. ``nearest5``: as on a vehicle, only the five nearest unvisited views may be
next, and the given ones lie side by side. ``travel``: any view may be next, but a run ends where the vehicle
has flown as far as the capture did, or as requested, and with 20 views at most."""


def protocol_from_preset(preset: str, **changes: object) -> Protocol:
    """A preset with some of its numbers changed; changes that are None leave the preset's.

    ``radius`` or ``nearest`` also set the ``reach``, and with ``max_travel`` quality is measured at quarters
    of it. Raises ``InvalidInputError`` for an unknown preset and for numbers that are out of range or
    contradict each other.
    """
    found = next((protocol for name, protocol in PRESETS.items() if name == preset), None)
    if found is None:
        raise InvalidInputError(
            f"There is no preset {preset!r}.", hint=f"Choose one of {', '.join(PRESETS)}."
        )
    given = {name: value for name, value in changes.items() if value is not None}
    reach: dict[str, object] = {}
    for limit in ("radius", "nearest"):
        if limit in given:
            reach = {"radius": None, "nearest": None, "reach": limit}
    if "max_travel" in given and not found.travel_shares:
        given.setdefault("travel_shares", QUARTERS)
    try:
        return Protocol.model_validate({**found.model_dump(), **reach, **given})
    except ValidationError as error:
        raise InvalidInputError(f"{first_error(error, 'These settings cannot be used')}.") from error
