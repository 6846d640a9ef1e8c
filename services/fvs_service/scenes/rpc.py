"""Scenes and their events over gRPC."""

from collections.abc import AsyncIterator
from typing import Annotated

from anyio.to_thread import run_sync
from fvs.v1 import scenes_pb2 as pb
from pydantic import Field

from fvs_schema.base import Model
from fvs_schema.control_points import ControlPoints
from fvs_schema.events import Event, EventKind
from fvs_schema.scenes import Scene, SceneChange, SceneList, ScenePage, SceneRequest, SceneSize
from fvs_service.application import Application
from fvs_service.errors import stopping
from fvs_service.gateway.rpc.calls import Call
from fvs_service.gateway.rpc.conversion import pick, read
from fvs_service.gateway.rpc.requests import idempotency_key
from fvs_service.principal import Principal, Scope


class _Start(Model):
    after: Annotated[int, Field(ge=0, le=2**53)] = 0


def _expected(request: pb.ChangeSceneRequest | pb.DeleteSceneRequest) -> tuple[str, ...] | None:
    """The tag that the scene must have; None for any."""
    return (request.etag,) if request.HasField("etag") else None


class SceneServicer:
    """``fvs.v1.SceneService``."""

    service = pb.DESCRIPTOR.services_by_name["SceneService"]

    def __init__(self, app: Application) -> None:
        self._app = app

    def create_scene(self, caller: Principal, request: pb.CreateSceneRequest) -> Scene:
        """Create a scene."""
        caller.require(Scope.OPERATE)
        return self._app.scenes.create(caller, read(SceneRequest, request.scene), idempotency_key(request))

    def list_scenes(self, caller: Principal, request: pb.ListScenesRequest) -> SceneList:
        """List the scenes."""
        return self._app.scenes.all(caller, pick(ScenePage, request))

    def get_scene(self, caller: Principal, request: pb.GetSceneRequest) -> Scene:
        """Return a scene."""
        return self._app.scenes.get(caller, request.scene_id)

    def change_scene(self, caller: Principal, request: pb.ChangeSceneRequest) -> Scene:
        """Change a scene."""
        self._app.scenes.require(caller, Scope.OPERATE, request.scene_id)
        change = read(SceneChange, request.change)
        return self._app.scenes.change(caller, request.scene_id, change, _expected(request))

    def delete_scene(self, caller: Principal, request: pb.DeleteSceneRequest) -> None:
        """Delete a scene."""
        self._app.deletions.scene(caller, request.scene_id, _expected(request))

    def set_control_points(self, caller: Principal, request: pb.SetControlPointsRequest) -> ControlPoints:
        """Set the control points of a scene."""
        self._app.scenes.require(caller, Scope.OPERATE, request.scene_id)
        points = read(ControlPoints, request.points, self._app.storage.settings.limits)
        return self._app.scenes.set_control_points(caller, request.scene_id, points)

    def get_control_points(self, caller: Principal, request: pb.GetControlPointsRequest) -> ControlPoints:
        """Return the control points of a scene."""
        return self._app.scenes.control_points(caller, request.scene_id)

    def delete_control_points(self, caller: Principal, request: pb.DeleteControlPointsRequest) -> None:
        """Delete the control points of a scene."""
        self._app.scenes.delete_control_points(caller, request.scene_id)

    def get_scene_size(self, caller: Principal, request: pb.GetSceneSizeRequest) -> SceneSize:
        """Return the disk space of a scene."""
        return self._app.scenes.size(caller, request.scene_id)

    async def watch_events(
        self, call: Call, caller: Principal, request: pb.WatchEventsRequest
    ) -> AsyncIterator[Event]:
        """Stream the events of a scene."""
        feed, metrics, scene_id = call.gateway.feed, call.gateway.metrics, request.scene_id
        await run_sync(feed.check, caller, scene_id)
        after = pick(_Start, request).after
        if request.tail and not request.HasField("after"):
            after = await feed.newest()
        with feed.stream_limit.slot(caller.tenant_id), metrics.streams.track_inprogress():
            await call.begin(event_number=str(after))
            async for event in feed.follow(caller, scene_id, after):
                if event is None:
                    continue
                yield event
                if event.kind is EventKind.SCENE_DELETED:
                    return
        raise stopping()
