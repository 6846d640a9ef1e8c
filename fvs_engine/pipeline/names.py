"""Which photograph is meant by the name that a file made elsewhere gives it."""

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import PurePosixPath


def match_names(foreign: Iterable[str], known: Mapping[str, str]) -> dict[str, str]:
    """Find the photographs that ``foreign`` names mean: foreign name → the photograph's own name.

    ``known`` maps every name of a photograph (that in the source folder, that in ``images/``) to its own. A
    foreign name means the photograph of that name; else the only one with the same last part, if no other
    foreign name has that part too: ``images/0001.jpg`` may be ``0001.jpg``, but never either of
    ``left/0001.jpg`` and ``right/0001.jpg``. What means no photograph is left out.
    """
    names = list(dict.fromkeys(foreign))
    by_part: dict[str, set[str]] = {}
    for alias, own in known.items():
        by_part.setdefault(_last_part(alias), set()).add(own)
    claims = Counter(_last_part(name) for name in names)
    found = {name: known[name] for name in names if name in known}
    taken = set(found.values())
    for name in names:
        meant = by_part.get(_last_part(name), set()) - taken
        if name not in found and len(meant) == 1 and claims[_last_part(name)] == 1:
            found[name] = meant.pop()
    return found


def _last_part(name: str) -> str:
    return PurePosixPath(name).name
