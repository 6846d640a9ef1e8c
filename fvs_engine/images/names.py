"""Matching of names from a COLMAP model, a ``transforms.json`` or a request to image files.

Other systems spell the same name otherwise: with backslashes, in another Unicode form or character set, with
capitals, with another suffix or none. Such a name is matched where exactly one image can be meant.
"""

import contextlib
import os
import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from fvs_engine.errors import InvalidInputError
from fvs_schema.findings import Finding, FindingCode, Severity
from fvs_schema.masks import is_mask
from fvs_schema.names import readable_name

_LISTED = 8
_IMAGE_SUFFIX = re.compile(r"\.(?:jpe?g|jpe|mpo|png|tiff?|webp|bmp)$")
_CHARACTER_SETS = ("gb18030", "cp932", "big5", "cp949", "cp1252", "cp1251", "cp437")
"""Those in which programs on Windows write names."""


def listed(names: Sequence[str]) -> str:
    """The names for a message: the first few, and how many more there are."""
    more = len(names) - _LISTED
    return ", ".join(names[:_LISTED]) + (f" and {more} more" if more > 0 else "")


def decoded_name(name: bytes) -> str:
    """The name in a file as a ``readable_name``."""
    return readable_name(name.decode("utf-8", "surrogateescape"))


@dataclass(frozen=True)
class NameMatches:
    """``found``: name → image; ``missing``: names without an image; ``ambiguous``: name → images it may mean.

    No image is found twice. An ambiguous name shares its last part with several images, or an image with
    another name. ``respelled`` names are those found whose image is spelled otherwise.
    """

    found: Mapping[str, str]
    missing: tuple[str, ...]
    ambiguous: Mapping[str, tuple[str, ...]]
    respelled: tuple[str, ...] = ()

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

    def findings(self) -> tuple[Finding, ...]:
        """The note on the respelled names, if there are any."""
        if not self.respelled:
            return ()
        images = [readable_name(self.found[name]) for name in self.respelled]
        code, note = FindingCode.NAMES_RESPELLED, Severity.NOTE
        return (Finding.of(code, images, note, name=readable_name(self.respelled[0]), image=images[0]),)


def match_names(names: Iterable[str], images: Mapping[str, str]) -> NameMatches:
    """Match ``names`` to images.

    ``images``: every name of an image → the name that the result uses. A name means the image of
    the same path; else the only one with the same last part, if no other name has that part, too:
    ``images/0001.jpg`` may be ``0001.jpg``, but neither of ``left/0001.jpg`` and ``right/0001.jpg``. Where
    there is none, other spellings count as the same, from the nearest to the farthest (``_SPELLINGS``), in
    the whole path and then in its last part.
    """
    asked = tuple(dict.fromkeys(names))
    found = {name: images[path] for name in asked if (path := PurePosixPath(name).as_posix()) in images}
    respelled: list[str] = []
    ambiguous: dict[str, tuple[str, ...]] = {}
    others = ((spelled, part) for spelled in _SPELLINGS for part in (_all, _last))
    for spelled, part in ((_exact, _last), *others):
        if len(found) == len(asked):
            break
        meant: dict[str, set[str]] = {}
        for alias, image in images.items():
            for form in (alias,) if spelled is _exact else _forms(alias):
                meant.setdefault(part(spelled(form)), set()).add(image)
        keys = {name: part(spelled(name)) for name in asked}
        claims, taken = Counter(keys.values()), set(found.values())
        alone = {}
        for name in asked:
            possible = meant.get(keys[name], set())
            if name in found or not possible:
                continue
            if len(possible - taken) == 1 and claims[keys[name]] == 1:
                alone[name] = next(iter(possible - taken))
            elif spelled is not _without_suffix:
                ambiguous.setdefault(name, tuple(sorted(possible)))
        of_image = Counter(alone.values())
        new = {name: image for name, image in alone.items() if of_image[image] == 1}
        if spelled is not _without_suffix:
            ambiguous |= {name: (image,) for name, image in alone.items() if name not in new}
        found |= new
        respelled += new if spelled is not _exact else ()
    unclear = {name: possible for name, possible in ambiguous.items() if name not in found}
    missing = tuple(name for name in asked if name not in found and name not in unclear)
    return NameMatches(found, missing, unclear, tuple(respelled))


def match_files(names: Iterable[str], folder: Path, leave_out: Container[Path] = ()) -> NameMatches:
    """Match ``names`` to files below ``folder`` but masks; the result has the files' posix paths in it.

    The files ``leave_out``, resolved, are no images either. Raises ``InvalidInputError`` when a name is
    ambiguous.
    """
    paths = [path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".")]
    if leave_out:
        paths = [path for path in paths if path.resolve() not in leave_out]
    files = [path.relative_to(folder).as_posix() for path in paths]
    matches = match_names(names, {file: file for file in files if not is_mask(file)})
    matches.require_unambiguous()
    return matches


def _exact(name: str) -> str:
    return PurePosixPath(name).as_posix()


def _in_one_form(name: str) -> str:
    """With slashes, its letters in Unicode's composed form."""
    return PurePosixPath(unicodedata.normalize("NFC", name.replace("\\", "/"))).as_posix()


def _in_lower_case(name: str) -> str:
    return _in_one_form(name).casefold()


def _without_suffix(name: str) -> str:
    """In lower case, without the suffix of an image."""
    return _IMAGE_SUFFIX.sub("", _in_lower_case(name))


_SPELLINGS: tuple[Callable[[str], str], ...] = (_in_one_form, _in_lower_case, _without_suffix)


def _all(path: str) -> str:
    return path


def _last(path: str) -> str:
    return path.rpartition("/")[2]


def _forms(name: str) -> Iterator[str]:
    """The name, and how it reads when its bytes, or those of another system's name for it, are decoded."""
    yield name
    if name.isascii():
        return
    stored = os.fsencode(name)
    yield decoded_name(stored)
    for encoding in _CHARACTER_SETS:
        with contextlib.suppress(UnicodeError):
            yield stored.decode(encoding)
        with contextlib.suppress(UnicodeError):
            yield decoded_name(unicodedata.normalize("NFC", name).encode(encoding))
