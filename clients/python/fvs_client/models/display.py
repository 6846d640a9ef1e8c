"""What notebooks and the command line show: tables, poses and images."""

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

from fvs_schema.poses import FramePose, VehiclePose
from fvs_schema.scenes import Alignment, AlignmentStatus

ReprArgs = Iterable[tuple[str, object]]
"""What ``repr`` shows of a model."""

_MOST_ROWS = 30
"""Rows of a table in a notebook."""


@dataclass(frozen=True)
class Table:
    """A table as text; columns with a heading of ``right_aligned`` hold numbers."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    right_aligned: frozenset[str]


def table_html(table: Table, caption: str, notes: Iterable[str] = ()) -> str:
    """The first rows of a table as HTML, with paragraphs under it."""
    head = "".join(_cell("th", heading, heading in table.right_aligned) for heading in table.headings)
    body = "".join(
        "<tr>" + "".join(map(_cell, ["td"] * len(row), row, _aligned(table))) + "</tr>"
        for row in table.rows[:_MOST_ROWS]
    )
    more = len(table.rows) - _MOST_ROWS
    lines = [*([f"… and {more} more"] if more > 0 else []), *notes]
    return (
        f"<table><caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        + "".join(f"<p>{escape(line)}</p>" for line in lines)
    )


def facts_html(caption: str, facts: Iterable[tuple[str, str]]) -> str:
    """Names and what they stand for as HTML."""
    rows = "".join(f"<tr>{_cell('th', name)}{_cell('td', text)}</tr>" for name, text in facts)
    return f"<table><caption>{escape(caption)}</caption><tbody>{rows}</tbody></table>"


def pose_text(pose: FramePose | VehiclePose) -> str:
    """A pose in a table."""
    if isinstance(pose, VehiclePose):
        return (
            f"{pose.latitude_deg:.6f} {pose.longitude_deg:.6f} {pose.altitude_m:.1f} m, "
            f"yaw {pose.yaw_deg:.0f}° pitch {pose.pitch_deg:.0f}°"
        )
    return " ".join(f"{part:.2f}" for part in pose.position)


def with_unit(what: str, alignment: Alignment) -> str:
    """A heading of lengths in the world frame, with their unit: there is none without an alignment."""
    return what if alignment.status is AlignmentStatus.MODEL else f"{what} (m)"


def _aligned(table: Table) -> Sequence[bool]:
    return [heading in table.right_aligned for heading in table.headings]


def _cell(tag: str, text: str, right: bool = False) -> str:
    return f'<{tag} style="text-align: {"right" if right else "left"}">{escape(text)}</{tag}>'


class Png(bytes):
    """A PNG file as bytes; a notebook shows it."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        return _image_html(self, "image/png")


class Jpeg(bytes):
    """A JPEG file as bytes; a notebook shows it."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        return _image_html(self, "image/jpeg")


def _image_html(content: bytes, media_type: str) -> str:
    return f'<img src="data:{media_type};base64,{base64.b64encode(content).decode()}">'
