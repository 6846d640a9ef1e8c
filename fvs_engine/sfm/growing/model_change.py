"""What a step of growth makes of a model."""

from dataclasses import dataclass, replace
from typing import Any

from fvs_engine.sfm.growing.state import GrowthState


@dataclass(frozen=True)
class ModelChange:
    """Result of registering images, or of a re-map.

    ``changed``: a model other than the current one was written; ``mapper`` made it, None without a re-map.
    ``match_support``: share of the verified matches that the model explains, known after a global bundle
    adjustment or a re-map. ``tried``: the images whose registration was tried.
    """

    state: GrowthState
    changed: bool = False
    mapper: str | None = None
    match_support: float | None = None
    warnings: tuple[str, ...] = ()
    tried: tuple[str, ...] = ()

    def with_state(self, **update: Any) -> "ModelChange":
        """The same change, with other values of the state's fields."""
        return replace(self, state=self.state.model_copy(update=update))
