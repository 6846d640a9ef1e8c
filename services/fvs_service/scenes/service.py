"""The operations on scenes."""

from collections.abc import Collection

from sqlalchemy.orm import Session

from fvs_engine.control.survey import Survey
from fvs_engine.errors import InvalidInputError
from fvs_schema.control_points import ControlPoints
from fvs_schema.events import EventKind
from fvs_schema.scenes import LocalWorld, Scene, SceneChange, SceneList, ScenePage, SceneRequest, SceneSize
from fvs_schema.service import Limits
from fvs_service.errors import InvalidRequestError, LimitExceededError, NotFoundError, PreconditionFailedError
from fvs_service.events.repository import publish
from fvs_service.ids import new_id
from fvs_service.principal import Principal, Scope
from fvs_service.scenes import repository
from fvs_service.storage.clock import now
from fvs_service.storage.database import Database
from fvs_service.storage.idempotency import IdempotencyKey


class Scenes:
    """Creates, changes and returns scenes."""

    def __init__(self, database: Database, limits: Limits) -> None:
        self._database = database
        self._limits = limits

    def create(self, principal: Principal, request: SceneRequest, key: str | None = None) -> Scene:
        """Create a scene; a repeated idempotency key returns the scene that it created."""
        principal.require(Scope.OPERATE)
        remembered = IdempotencyKey(principal.tenant_id, key, "scenes.create", request)
        with self._database.writing(principal.tenant_id) as session:
            earlier = remembered.resource(session, lambda made: repository.scene_of(session, principal, made))
            if earlier is not None:
                return earlier
            if repository.count_scenes(session, principal.tenant_id) >= self._limits.scenes_per_tenant:
                raise LimitExceededError(
                    f"There are {self._limits.scenes_per_tenant} scenes; no more are allowed.",
                    hint="Delete one that is no longer needed.",
                    retry_after_s=3600,
                )
            scene_id = new_id("scn")
            repository.add_scene(session, scene_id, principal.tenant_id, request, now())
            publish(session, scene_id, EventKind.SCENE_CREATED, {"name": request.name})
            remembered.remember(session, scene_id)
            return repository.scene_of(session, principal, scene_id)

    def require(self, principal: Principal, scope: Scope, scene_id: str) -> None:
        """Raise ``ForbiddenError`` without the scope, ``NotFoundError`` when there is no such scene."""
        principal.require(scope, scene_id)
        with self._database.reading() as session:
            repository.scene_head_of(session, principal, scene_id)

    def get(self, principal: Principal, scene_id: str) -> Scene:
        """One scene; raises ``NotFoundError``."""
        principal.require(Scope.READ, scene_id)
        with self._database.reading() as session:
            return repository.scene_of(session, principal, scene_id)

    def change(
        self,
        principal: Principal,
        scene_id: str,
        change: SceneChange,
        expected: Collection[str] | None = None,
    ) -> Scene:
        """Change a scene's name, policy or retention; raises ``NotFoundError``.

        Raises ``PreconditionFailedError`` unless the scene's tag is one of those ``expected``.
        """
        principal.require(Scope.OPERATE, scene_id)
        with self._database.writing(scene_id) as session:
            require_tag(session, principal, scene_id, expected)
            repository.change_scene(session, principal, scene_id, change)
            data = change.model_dump(mode="json", exclude_none=True)
            publish(session, scene_id, EventKind.SCENE_CHANGED, data)
            return repository.scene_of(session, principal, scene_id)

    def set_control_points(self, principal: Principal, scene_id: str, points: ControlPoints) -> ControlPoints:
        """Set the points by which the next model is aligned; they give an automatic world its origin.

        Raises ``NotFoundError``, and ``InvalidRequestError`` for a CRS or coordinates that cannot be used,
        for heights above another datum than the origin's, and in a scene with a frame of its own.
        """
        principal.require(Scope.OPERATE, scene_id)
        try:
            survey = Survey.of(points)
        except InvalidInputError as error:
            raise InvalidRequestError(error.message, hint=error.hint) from error
        with self._database.writing(scene_id) as session:
            scene = repository.scene_of(session, principal, scene_id)
            if isinstance(scene.world, LocalWorld):
                raise InvalidRequestError(
                    "The scene's world is a local frame, and control points are on Earth.",
                    hint="Create the scene with an automatic world, or with one that has an origin.",
                )
            if scene.origin is None:
                repository.set_origin(session, scene_id, survey.origin)
            elif scene.origin.altitude_datum is not survey.datum:
                raise InvalidRequestError(
                    f"The heights are above {survey.datum.in_words}, and the scene's origin is above "
                    f"{scene.origin.altitude_datum.in_words}.",
                    hint="Convert the heights, and say so with altitude_datum.",
                )
            repository.set_control_points(session, scene_id, points)
            publish(session, scene_id, EventKind.SCENE_CHANGED, {"control_points": len(points.points)})
        return points

    def control_points(self, principal: Principal, scene_id: str) -> ControlPoints:
        """The control points of a scene; raises ``NotFoundError`` when it has none."""
        principal.require(Scope.READ, scene_id)
        with self._database.reading() as session:
            repository.scene_head_of(session, principal, scene_id)
            points = repository.control_points_of(session, scene_id)
        if points is None:
            raise NotFoundError("The scene has no control points.")
        return points

    def delete_control_points(self, principal: Principal, scene_id: str) -> None:
        """Delete the control points of a scene, if it has any."""
        principal.require(Scope.OPERATE, scene_id)
        with self._database.writing(scene_id) as session:
            repository.scene_head_of(session, principal, scene_id)
            repository.set_control_points(session, scene_id, None)
            publish(session, scene_id, EventKind.SCENE_CHANGED, {"control_points": 0})

    def size(self, principal: Principal, scene_id: str) -> SceneSize:
        """The disk space of a scene; raises ``NotFoundError``."""
        principal.require(Scope.READ, scene_id)
        with self._database.reading() as session:
            repository.scene_head_of(session, principal, scene_id)
            return repository.size_of(session, scene_id)

    def all(self, principal: Principal, page: ScenePage) -> SceneList:
        """The scenes that the principal can see, the newest first; refuses a cursor of another list."""
        principal.require(Scope.READ, principal.scene_id)
        with self._database.reading() as session:
            return repository.scenes_of(session, principal, page)


def require_tag(
    session: Session, principal: Principal, scene_id: str, expected: Collection[str] | None
) -> None:
    """Raise ``PreconditionFailedError`` unless a scene's tag is one of those ``expected``; None is any.

    The transaction must lock the scene.
    """
    if expected is not None and repository.scene_of(session, principal, scene_id).etag not in expected:
        raise PreconditionFailedError("The scene has changed since its ETag was returned.")
