"""Stage two: which pairs show the same thing, matched and geometrically verified."""

from collections.abc import Sequence

from fvs_engine.errors import InvalidInputError
from fvs_engine.sfm.database import count_rows, gps_positions, image_ids, matched_pairs, read_descriptors
from fvs_engine.sfm.pairs import exhaustive_pairs, selected_pairs
from fvs_engine.sfm.retrieval import global_descriptors
from fvs_engine.sfm.stages import Stages

_BLOCK_IMAGES = 10
"""Matching commits after blocks of this many images squared: what an interruption can lose."""


def match_features(stages: Stages, names: Sequence[str]) -> None:
    """Match all pairs of a small set, the promising ones of a large one; what is done is skipped."""
    database = stages.folder.database
    ids = image_ids(database)
    known = [name for name in names if name in ids]
    exhaustive = len(known) <= stages.settings.exhaustive_up_to
    with stages.timed("pairs"):
        pairs = exhaustive_pairs(len(known)) if exhaustive else _select(stages, known)
    done = matched_pairs(database)
    numbers = [ids[name] for name in known]
    todo = [(i, j) for i, j in pairs if _ordered(numbers[i], numbers[j]) not in done]
    stages.pairs_matched = len(pairs)
    if todo:
        begun = len(done)
        with stages.timed("matching"):
            stages.native(
                "match",
                {
                    "database": str(database),
                    "pair_list": None if exhaustive else _write_list(stages, known, todo),
                    "block": _BLOCK_IMAGES,
                    "seed": stages.settings.seed,
                    "threads": stages.settings.threads,
                },
                on_tick=lambda: stages.monitor.report(
                    "matching",
                    min(
                        len(pairs),
                        len(pairs) - len(todo) + count_rows(database, "two_view_geometries") - begun,
                    ),
                    len(pairs),
                ),
            )
    stages.monitor.report("matching", len(pairs), len(pairs))


def _select(stages: Stages, names: Sequence[str]) -> list[tuple[int, int]]:
    database = stages.folder.database
    ids = image_ids(database)
    numbers = [ids[name] for name in names]

    def on_image(done: int) -> None:
        stages.monitor.report("pairs", done, len(names))
        stages.monitor.check()

    looks = global_descriptors(
        lambda i: read_descriptors(database, numbers[i]), len(names), stages.settings.seed, on_image
    )
    gps = gps_positions(database)
    return selected_pairs(
        len(names), looks, {i: gps[number] for i, number in enumerate(numbers) if number in gps}
    )


def _write_list(stages: Stages, names: Sequence[str], pairs: Sequence[tuple[int, int]]) -> str:
    spaced = next((name for name in names if any(letter.isspace() for letter in name)), None)
    if spaced is not None:
        raise InvalidInputError(
            f"The image name {spaced!r} has white space, which COLMAP's list of pairs cannot hold.",
            hint=f"Rename the images, or match every pair (exhaustive_up_to ≥ {len(names)}).",
        )
    file = stages.folder.root / "pairs.txt"
    file.write_text("".join(f"{names[i]} {names[j]}\n" for i, j in pairs), encoding="utf-8")
    return str(file)


def _ordered(first: int, second: int) -> tuple[int, int]:
    return min(first, second), max(first, second)
