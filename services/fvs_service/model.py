"""What all domain models have in common: immutable, unknown fields and non-finite numbers refused."""

from datetime import UTC, datetime
from typing import Annotated

from pydantic import AwareDatetime, BaseModel, BeforeValidator, ConfigDict, Field


class Model(BaseModel):
    """Base of everything that crosses an interface, in either direction."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
"""A finite number; not a string that looks like one."""


def _whole(value: object) -> object:
    return int(value) if isinstance(value, float) and value.is_integer() else value


WholeNumber = Annotated[int, Field(strict=True), BeforeValidator(_whole)]
"""A whole number, also written ``3.0``, which JSON does not tell apart; not a string, not ``true``."""
Count = Annotated[WholeNumber, Field(ge=0)]
PositiveNumber = Annotated[Number, Field(gt=0)]
Digest = Annotated[str, Field(pattern=r"^sha256:[0-9a-f]{64}$")]
"""The SHA-256 of an image's bytes."""
Timestamp = AwareDatetime


class Page(Model):
    """The part of a list that is asked for: ``limit`` items after the one that ``after`` names."""

    after: str | None = Field(default=None, max_length=128)
    """`next` of the page before."""
    limit: int = Field(default=100, ge=1, le=1000)


class NumberedPage(Page):
    """A page of a list whose items are numbered."""

    after: Annotated[str, Field(pattern=r"^[0-9]{1,9}$")] | None = None
    """`next` of the page before."""


def now() -> datetime:
    """The present, in UTC."""
    return datetime.now(UTC)
