"""Views that are sent to the service, by name or as what a ranking or a plan has made of them."""

from collections.abc import Iterable, Mapping

from fvs_schema.candidates import Candidate
from fvs_schema.missions import MissionRequest, MissionView
from fvs_schema.plans import Stop, Tour
from fvs_schema.poses import Pose
from fvs_schema.rankings import RankedCandidate
from fvs_schema.terrain import AnyTerrain


def candidates_of(
    given: Mapping[str, Pose] | Iterable[Candidate] | None,
) -> tuple[Candidate, ...] | None:
    """Poses by candidate id, or candidates; None where none are given."""
    if isinstance(given, Mapping):
        return _listed(given)
    return None if given is None else tuple(given)


def mission_of(
    views: Tour | Mapping[str, Pose] | Iterable[Candidate | RankedCandidate | Stop],
    snapshot_id: str | None,
    terrain: AnyTerrain | None,
) -> MissionRequest:
    """The mission of views; that of a tour passes what it goes ``via``, also on the way home."""
    listed: Iterable[Candidate | RankedCandidate | Stop]
    if isinstance(views, Tour):
        listed, via_home = views.stops, views.via_home
    else:
        listed, via_home = _listed(views) if isinstance(views, Mapping) else views, ()
    given = (
        MissionView(id=item.id, pose=item.pose, via=item.via if isinstance(item, Stop) else ())
        for item in listed
    )
    return MissionRequest(views=tuple(given), via_home=via_home, snapshot_id=snapshot_id, terrain=terrain)


def _listed(poses: Mapping[str, Pose]) -> tuple[Candidate, ...]:
    return tuple(Candidate(id=name, pose=pose) for name, pose in poses.items())
