"""One gateway, and three ways to call it: the services themselves, REST and gRPC.

Every operation is called by the name of its method in ``fvs.v1`` with the same document, and answers with an
``Outcome`` that does not show how it was called.
"""

import hashlib
import importlib.util
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import grpc
import orjson
import pytest
from fvs.v1 import capabilities_pb2, images_pb2, jobs_pb2, scenes_pb2, snapshots_pb2, views_pb2
from fvs_service.application import Application
from fvs_service.errors import ServiceError
from fvs_service.gateway.capabilities import capabilities_of
from fvs_service.gateway.rest.bodies import parse as parse_body
from fvs_service.gateway.rpc.calls import Gateway as RpcGateway
from fvs_service.gateway.rpc.conversion import _arguments
from fvs_service.gateway.rpc.server import RpcServer
from fvs_service.images.model import DigestCheck, ImageMetadata
from fvs_service.images.staging import require_digest
from fvs_service.jobs.model import JobRequest
from fvs_service.model import NumberedPage, Page
from fvs_service.principal import Principal
from fvs_service.rankings.model import RankingRequest
from fvs_service.rankings.port import ViewImage
from fvs_service.scenes.model import SceneChange, SceneRequest
from fvs_service.settings import Limits, Settings
from fvs_service.snapshots.model import SnapshotChange
from google.protobuf.message_factory import GetMessageClass
from google.rpc import error_details_pb2, status_pb2

_SERVICE_TESTS = Path(__file__).resolve().parent.parent / "fvs_service" / "conftest.py"
_FILES = (capabilities_pb2, images_pb2, jobs_pb2, scenes_pb2, snapshots_pb2, views_pb2)
_ID = re.compile(r"\b(scn|job|snp|rnk|key|req)_[0-9a-z]{26}\b")
_TIME = re.compile(r"^\d{4}-\d\d-\d\dT")
_LISTS_OR_NULL = frozenset({"centre"})
"""Lists that cannot be empty, and are null in REST when they are absent."""
_MEASURED = frozenset({"seconds", "waited_s", "heartbeat_age_s"})


def _load_service_fixtures() -> Any:
    spec = importlib.util.spec_from_file_location("fixtures_of_the_contract", _SERVICE_TESTS)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


_service = _load_service_fixtures()
photograph = _service.photograph
_plain_logs = _service._plain_logs


@dataclass(frozen=True)
class Outcome:
    """What a call returned: a document, or the error's code and what else is stable of it."""

    result: Any = None
    code: str = ""
    retryable: bool | None = None
    message: str = ""
    hint: str = field(default="", compare=False)
    """It names the transport's own means."""
    fields: tuple[str, ...] = ()
    retry_after: bool = False


@dataclass(frozen=True)
class Operation:
    """How one method of ``fvs.v1`` is called over REST, and which service it is."""

    verb: str
    path: str
    direct: Callable[[Application, Principal, "Call"], Any]
    body: tuple[str, Any] | None = None
    """The field of the request that is REST's body, and its model."""


@dataclass(frozen=True)
class Call:
    """The parameters of a call; ``body`` is the validated model for the services themselves."""

    given: Mapping[str, Any]
    body: Any = None

    def __getattr__(self, name: str) -> Any:
        return self.given.get(name)

    def page(self, kind: type[Page] = Page) -> Any:
        asked = {name: self.given[name] for name in ("after", "limit") if name in self.given}
        return parse_body(kind, orjson.dumps(asked), Limits())


def _render(app: Application, caller: Principal, call: Call) -> Any:
    return app.rankings.render(caller, call.ranking_id, call.candidate_id, ViewImage.RENDER, 60.0)


OPERATIONS: dict[str, Operation] = {
    "CreateScene": Operation(
        "POST",
        "/v1/scenes",
        lambda app, who, call: app.scenes.create(who, call.body, call.idempotency_key),
        ("scene", SceneRequest),
    ),
    "ListScenes": Operation("GET", "/v1/scenes", lambda app, who, call: app.scenes.all(who, call.page())),
    "GetScene": Operation(
        "GET", "/v1/scenes/{scene_id}", lambda app, who, call: app.scenes.get(who, call.scene_id)
    ),
    "ChangeScene": Operation(
        "PATCH",
        "/v1/scenes/{scene_id}",
        lambda app, who, call: app.scenes.change(who, call.scene_id, call.body),
        ("change", SceneChange),
    ),
    "DeleteScene": Operation(
        "DELETE", "/v1/scenes/{scene_id}", lambda app, who, call: app.deletions.scene(who, call.scene_id)
    ),
    "GetSceneSize": Operation(
        "GET", "/v1/scenes/{scene_id}/size", lambda app, who, call: app.scenes.size(who, call.scene_id)
    ),
    "CheckImages": Operation(
        "POST",
        "/v1/scenes/{scene_id}/images:check",
        lambda app, who, call: app.images.check(who, call.scene_id, call.body),
        ("check", DigestCheck),
    ),
    "ListImages": Operation(
        "GET",
        "/v1/scenes/{scene_id}/images",
        lambda app, who, call: app.images.of_scene(who, call.scene_id, call.page(NumberedPage)),
    ),
    "GetImage": Operation(
        "GET",
        "/v1/scenes/{scene_id}/images/{digest}",
        lambda app, who, call: app.images.get(who, call.scene_id, call.digest),
    ),
    "DeleteImage": Operation(
        "DELETE",
        "/v1/scenes/{scene_id}/images/{digest}",
        lambda app, who, call: app.exclusions.delete(who, call.scene_id, call.digest),
    ),
    "ExcludeImage": Operation(
        "POST",
        "/v1/scenes/{scene_id}/images/{digest}:exclude",
        lambda app, who, call: app.exclusions.exclude(who, call.scene_id, call.digest),
    ),
    "IncludeImage": Operation(
        "POST",
        "/v1/scenes/{scene_id}/images/{digest}:include",
        lambda app, who, call: app.exclusions.include(who, call.scene_id, call.digest),
    ),
    "CreateJob": Operation(
        "POST",
        "/v1/scenes/{scene_id}/jobs",
        lambda app, who, call: app.jobs.create(who, call.scene_id, call.body, call.idempotency_key),
        ("job", JobRequest),
    ),
    "ListJobs": Operation(
        "GET",
        "/v1/scenes/{scene_id}/jobs",
        lambda app, who, call: app.jobs.of_scene(who, call.scene_id, call.page()),
    ),
    "GetJob": Operation("GET", "/v1/jobs/{job_id}", lambda app, who, call: app.jobs.get(who, call.job_id)),
    "CancelJob": Operation(
        "POST", "/v1/jobs/{job_id}:cancel", lambda app, who, call: app.jobs.cancel(who, call.job_id)
    ),
    "RetryJob": Operation(
        "POST", "/v1/jobs/{job_id}:retry", lambda app, who, call: app.jobs.retry(who, call.job_id)
    ),
    "ListSnapshots": Operation(
        "GET",
        "/v1/scenes/{scene_id}/snapshots",
        lambda app, who, call: app.storage.snapshots.of_scene(who, call.scene_id, call.page()),
    ),
    "GetSnapshot": Operation(
        "GET",
        "/v1/snapshots/{snapshot_id}",
        lambda app, who, call: app.storage.snapshots.get(who, call.snapshot_id),
    ),
    "ChangeSnapshot": Operation(
        "PATCH",
        "/v1/snapshots/{snapshot_id}",
        lambda app, who, call: app.storage.snapshots.change(who, call.snapshot_id, call.body),
        ("change", SnapshotChange),
    ),
    "DeleteSnapshot": Operation(
        "DELETE",
        "/v1/snapshots/{snapshot_id}",
        lambda app, who, call: app.deletions.snapshot(who, call.snapshot_id),
    ),
    "RankViews": Operation(
        "POST",
        "/v1/scenes/{scene_id}/rankings",
        lambda app, who, call: app.rankings.create(who, call.scene_id, call.body, 60.0, call.idempotency_key),
        ("ranking", RankingRequest),
    ),
    "GetRanking": Operation(
        "GET", "/v1/rankings/{ranking_id}", lambda app, who, call: app.rankings.get(who, call.ranking_id)
    ),
    "DeleteRanking": Operation(
        "DELETE",
        "/v1/rankings/{ranking_id}",
        lambda app, who, call: app.deletions.ranking(who, call.ranking_id),
    ),
    "RenderCandidate": Operation(
        "GET", "/v1/rankings/{ranking_id}/candidates/{candidate_id}/render.png", _render
    ),
    "GetCapabilities": Operation("GET", "/v1/capabilities", lambda app, _who, _call: capabilities_of(app)),
}
"""Every operation that is one request and one response on both transports."""


@cache
def method(name: str) -> Any:
    """The descriptor of a method of ``fvs.v1``."""
    return next(
        service.methods_by_name[name]
        for file in _FILES
        for service in file.DESCRIPTOR.services_by_name.values()
        if name in service.methods_by_name
    )


def document_of(message: Any) -> Any:
    """A message as REST's document, read independently of the service's conversion."""
    names = [described.name for described in message.DESCRIPTOR.fields]
    oneofs = message.DESCRIPTOR.oneofs_by_name
    if message.DESCRIPTOR.full_name == "google.protobuf.Timestamp":
        return message.ToJsonString()
    if names == ["items"]:
        return [document_of(item) for item in message.items]
    for union in ("kind", "pose"):
        if union in oneofs:
            member = message.WhichOneof(union)
            kind = {"kind": member.replace("_", "-")} if union == "kind" else {}
            return {**kind, **document_of(getattr(message, member))}
    return {described.name: _field(message, described) for described in message.DESCRIPTOR.fields}


def _field(message: Any, described: Any) -> Any:
    value = getattr(message, described.name)
    if described.is_repeated:
        found = [_one(described, item) for item in value]
        return found or (None if described.name in _LISTS_OR_NULL else [])
    if described.has_presence and not message.HasField(described.name):
        return None
    return _one(described, value)


def _one(described: Any, value: Any) -> Any:
    if described.enum_type is not None:
        return rest_word(described.enum_type, value) if value else None
    return document_of(value) if described.message_type is not None else value


def rest_word(enum: Any, number: int) -> str:
    """REST's word for a value of an enum: what follows the words that all of its values begin with."""
    words = [value.name for value in enum.values]
    common = next(name for name in words if name.endswith("_UNSPECIFIED")).removesuffix("UNSPECIFIED")
    separator = "." if enum.name == "EventKind" else "-"
    return enum.values_by_number[number].name.removeprefix(common).lower().replace("_", separator)


class Direct:
    """Calls the services in this process."""

    name = "direct"

    def __init__(self, gateway: Any) -> None:
        self._gateway = gateway

    def call(self, name: str, key: str | None, given: Mapping[str, Any], body: Any) -> Outcome:
        app, operation = self._gateway.application, OPERATIONS[name]
        limits = app.storage.settings.limits

        def run() -> Any:
            who = app.storage.keys.authenticate(key)
            model = None
            if operation.body is not None:
                model = parse_body(operation.body[1], orjson.dumps(body or {}), limits)
            return operation.direct(app, who, Call(given, model))

        return self._outcome(run)

    def upload(
        self, key: str | None, scene_id: str, digest: str, content: bytes, metadata: Mapping[str, Any]
    ) -> Outcome:
        app = self._gateway.application

        def run() -> Any:
            who = app.storage.keys.authenticate(key)
            known = app.images.known(who, scene_id, digest, ImageMetadata(**metadata))
            if known is not None:
                return known
            with app.staging.receive(len(content)) as receiver:
                receiver.write(content)
                staged = receiver.finish()
                require_digest(staged.digest, digest)
                return app.images.store(who, scene_id, staged, ImageMetadata(**metadata))[0]

        return self._outcome(run)

    def _outcome(self, run: Callable[[], Any]) -> Outcome:
        async def awaited() -> Any:
            result = await self._in_thread(run)
            return await result if hasattr(result, "__await__") else result

        try:
            result = self._gateway.client.portal.call(awaited)
        except ServiceError as error:
            return Outcome(
                code=error.code,
                retryable=error.retryable,
                message=error.message,
                hint=error.hint,
                fields=tuple(item.field for item in error.errors),
                retry_after=error.retry_after_s is not None,
            )
        return Outcome(result=result.model_dump(mode="json") if hasattr(result, "model_dump") else result)

    @staticmethod
    async def _in_thread(run: Callable[[], Any]) -> Any:
        from anyio.to_thread import run_sync

        return await run_sync(run)


class Rest:
    """Calls over HTTP."""

    name = "rest"

    def __init__(self, gateway: Any) -> None:
        self._gateway = gateway

    def call(self, name: str, key: str | None, given: Mapping[str, Any], body: Any) -> Outcome:
        operation = OPERATIONS[name]
        path = operation.path.format(**given)
        query = {one: given[one] for one in ("after", "limit") if one in given}
        headers = _bearer(key)
        if "idempotency_key" in given:
            headers["Idempotency-Key"] = given["idempotency_key"]
        options = {} if operation.body is None else {"json": body or {}}
        return _outcome_of_response(
            self._gateway.client.request(operation.verb, path, params=query, headers=headers, **options)
        )

    def upload(
        self, key: str | None, scene_id: str, digest: str, content: bytes, metadata: Mapping[str, Any]
    ) -> Outcome:
        path = f"/v1/scenes/{scene_id}/images/{digest}"
        return _outcome_of_response(
            self._gateway.client.put(path, content=content, params=metadata, headers=_bearer(key))
        )


def _bearer(key: str | None) -> dict[str, str]:
    return {} if key is None else {"Authorization": f"Bearer {key}"}


def _outcome_of_response(response: Any) -> Outcome:
    if response.status_code < 400:
        if response.content and response.headers.get("content-type") == "application/json":
            return Outcome(result=response.json())
        return Outcome(result=response.content or None)
    problem = response.json()
    return Outcome(
        code=problem["code"],
        retryable=problem["retryable"],
        message=problem["detail"],
        hint=problem["hint"],
        fields=tuple(item["field"] for item in problem["errors"]),
        retry_after="retry-after" in response.headers,
    )


class Rpc:
    """Calls over gRPC."""

    name = "rpc"

    def __init__(self, channel: grpc.Channel) -> None:
        self.channel = channel

    def call(self, name: str, key: str | None, given: Mapping[str, Any], body: Any) -> Outcome:
        described, operation = method(name), OPERATIONS[name]
        request = GetMessageClass(described.input_type)(**given)
        if operation.body is not None:
            part = getattr(request, operation.body[0])
            part.CopyFrom(type(part)(**_arguments(part.DESCRIPTOR, body or {})))
        return self._outcome(
            lambda: self.unary(name)(request, timeout=60, metadata=_metadata(key)),
        )

    def upload(
        self, key: str | None, scene_id: str, digest: str, content: bytes, metadata: Mapping[str, Any]
    ) -> Outcome:
        first = {"scene_id": scene_id, "digest": digest, "size_bytes": len(content), "metadata": metadata}

        def parts() -> Iterator[Any]:
            yield images_pb2.UploadImageRequest(upload=first)
            for start in range(0, len(content), 1000):
                yield images_pb2.UploadImageRequest(chunk=content[start : start + 1000])

        sent = self.upload_call()
        outcome = self._outcome(lambda: sent(parts(), timeout=60, metadata=_metadata(key)))
        return outcome if outcome.code else Outcome(result=outcome.result["image"])

    def upload_call(self) -> Any:
        return self.channel.stream_unary(
            "/fvs.v1.ImageService/UploadImage",
            images_pb2.UploadImageRequest.SerializeToString,
            images_pb2.UploadImageResponse.FromString,
        )

    def unary(self, name: str) -> Any:
        return self._make(name, self.channel.unary_unary)

    def stream(self, name: str) -> Any:
        return self._make(name, self.channel.unary_stream)

    def _make(self, name: str, kind: Any) -> Any:
        described = method(name)
        return kind(
            f"/{described.containing_service.full_name}/{name}",
            GetMessageClass(described.input_type).SerializeToString,
            GetMessageClass(described.output_type).FromString,
        )

    def _outcome(self, run: Callable[[], Any]) -> Outcome:
        try:
            result = run()
        except grpc.RpcError as error:
            return outcome_of_error(error)
        if result.DESCRIPTOR.name == "CandidateRender":
            return Outcome(result=result.png)
        return Outcome(result=document_of(result) or None)


def _metadata(key: str | None) -> tuple[tuple[str, str], ...]:
    return () if key is None else (("authorization", f"Bearer {key}"),)


def outcome_of_error(error: Any) -> Outcome:
    """What a status of gRPC says."""
    found = dict(error.trailing_metadata()).get("grpc-status-details-bin")
    assert found is not None, f"{error.code()} {error.details()}"
    status = status_pb2.Status.FromString(found)
    about, again, wrong = error_details_pb2.ErrorInfo(), False, ()
    for detail in status.details:
        if detail.Unpack(about):
            continue
        again = again or detail.Is(error_details_pb2.RetryInfo.DESCRIPTOR)
        violations = error_details_pb2.BadRequest()
        if detail.Unpack(violations):
            wrong = tuple(item.field for item in violations.field_violations)
    assert about.reason == about.metadata["code"].upper().replace("-", "_")
    return Outcome(
        code=about.metadata["code"],
        retryable=about.metadata["retryable"] == "true",
        message=status.message,
        hint=about.metadata["hint"],
        fields=wrong,
        retry_after=again,
    )


Transport = Direct | Rest | Rpc


class Tenant:
    """A tenant who uses one transport; what it saw is kept in ``seen``, in a form that can be compared."""

    def __init__(self, gateway: Any, transport: Transport, name: str) -> None:
        self.gateway, self.transport, self.name = gateway, transport, name
        self.key: str | None = self.new_key()
        self.seen: list[tuple[str, Any]] = []
        self._ids: dict[str, str] = {}

    def new_key(self, **options: Any) -> str:
        created: str = self.gateway.application.storage.keys.create("test", tenant_id=self.name, **options)
        return created

    @property
    def headers(self) -> dict[str, str]:
        """For what only REST can do."""
        return _bearer(self.key)

    def call(self, name: str, body: Any = None, **given: Any) -> Outcome:
        """Call an operation; the key may be another: ``key``."""
        key = given.pop("key", self.key)
        return self._noted(name, self.transport.call(name, key, given, body))

    def upload(self, scene_id: str, content: bytes, digest: str | None = None, **metadata: Any) -> Outcome:
        """Send an image."""
        key = metadata.pop("key", self.key)
        digest = digest or f"sha256:{hashlib.sha256(content).hexdigest()}"
        return self._noted("UploadImage", self.transport.upload(key, scene_id, digest, content, metadata))

    def scene(self, **request: Any) -> str:
        """A new scene's id."""
        made = self.call("CreateScene", {"name": "a scene", **request})
        assert not made.code, made
        return str(made.result["id"])

    def leave(self) -> None:
        """Delete all scenes."""
        app = self.gateway.application
        caller = app.storage.keys.authenticate(self.key)
        for scene in app.scenes.all(caller, Page()).items:
            app.deletions.scene(caller, scene.id)

    def _noted(self, name: str, outcome: Outcome) -> Outcome:
        shown = Outcome(
            result=self._comparable(outcome.result),
            code=outcome.code,
            retryable=outcome.retryable,
            message=self._comparable(outcome.message),
            fields=outcome.fields,
            retry_after=outcome.retry_after,
        )
        self.seen.append((name, shown))
        return outcome

    def _comparable(self, value: Any) -> Any:
        """A value without what differs from call to call: ids, times, durations."""
        if isinstance(value, Mapping):
            return {
                name: 0.0 if name in _MEASURED else self._comparable(part) for name, part in value.items()
            }
        if isinstance(value, list | tuple):
            return [self._comparable(part) for part in value]
        if isinstance(value, str):
            if _TIME.match(value):
                return "a time"
            return _ID.sub(
                lambda found: self._ids.setdefault(found[0], f"{found[1]} {len(self._ids)}"), value
            )
        return value


@pytest.fixture(scope="session")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A gateway that needs keys, with small limits; all tests share it."""
    limits = {"candidates_per_ranking": 40, "open_jobs_per_tenant": 2, "images_per_scene": 6}
    settings = _service._settings(
        tmp_path_factory.mktemp("contract") / "service",
        {"require_keys": True, "grpc_port": 0, "limits": limits},
    )
    with _service._running(settings) as gateway:
        yield gateway


@pytest.fixture(scope="session")
def operations() -> dict[str, Operation]:
    """The operations that are one request and one response on both transports."""
    return OPERATIONS


@pytest.fixture(scope="session")
def outcome_of() -> Callable[[Any], Outcome]:
    """What a status of gRPC says."""
    return outcome_of_error


@pytest.fixture(scope="session")
def word_of() -> Callable[[Any, int], str]:
    """REST's word for a value of an enum."""
    return rest_word


def _start(gateway: Any, settings: Settings) -> tuple[RpcServer, int]:
    state = gateway.app.state

    async def start() -> tuple[RpcServer, int]:
        parts = RpcGateway(state.application, state.feed, state.metrics, state.loop_lag, state.parsing)
        server = RpcServer(parts, settings)
        return server, await server.start()

    started: tuple[RpcServer, int] = gateway.client.portal.call(start)
    return started


@pytest.fixture(scope="session")
def rpc_port(gateway: Any) -> Iterator[int]:
    """The port of gRPC of the gateway."""
    server, port = _start(gateway, gateway.settings)
    yield port
    gateway.client.portal.call(server.stop, 1.0)


@pytest.fixture
def open_rpc(gateway: Any) -> Iterator[Callable[..., tuple[RpcServer, int]]]:
    """Serve gRPC on another port, with other settings."""
    servers = []

    def start(**changed: Any) -> tuple[RpcServer, int]:
        server, port = _start(gateway, gateway.settings.model_copy(update=changed))
        servers.append(server)
        return server, port

    yield start
    for server in servers:
        gateway.client.portal.call(server.stop, 1.0)


@pytest.fixture(scope="session")
def rpc(rpc_port: int) -> Iterator[Rpc]:
    """Calls over gRPC."""
    with grpc.insecure_channel(f"127.0.0.1:{rpc_port}") as channel:
        yield Rpc(channel)


@pytest.fixture
def compare(gateway: Any, rpc: Rpc, request: pytest.FixtureRequest) -> Callable[..., None]:
    """Play a scenario over each transport, each with a tenant of its own, and compare what they saw."""

    def play(scenario: Callable[[Tenant], None]) -> None:
        tenants = [
            Tenant(gateway, transport, f"{request.node.name}-{transport.name}")
            for transport in (Direct(gateway), Rest(gateway), rpc)
        ]
        for tenant in tenants:
            scenario(tenant)
            tenant.leave()  # its jobs would stand in the line before those of the next one
        direct, *others = tenants
        for other in others:
            assert [name for name, _ in other.seen] == [name for name, _ in direct.seen]
            for (name, theirs), (_, ours) in zip(other.seen, direct.seen, strict=True):
                assert theirs == ours, f"{name} over {other.transport.name}"

    return play


@pytest.fixture
def tenant(gateway: Any, rpc: Rpc, request: pytest.FixtureRequest) -> Tenant:
    """A tenant who calls over gRPC."""
    return Tenant(gateway, rpc, request.node.name)
