# Generated from _async/plans.py by `make generate`. Do not edit.
"""Plans: get, list and delete them, and have them as missions."""

from collections.abc import Iterator
from typing import Unpack

from fvs_client import requests
from fvs_client._sync.session import Resource, Session
from fvs_client.answers import mission_file
from fvs_client.models.missions import MissionFile, MissionSettings, mission_options
from fvs_client.models.plans import PlanData
from fvs_schema.missions import MissionFormat
from fvs_schema.plans import PlanSummary


class Plan(Resource, PlanData):
    """An immutable plan; ``tours`` are the flights of the vehicles."""

    def mission(
        self,
        format: MissionFormat | str,  # noqa: A002
        *,
        vehicle: int = 1,
        **settings: Unpack[MissionSettings],
    ) -> MissionFile:
        """Get the stops of one vehicle, in their order, as a mission for an autopilot or a ground station.

        Raises ``InvalidRequestError`` when the scene is not georeferenced, or a view cannot be flown.
        """
        options = mission_options(format, settings)
        request = requests.get_plan_mission(self.id, vehicle, options)
        return mission_file(self._session.response(request))

    def delete(self) -> None:
        """Delete the plan."""
        self._session.content(requests.delete_plan(self.id))


class Plans:
    """Plans by id."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def get(self, plan_id: str) -> Plan:
        """Get a plan."""
        return self._session.fetch(Plan, requests.get_plan(plan_id))


class ScenePlans:
    """The plans of a scene."""

    def __init__(self, session: Session, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    def list(self) -> Iterator[PlanSummary]:
        """All plans, newest first."""
        return self._session.items(PlanSummary, requests.plans_of(self._scene_id))
