"""Tables of the calibration of the gate: verdicts, and what each threshold does to right and wrong models."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from fvs_engine.sfm.report import Verdict
from fvs_engine.sfm.settings import GateSettings
from fvs_engine.sfm.verification.thresholds import DEPTHS, PAIRS

SHARES = np.arange(0.005, 0.0501, 0.0025).tolist()
"""Candidates for the threshold of loosely linked images."""
DEPTH_ERRORS = (0.3, 0.2, 0.15, 0.1, 0.07, 0.05, 0.03, 0.02, 0.01)
"""Candidates for the threshold of depths that disagree."""
_SUPPORTS = (0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.88, 0.9, 0.92, 0.95, 0.97)
_MISSED = 3
"""Right models that may be doubted for one more wrong one that is not accepted."""


@dataclass(frozen=True)
class Judged:
    """A model by one version of the gate: its verdict, and the number of wrong images that it left in."""

    verdict: Verdict
    wrong: int
    left_out: tuple[str, ...] = ()
    """The images that it left out."""


@dataclass(frozen=True)
class Case:
    """A model, of whose ``images`` some are ``wrong``, and how the versions of the gate judge it.

    Shares and errors are those of the model without the images that the gate left out.
    """

    scene: str
    subset: str
    kind: str
    mapped: bool
    """Whether a mapper made it, and not ``gate_models.spoilt``."""
    images: int
    wrong: int
    link_share: float
    """The largest of ``SHARES`` that leaves no image loosely linked; 0 when all do."""
    depth_error: float
    """The smallest of ``DEPTH_ERRORS`` by which depths confirm all distances; infinite when none does."""
    supports: dict[str, float | None]
    """Match, rotation and translation support by the names of their settings."""
    before: Judged
    pairs: Judged
    present: Judged
    """By the first gate, by that with links, and by the present one."""
    open: dict[str, Judged]
    """By the present gate, when one of the thresholds of support is zero."""


@dataclass(frozen=True)
class Threshold:
    """A threshold of the gate, and the models about which it decides.

    ``values`` go from the one that doubts the fewest models to the one that doubts the most; ``judged`` is
    how the gate judges without this threshold, None of models that are not its matter.
    """

    name: str
    now: float
    values: Sequence[float]
    value: Callable[[Case], float]
    judged: Callable[[Case], Judged | None]
    upper: bool = False

    def doubts(self, case: Case, at: float) -> bool:
        return self.value(case) > at if self.upper else self.value(case) < at

    def decided(self, cases: Sequence[Case]) -> tuple[list[Case], list[Case]]:
        """The right and the wrong ones of the models that the rest of the gate accepts."""
        found = [(case, one) for case in cases if (one := self.judged(case)) is not None]
        accepted = [(case, one) for case, one in found if one.verdict == "accepted"]
        right = [case for case, one in accepted if one.wrong == 0]
        return right, [case for case, one in accepted if one.wrong > 0]

    def errors(self, cases: Sequence[Case], at: float) -> tuple[int, int]:
        """The number of wrong models that pass, and of right ones that are doubted."""
        right, wrong = self.decided(cases)
        return (
            sum(not self.doubts(case, at) for case in wrong),
            sum(self.doubts(case, at) for case in right),
        )

    def best(self, cases: Sequence[Case]) -> float:
        """The value of the fewest errors, of which a wrong model that passes counts most."""

        def cost(at: float) -> int:
            passed, doubted = self.errors(cases, at)
            return _MISSED * passed + doubted

        return min(self.values, key=cost)


def thresholds() -> list[Threshold]:
    defaults = GateSettings()
    return [
        Threshold(
            "least share of linked features",
            PAIRS.min_link_share,
            SHARES,
            lambda case: case.link_share,
            lambda case: case.before if case.mapped else None,
        ),
        Threshold(
            "greatest error of depths",
            DEPTHS.max_log_error,
            DEPTH_ERRORS,
            lambda case: case.depth_error,
            lambda case: case.pairs,
            upper=True,
        ),
        *(
            Threshold(
                name,
                getattr(defaults, name),
                _SUPPORTS,
                partial(_support, name),
                partial(_opened, name),
            )
            for name in ("min_match_support", "min_rotation_support", "min_translation_support")
        ),
    ]


def _support(name: str, case: Case) -> float:
    support = case.supports[name]
    return 1.0 if support is None else support  # what is not known doubts nothing


def _opened(name: str, case: Case) -> Judged:
    return case.open[name]


def summary(cases: Sequence[Case]) -> list[dict[str, object]]:
    """False accepts, doubts and refusals of every version of the gate, scene by scene."""
    versions: dict[str, Callable[[Case], Judged]] = {
        "first": lambda case: case.before,
        "links": lambda case: case.pairs,
        "now": lambda case: case.present,
    }
    rows = []
    for scene in (*_scenes(cases), "all"):
        for name, judged in versions.items():
            of = [(case, judged(case)) for case in cases if scene in (case.scene, "all")]
            sound = [one for case, one in of if case.wrong == 0]
            bad = [one for case, one in of if case.wrong > 0]
            if of:
                rows.append(
                    {
                        "scene": scene,
                        "gate": name,
                        "right": len(sound),
                        "accepted": sum(one.verdict == "accepted" for one in sound),
                        "doubtful": sum(one.verdict == "doubtful" for one in sound),
                        "refused": sum(one.verdict == "rejected" for one in sound),
                        "wrong": len(bad),
                        "wrong accepted": sum(one.verdict == "accepted" and one.wrong > 0 for one in bad),
                        "cleaned": sum(one.verdict != "rejected" and one.wrong == 0 for one in bad),
                        "wrong doubtful": sum(one.verdict == "doubtful" and one.wrong > 0 for one in bad),
                        "wrong refused": sum(one.verdict == "rejected" for one in bad),
                    }
                )
    return rows


def characteristics(cases: Sequence[Case], of: Threshold) -> list[dict[str, object]]:
    """What each value of a threshold doubts, of the models that the rest of the gate accepts."""
    right, wrong = of.decided(cases)
    return [
        {
            of.name: float(value),
            "right doubted": f"{sum(of.doubts(case, value) for case in right)} of {len(right)}",
            "wrong doubted": f"{sum(of.doubts(case, value) for case in wrong)} of {len(wrong)}",
        }
        for value in of.values
    ]


def left_out(cases: Sequence[Case], of: Threshold) -> list[dict[str, object]]:
    """For each scene: the value that the other scenes give, and its errors on this one and on all."""
    rows = []
    for scene in _scenes(cases):
        value = of.best([case for case in cases if case.scene != scene])
        own = [case for case in cases if case.scene == scene]
        right, wrong = of.decided(own)
        rows.append(_row(scene, value, of.errors(own, value), of.errors(own, of.now), right, wrong))
    right, wrong = of.decided(cases)
    best = of.best(cases)
    return [*rows, _row("none", best, of.errors(cases, best), of.errors(cases, of.now), right, wrong)]


def _row(
    scene: str,
    value: float,
    errors: tuple[int, int],
    errors_now: tuple[int, int],
    right: Sequence[Case],
    wrong: Sequence[Case],
) -> dict[str, object]:
    return {
        "left out": scene,
        "threshold": float(value),
        "wrong accepted": f"{errors[0]} of {len(wrong)}",
        "right doubted": f"{errors[1]} of {len(right)}",
        "now: wrong accepted": errors_now[0],
        "now: right doubted": errors_now[1],
    }


def _scenes(cases: Sequence[Case]) -> list[str]:
    return list(dict.fromkeys(case.scene for case in cases))
