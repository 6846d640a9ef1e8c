"""The witness: matches of ALIKED's features, which check a model of SIFT features before it is accepted.

Learned features fail on other images than SIFT: a view that repeated structure has misplaced, in agreement
with all of its SIFT matches, hardly ever agrees with these. Mixed with SIFT features they would inherit their
false pairs, so no model is made from them.
"""

from collections.abc import Collection, Sequence
from pathlib import Path

from fvs_engine.sfm.aliked.weights_file import aliked_weights
from fvs_engine.sfm.colmap.database import feature_counts, image_ids, matched_pairs
from fvs_engine.sfm.stages import Stages
from fvs_engine.sfm.verification.witness import WitnessMatches


def ask_witness(
    stages: Stages, image_dir: Path, names: Collection[str] | None = None
) -> WitnessMatches | None:
    """The witness's matches of the pairs that SIFT features were matched in; None without its weights.

    Only pairs with one of ``names``, if given, are matched; what its database has is not computed again.
    Progress is that of the stage ``evidence``.
    """
    weights = aliked_weights()
    if weights is None or not stages.settings.witness:
        return None
    database, target = stages.folder.database, stages.folder.witness
    numbers = {number: name for name, number in image_ids(database).items()}
    asked = set(numbers.values()) if names is None else set(names)
    pairs = [
        (numbers[first], numbers[second])
        for first, second in sorted(matched_pairs(database))
        if numbers[first] in asked or numbers[second] in asked
    ]
    with stages.timed("witness"):
        _extract(stages, image_dir, sorted({name for pair in pairs for name in pair}), weights)
        if not target.exists():
            return None
        known = image_ids(target)
        done = matched_pairs(target)
        todo = [pair for pair in pairs if tuple(sorted(known[name] for name in pair)) not in done]
        if todo:
            stages.native_over(
                "match_aliked",
                todo,
                lambda some: {"database": str(target), "pairs": list(some), "seed": stages.settings.seed},
                image_of=lambda pair: pair[0],
                on_event=lambda number: stages.monitor.report("evidence", number, len(todo)),
            )
    return WitnessMatches.read(target)


def _extract(stages: Stages, image_dir: Path, names: Sequence[str], weights: Path) -> None:
    target = stages.folder.witness
    done = feature_counts(target) if target.exists() else {}
    todo = [name for name in names if name not in done]
    if todo:
        stages.native_over(
            "extract_aliked",
            todo,
            lambda some: {
                "database": str(stages.folder.database),
                "target": str(target),
                "image_dir": str(image_dir),
                "names": list(some),
                "weights": str(weights),
                "threads": stages.settings.threads,
            },
            controls=[name for name in names if name in done],
            on_event=lambda number: stages.monitor.report("evidence", number, len(todo)),
        )
