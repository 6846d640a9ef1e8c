"""Plans: get, list and delete them, and have them as missions."""

from collections.abc import AsyncIterator
from typing import Unpack

from fvs_client import requests
from fvs_client._async.session import AsyncResource, AsyncSession
from fvs_client.answers import mission_file
from fvs_client.models.missions import MissionFile, MissionSettings, mission_options
from fvs_client.models.plans import PlanData
from fvs_schema.missions import MissionFormat
from fvs_schema.plans import PlanSummary


class AsyncPlan(AsyncResource, PlanData):
    """An immutable plan; ``tours`` are the flights of the vehicles."""

    async def mission(
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
        return mission_file(await self._session.response(request))

    async def delete(self) -> None:
        """Delete the plan."""
        await self._session.content(requests.delete_plan(self.id))


class AsyncPlans:
    """Plans by id."""

    def __init__(self, session: AsyncSession) -> None:
        self._session = session

    async def get(self, plan_id: str) -> AsyncPlan:
        """Get a plan."""
        return await self._session.fetch(AsyncPlan, requests.get_plan(plan_id))


class AsyncScenePlans:
    """The plans of a scene."""

    def __init__(self, session: AsyncSession, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    def list(self) -> AsyncIterator[PlanSummary]:
        """All plans, newest first."""
        return self._session.items(PlanSummary, requests.plans_of(self._scene_id))
