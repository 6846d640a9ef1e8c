"""Matching of names from a COLMAP model, a ``transforms.json`` or a request to image files."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from fvs_engine.errors import InvalidInputError

_LISTED = 8

MASKS = "masks"
"""The folder of masks, beside photographs."""


def is_mask(name: str) -> bool:
    """Whether the file of that path below a folder of photographs is a mask."""
    return MASKS in PurePosixPath(name).parts[:-1]


def listed(names: Sequence[str]) -> str:
    """The names for a message: the first few, and how many more there are."""
    more = len(names) - _LISTED
    return ", ".join(names[:_LISTED]) + (f" and {more} more" if more > 0 else "")


@dataclass(frozen=True)
class NameMatches:
    """``found``: name → image; ``missing``: names without an image; ``ambiguous``: name → images it may mean.

    No image is found twice. An ambiguous name shares its last part with several images, or an image with
    another name.
    """

    found: Mapping[str, str]
    missing: tuple[str, ...]
    ambiguous: Mapping[str, tuple[str, ...]]

    def require_unambiguous(self) -> None:
        """Raise ``InvalidInputError`` for the first ambiguous name."""
        for name, images in self.ambiguous.items():
            others = [other for other, image in self.found.items() if image in images]
            others += [other for other, same in self.ambiguous.items() if other != name and same == images]
            claimed = f", and so may {others[0]}" if others and len(images) == 1 else ""
            raise InvalidInputError(
                f"{name} may mean {' or '.join(images)}{claimed}.",
                hint="Give the folder above, in which their paths differ, or rename the images.",
            )


def match_names(names: Iterable[str], images: Mapping[str, str]) -> NameMatches:
    """Match ``names`` to images.

    ``images``: every name of an image → the name that the result uses. A name means the image of
    the same path; else the only one with the same last part, if no other name has that part, too:
    ``images/0001.jpg`` may be ``0001.jpg``, but neither of ``left/0001.jpg`` and ``right/0001.jpg``.
    """
    asked = {name: PurePosixPath(name) for name in names}
    by_part: dict[str, set[str]] = {}
    for alias, image in images.items():
        by_part.setdefault(PurePosixPath(alias).name, set()).add(image)
    found = {name: images[path.as_posix()] for name, path in asked.items() if path.as_posix() in images}
    taken = set(found.values())
    claims = Counter(path.name for path in asked.values())
    missing = []
    ambiguous = {}
    for name, path in asked.items():
        if name in found:
            continue
        meant = by_part.get(path.name, set())
        if len(meant - taken) == 1 and claims[path.name] == 1:
            found[name] = next(iter(meant - taken))
        elif meant:
            ambiguous[name] = tuple(sorted(meant))
        else:
            missing.append(name)
    return NameMatches(found, tuple(missing), ambiguous)


def match_files(names: Iterable[str], folder: Path) -> NameMatches:
    """Match ``names`` to files below ``folder`` but masks; the result has the files' posix paths in it.

    Raises ``InvalidInputError`` when a name is ambiguous.
    """
    paths = (path for path in folder.rglob("*") if path.is_file() and not path.name.startswith("."))
    files = [path.relative_to(folder).as_posix() for path in paths]
    matches = match_names(names, {file: file for file in files if not is_mask(file)})
    matches.require_unambiguous()
    return matches
