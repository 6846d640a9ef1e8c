"""Rankings of candidates. They never wait for a job: the scene's runner scores them while it trains."""

from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import aclosing
from typing import TypeAlias

from anyio.to_thread import run_sync

from fvs_engine import candidates as engine
from fvs_engine.plan.plan_warnings import unknown_ground
from fvs_schema.base import Page
from fvs_schema.candidates import CandidateStatus, InVolume, wanted_of
from fvs_schema.events import EventKind
from fvs_schema.poses import Pose
from fvs_schema.rankings import (
    RankedCandidate,
    Ranking,
    RankingList,
    RankingPart,
    RankingRequest,
    ScoredCandidate,
)
from fvs_schema.snapshots import Snapshot
from fvs_service.concurrency import ConcurrencyLimit
from fvs_service.events.repository import publish
from fvs_service.ids import new_id
from fvs_service.principal import Principal, Scope
from fvs_service.rankings import repository
from fvs_service.rankings.in_model import require_volumes
from fvs_service.rankings.port import RankedViews, SceneRunners
from fvs_service.rankings.preparation import BegunRanking, PreparedRanking, TakenPoses
from fvs_service.rankings.snapshot_frames import SnapshotFrames
from fvs_service.rankings.under_ground import kept
from fvs_service.rankings.warnings import warnings_of
from fvs_service.scenes.lease import find_endpoint
from fvs_service.scenes.repository import scene_head_of
from fvs_service.storage.clock import now
from fvs_service.storage.database import Database, Reader
from fvs_service.storage.idempotency import IdempotencyKey

ReadRequest: TypeAlias = Callable[[], RankingRequest]
"""Reads a request; it is called in a thread, after the permission check."""


class Rankings:
    """Ranks candidates.

    Rankings are kept: ``require_room`` raises ``OutOfSpaceError`` when there is no room for another one.
    """

    def __init__(
        self,
        database: Database,
        frames: SnapshotFrames,
        runners: SceneRunners,
        limit: ConcurrencyLimit,
        taken_poses: TakenPoses,
        require_room: Callable[[], object] = lambda: None,
    ) -> None:
        self._taken_poses = taken_poses
        self._require_room = require_room
        self._database = database
        self._runners = runners
        self._limit = limit
        self._frames = frames

    async def create(
        self,
        principal: Principal,
        scene_id: str,
        read: ReadRequest,
        timeout_s: float,
        key: str | None = None,
    ) -> Ranking:
        """Rank the request's candidates with the newest state of the model, or with one of its snapshots.

        Cancelling it stops the computation. Raises ``DeadlineError`` when it takes longer than ``timeout_s``.
        """
        with self._limit.slot(principal.tenant_id):
            prepared = await self._prepared(principal, scene_id, read, timeout_s, key)
            if isinstance(prepared, Ranking):
                return prepared
            model_request = prepared.model_request
            result = (
                await self._runners.rank(model_request)
                if model_request.views
                else _unscored(prepared.snapshot)
            )
            return await run_sync(self._finish, principal, prepared, result)

    async def stream(
        self,
        principal: Principal,
        scene_id: str,
        read: ReadRequest,
        timeout_s: float,
        key: str | None = None,
    ) -> AsyncGenerator[RankingPart, None]:
        """Rank candidates as ``create`` does; yields those that are scored, and last the ranking."""
        with self._limit.slot(principal.tenant_id):
            prepared = await self._prepared(principal, scene_id, read, timeout_s, key)
            if isinstance(prepared, Ranking):
                yield RankingPart(ranking=prepared)
                return
            result = _unscored(prepared.snapshot)
            if prepared.model_request.views:
                async with aclosing(self._runners.stream(prepared.model_request)) as parts:
                    async for part in parts:
                        if isinstance(part, RankedViews):
                            result = part
                        else:
                            yield RankingPart(candidates=await run_sync(_scored, prepared, part))
            yield RankingPart(ranking=await run_sync(self._finish, principal, prepared, result))

    def get(self, principal: Principal, ranking_id: str) -> Ranking:
        """One ranking; raises ``NotFoundError``."""
        principal.require(Scope.READ, principal.scene_id)
        with self._database.reading() as session:
            return repository.ranking_of(session, principal, ranking_id)

    def of_scene(self, principal: Principal, scene_id: str, page: Page) -> RankingList:
        """The rankings of a scene, the newest first; refuses a cursor of another list."""
        principal.require(Scope.READ, scene_id)
        with self._database.reading() as session:
            scene_head_of(session, principal, scene_id)
            return repository.rankings_of_scene(session, scene_id, page)

    async def _prepared(
        self, principal: Principal, scene_id: str, read: ReadRequest, timeout_s: float, key: str | None
    ) -> PreparedRanking | Ranking:
        """The request to the runner, once the candidates are known; or the ranking that was made before."""
        found = await run_sync(self._prepare, principal, scene_id, read, timeout_s, key)
        if not isinstance(found, BegunRanking):
            return found
        poses, spent_s = await found.generated(self._runners)
        return await run_sync(found.prepared, poses, spent_s)

    def _prepare(
        self,
        principal: Principal,
        scene_id: str,
        read: ReadRequest,
        timeout_s: float,
        key: str | None,
    ) -> PreparedRanking | BegunRanking | Ranking:
        """The request to the runner, or the ranking that was made with the same idempotency key.

        Candidates of a volume are not known yet: only the runner can generate them.
        """
        principal.require(Scope.OPERATE, scene_id)
        with self._database.querying() as reader:
            scene = scene_head_of(reader, principal, scene_id)
            request = read()
            require_volumes(request.generator, request.no_fly)
            remembered = IdempotencyKey(principal.tenant_id, key, f"rankings.create {scene_id}", request)
            earlier = self._earlier(reader, principal, remembered)
            if earlier is not None:
                return earlier
            endpoint = find_endpoint(reader, scene_id)
            taken_poses = self._taken_poses(reader, scene_id, request.for_vehicle)
        self._require_room()
        begun = BegunRanking.of(
            self._frames,
            principal,
            request,
            scene,
            endpoint,
            taken_poses,
            request.terrain,
            timeout_s,
            remembered,
        )
        request, generator = begun.request, begun.request.generator
        if isinstance(generator, InVolume):
            return begun
        poses = self._frames.candidates(
            request.candidates,
            generator,
            begun.frame,
            begun.geometry,
            current=begun.current,
            radius_m=request.radius_m,
        )
        return begun.prepared(poses)

    def _finish(self, principal: Principal, prepared: PreparedRanking, result: RankedViews) -> Ranking:
        """Keep the ranking that the runner's result makes."""
        request, scene_id, snapshot = prepared.request, prepared.scene.id, prepared.snapshot
        first = (*result.candidates, *prepared.excluded.values())[: request.top_k]
        ranking = Ranking(
            id=new_id("rnk"),
            scene_id=scene_id,
            snapshot_id=result.snapshot_id,
            request=request.model_copy(update={"terrain": kept(request.terrain)}),
            alignment=snapshot.alignment,
            origin=prepared.scene.origin if prepared.frame.georeferenced else None,
            iterations=result.iterations,
            gaussians=result.gaussians,
            fallback=result.fallback,
            candidates=tuple(_ranked(one, prepared.poses[one.name]) for one in first),
            total=len(prepared.poses),
            seconds=result.seconds,
            waited_s=result.waited_s,
            warnings=warnings_of(
                snapshot.alignment,
                in_model=request.in_model,
                candidates=len(result.candidates),
                registrable=result.registrable,
                statuses=[
                    *(one.status for one in result.candidates),
                    *(CandidateStatus.UNDER_GROUND for _ in prepared.ground.under),
                ],
                wanted=wanted_of(request.generator),
                made=len(prepared.poses),
                more=unknown_ground(prepared.ground),
            ),
            created_at=now(),
        )
        # A ranking that a power cut undoes can be requested again; a sync would take as long as the rest.
        with self._database.writing(principal.tenant_id, scene_id, durable=False) as session:
            scene_head_of(session, principal, scene_id)  # it may have been deleted meanwhile
            earlier = self._earlier(session, principal, prepared.remembered)
            if earlier is not None:  # the same request, sent twice at once
                return earlier
            repository.add_ranking(session, ranking)
            prepared.remembered.remember(session, ranking.id)
            data = {"ranking_id": ranking.id, "snapshot_id": snapshot.id, "method": request.method}
            publish(session, scene_id, EventKind.RANKING_CREATED, data)
        return ranking

    def _earlier(self, reader: Reader, principal: Principal, key: IdempotencyKey) -> Ranking | None:
        """The ranking that an earlier request with the same idempotency key made."""
        return key.resource(reader, lambda made: repository.ranking_of(reader, principal, made))


def _scored(
    prepared: PreparedRanking, scores: Sequence[engine.CandidateScore]
) -> tuple[ScoredCandidate, ...]:
    """Scored candidates in the form that the client requested."""
    poses, distances = prepared.poses, prepared.distances
    return tuple(
        ScoredCandidate(
            id=one.name,
            score=one.score,
            status=one.status,
            coverage=one.coverage,
            estimated=one.estimated,
            distance_m=distances.get(one.name),
            pose=poses[one.name],
        )
        for one in scores
    )


def _ranked(candidate: engine.RankedCandidate, pose: Pose) -> RankedCandidate:
    """A ranked candidate with its pose in the frame of the answer."""
    return RankedCandidate(
        id=candidate.name,
        rank=candidate.rank,
        score=candidate.score,
        status=candidate.status,
        coverage=candidate.coverage,
        estimated=candidate.estimated,
        distance_m=candidate.distance,
        chance=candidate.chance,
        pose=pose,
    )


def _unscored(snapshot: Snapshot) -> RankedViews:
    """The result when no candidate is to be scored."""
    metrics = snapshot.metrics
    return RankedViews(snapshot_id=snapshot.id, iterations=metrics.iterations, gaussians=metrics.gaussians)
