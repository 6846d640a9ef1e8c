"""Warnings of structure from motion that stop being true.

Those about a model's cameras end when it is replaced, those about an image without a pose when the image is
registered.
"""

from collections.abc import Collection, Iterable

from fvs_schema.findings import Finding, FindingCode, Severity

_WITHOUT_POSE = {
    FindingCode.POSE_UNSUPPORTED,
    FindingCode.POSE_AT_WRONG_DISTANCE,
    FindingCode.POSE_FAR_FROM_PRIOR,
    FindingCode.POSE_UNCERTAIN,
    FindingCode.POSE_UNDETERMINED,
    FindingCode.LOOK_ALIKE_PLACE,
    FindingCode.UNMATCHED,
    FindingCode.FEW_POINTS,
    FindingCode.UNREGISTERED,
    FindingCode.SEPARATE_MODEL,
    FindingCode.POSES_LOST,
    FindingCode.LEFT_OUT,
}


def without_doubts(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """The ``findings`` that are still true when the model has been replaced."""
    return tuple(finding for finding in findings if finding.severity is not Severity.DOUBT)


def without_registered(findings: Iterable[Finding], registered: Collection[str]) -> tuple[Finding, ...]:
    """The ``findings`` that are still true when these images are ``registered``, each only once."""
    true: list[Finding] = []
    for finding in findings:
        if finding.code in _WITHOUT_POSE:
            left = tuple(name for name in finding.images if name not in registered)
            finding = finding.model_copy(update={"images": left})
        if finding not in true and (finding.images or finding.code not in _WITHOUT_POSE):
            true.append(finding)
    return tuple(true)
