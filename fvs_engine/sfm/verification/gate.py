"""The gate: choice of the model by evidence that a wrong one lacks, not by its number of images.

A mapper reports how many images it registered and the error of the matches that it kept; both look healthy
when the model is wrong. ``checks`` has what is looked at instead.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.alignment.similarity import umeyama
from fvs_engine.sfm.report import Agreement, Evidence, Verdict
from fvs_engine.sfm.settings import GateSettings
from fvs_engine.sfm.verification.checks import Case, Weight, findings
from fvs_schema.findings import Finding, FindingCode, Severity


@dataclass(frozen=True, eq=False)
class JudgedModel:
    """Input of the gate for one model: camera centres by image name, and evidence."""

    mapper: str
    centres: Mapping[str, NDArray[np.float64]]
    evidence: Evidence | None

    def case(self, settings: GateSettings) -> Case:
        """The case that the checks judge; the model must have evidence."""
        assert self.evidence is not None
        return Case(self.evidence, len(self.centres), settings)


@dataclass(frozen=True)
class Judgement:
    """The verdict on one model, and the reasons."""

    verdict: Verdict
    reasons: tuple[Finding, ...]


@dataclass(frozen=True)
class Decision:
    """``chosen`` indexes the models, None when all are rejected."""

    chosen: int | None
    judgements: tuple[Judgement, ...]
    agreements: tuple[Agreement, ...]
    warnings: tuple[Finding, ...]


def decide(models: Sequence[JudgedModel], settings: GateSettings) -> Decision:
    """Judge every model and choose the best supported one that is not rejected.

    A model is accepted on its own evidence. One with slightly too little evidence is doubtful (usable with a
    warning) if another mapper or GPS agrees with it: a repeated pattern rarely causes the same errors in
    both. One with loosely linked images, with distances that no features seen in three images determine, or
    with conflicting views, is doubtful unless GPS confirms it. Among accepted ones that disagree, the better
    supported is chosen; a tie makes it doubtful.
    """
    agreements = tuple(
        agreement
        for i, first in enumerate(models)
        for second in models[i + 1 :]
        if (agreement := agree(first, second, settings)) is not None
    )
    judgements = [_judge(model, agreements, settings) for model in models]
    usable = [i for i, judgement in enumerate(judgements) if judgement.verdict != "rejected"]
    if not usable:
        return Decision(None, tuple(judgements), agreements, ())
    best = max(usable, key=lambda i: _rank(models[i], judgements[i], settings))
    warnings = []
    if models[best].case(settings).priors_are_wrong:
        warnings.append(Finding.of(FindingCode.POSITIONS_IGNORED))
    as_good = [models[i] for i in usable if judgements[i].verdict == judgements[best].verdict]
    rival = next((model for model in as_good if _rivals(model, models[best], agreements, settings)), None)
    if rival is not None:
        doubts = () if judgements[best].verdict == "accepted" else judgements[best].reasons
        reason = Finding.of(FindingCode.RIVAL_MODEL, severity=Severity.DOUBT, mapper=rival.mapper)
        judgements[best] = Judgement("doubtful", (*doubts, reason))
    if judgements[best].verdict == "doubtful":
        warnings += judgements[best].reasons
    return Decision(best, tuple(judgements), agreements, tuple(warnings))


def agree(first: JudgedModel, second: JudgedModel, settings: GateSettings) -> Agreement | None:
    """How far two models' camera centres are apart after Umeyama; None when too few are shared."""
    shared = sorted(first.centres.keys() & second.centres.keys())
    if len(shared) < settings.min_shared_images:
        return None
    source = np.stack([first.centres[name] for name in shared])
    target = np.stack([second.centres[name] for name in shared])
    try:
        second_from_first = umeyama(source, target)
    except InvalidInputError:  # all centres coincide
        return None
    shares = np.linalg.norm(second_from_first.apply(source) - target, axis=1) / centre_spread(target)
    return Agreement(
        mappers=(first.mapper, second.mapper),
        shared_images=len(shared),
        median_share=float(np.median(shares)),
        max_share=float(shares.max()),
    )


def _judge(model: JudgedModel, agreements: Sequence[Agreement], settings: GateSettings) -> Judgement:
    """The verdict of all checks on a model."""
    if model.evidence is None:
        return _rejected(Finding.of(FindingCode.NO_PAIRS))
    case = model.case(settings)
    found = findings(case)
    rejections, weaknesses = found[Weight.REJECTS], found[Weight.NEEDS_CONFIRMATION]
    if rejections:
        return _rejected(*rejections)
    doubts = found[Weight.DOUBTS]
    if weaknesses:
        source = _confirmation(model.mapper, case, agreements)
        if source is None:
            return _rejected(*weaknesses, Finding.of(FindingCode.UNCONFIRMED))
        return _doubtful(*weaknesses, Finding.of(FindingCode.HARDLY_CONFIRMED, source=source), *doubts)
    if doubts := doubts or found[Weight.DOUBTS_ALONE][:1]:
        return _doubtful(*doubts)
    support = case.evidence.match_support
    return Judgement(
        "accepted", (Finding.of(FindingCode.MATCH_SUPPORT, severity=Severity.NOTE, support=support),)
    )


def _rejected(*reasons: Finding) -> Judgement:
    return Judgement("rejected", tuple(reason.with_severity(Severity.REJECTION) for reason in reasons))


def _doubtful(*reasons: Finding) -> Judgement:
    return Judgement("doubtful", tuple(reason.with_severity(Severity.DOUBT) for reason in reasons))


def _confirmation(mapper: str, case: Case, agreements: Sequence[Agreement]) -> str | None:
    """The independent source that confirms the poses; None if none does."""
    if any(
        mapper in agreement.mappers and agreement.median_share <= case.settings.max_disagreement
        for agreement in agreements
    ):
        return "another mapper"
    return "GPS" if case.priors_confirm else None


def _rank(model: JudgedModel, judgement: Judgement, settings: GateSettings) -> float:
    """The number of explained matches, with a discount for doubt: more images raise it only if right."""
    evidence = model.evidence
    assert evidence is not None
    explained = evidence.match_support * evidence.matches
    return explained if judgement.verdict == "accepted" else settings.doubt_discount * explained


def _rivals(
    other: JudgedModel, best: JudgedModel, agreements: Sequence[Agreement], settings: GateSettings
) -> bool:
    """Whether a model contradicts the ``best`` one and the matches support it as well."""
    contradicts = any(
        set(agreement.mappers) == {best.mapper, other.mapper}
        and agreement.median_share > settings.max_disagreement
        for agreement in agreements
    )
    ours, theirs = best.evidence, other.evidence
    assert ours is not None
    assert theirs is not None
    return contradicts and theirs.match_support >= ours.match_support - settings.close_support
