"""Three ways to call an operation: the services themselves, REST and gRPC.

Each is called by the name of a method of ``fvs.v1`` with the same document, and answers with an ``Outcome``.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import grpc
import orjson
from anyio.to_thread import run_sync
from contract_operations import OPERATIONS, Call, method
from contract_outcome import Outcome, document_of, outcome_of_error, outcome_of_response
from fvs.v1 import images_pb2
from fvs_service.errors import ServiceError
from fvs_service.gateway.rest.bodies import parse as parse_body
from fvs_service.gateway.rpc.conversion import arguments
from fvs_service.images.upload_files import require_digest
from google.protobuf.message_factory import GetMessageClass

from fvs_schema.images import ImageMetadata

DOWNLOADS = {
    "DownloadImage": "/v1/scenes/{scene_id}/images/{digest}/content",
    "DownloadArtifact": "/v1/snapshots/{snapshot_id}/artifacts/{name}",
}


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
            with app.uploads.receive() as receiver:
                receiver.write(content)
                staged = receiver.finish()
                require_digest(staged.digest, digest)
                return app.images.store(who, scene_id, staged, ImageMetadata(**metadata))[0]

        return self._outcome(run)

    def download(self, name: str, key: str | None, given: Mapping[str, Any], start: int) -> Outcome:
        app = self._gateway.application

        def run() -> Any:
            who = app.storage.keys.authenticate(key)
            if name == "DownloadImage":
                image = app.images.original(who, given["scene_id"], given["digest"])
                return b"".join(app.images.content(image, start, image.size_bytes))
            snapshots = app.storage.snapshots
            artifact = snapshots.artifact(who, given["snapshot_id"], given["name"])
            found = snapshots.get(who, given["snapshot_id"])
            return b"".join(snapshots.read(found, given["name"], start, artifact.size_bytes))

        return self._outcome(run)

    def _outcome(self, run: Callable[[], Any]) -> Outcome:
        async def awaited() -> Any:
            result = await run_sync(run)
            if hasattr(result, "__aiter__"):
                return [part async for part in result]
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
        if isinstance(result, list):
            return Outcome(result=[part.model_dump(mode="json") for part in result])
        return Outcome(result=result.model_dump(mode="json") if hasattr(result, "model_dump") else result)


class Rest:
    """Calls over HTTP."""

    name = "rest"

    def __init__(self, gateway: Any) -> None:
        self._gateway = gateway

    def call(self, name: str, key: str | None, given: Mapping[str, Any], body: Any) -> Outcome:
        operation = OPERATIONS[name]
        path = operation.path.format(**given)
        variables = set(re.findall(r"{(\w+)}", operation.path)) | {"idempotency_key", "etag"}
        query = {one: value for one, value in given.items() if one not in variables}
        headers = bearer(key)
        if "idempotency_key" in given:
            headers["Idempotency-Key"] = given["idempotency_key"]
        if "etag" in given:
            headers["If-Match"] = f'"{given["etag"]}"'
        if operation.streamed:
            headers["Accept"] = "text/event-stream"
        options = {} if operation.body is None else {"json": body or {}}
        return outcome_of_response(
            self._gateway.client.request(operation.verb, path, params=query, headers=headers, **options)
        )

    def upload(
        self, key: str | None, scene_id: str, digest: str, content: bytes, metadata: Mapping[str, Any]
    ) -> Outcome:
        path = f"/v1/scenes/{scene_id}/images/{digest}"
        return outcome_of_response(
            self._gateway.client.put(path, content=content, params=metadata, headers=bearer(key))
        )

    def download(self, name: str, key: str | None, given: Mapping[str, Any], start: int) -> Outcome:
        headers = {**bearer(key), **({"Range": f"bytes={start}-"} if start else {})}
        answer = self._gateway.client.get(DOWNLOADS[name].format(**given), headers=headers)
        return Outcome(result=answer.content) if answer.status_code < 400 else outcome_of_response(answer)


class Rpc:
    """Calls over gRPC."""

    name = "rpc"

    def __init__(self, channel: grpc.Channel) -> None:
        self.channel = channel

    def call(self, name: str, key: str | None, given: Mapping[str, Any], body: Any) -> Outcome:
        described, operation = method(name), OPERATIONS[name]
        request = GetMessageClass(described.input_type)(**arguments(described.input_type, given))
        if operation.body is not None:
            part = getattr(request, operation.body[0])
            part.CopyFrom(type(part)(**arguments(part.DESCRIPTOR, body or {})))
        metadata = metadata_of(key)
        if operation.streamed:
            return self._outcome(lambda: list(self.stream(name)(request, timeout=60, metadata=metadata)))
        return self._outcome(lambda: self.unary(name)(request, timeout=60, metadata=metadata))

    def upload(
        self, key: str | None, scene_id: str, digest: str, content: bytes, metadata: Mapping[str, Any]
    ) -> Outcome:
        first = {"scene_id": scene_id, "digest": digest, "size_bytes": len(content), "metadata": metadata}

        def parts() -> Iterator[Any]:
            yield images_pb2.UploadImageRequest(upload=first)
            for start in range(0, len(content), 1000):
                yield images_pb2.UploadImageRequest(chunk=content[start : start + 1000])

        sent = self.upload_call()
        outcome = self._outcome(lambda: sent(parts(), timeout=60, metadata=metadata_of(key)))
        return outcome if outcome.code else Outcome(result=outcome.result["image"])

    def download(self, name: str, key: str | None, given: Mapping[str, Any], start: int) -> Outcome:
        request = GetMessageClass(method(name).input_type)(start=start, **given)
        stream = self.stream(name)
        outcome = self._outcome(lambda: list(stream(request, timeout=60, metadata=metadata_of(key))))
        if outcome.code:
            return outcome
        return Outcome(result=b"".join(part["chunk"] or b"" for part in outcome.result))

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
        if isinstance(result, list):
            return Outcome(result=[document_of(part) for part in result])
        if result.DESCRIPTOR.name == "CandidateRender":
            return Outcome(result=result.png)
        if result.DESCRIPTOR.name == "Thumbnail":
            return Outcome(result=result.jpeg)
        if result.DESCRIPTOR.name in ("MissionFile", "ViewRender"):
            return Outcome(result=result.content)
        return Outcome(result=document_of(result) or None)


def metadata_of(key: str | None) -> tuple[tuple[str, str], ...]:
    return () if key is None else (("authorization", f"Bearer {key}"),)


def bearer(key: str | None) -> dict[str, str]:
    """The headers of a request with this key."""
    return {} if key is None else {"Authorization": f"Bearer {key}"}


Transport = Direct | Rest | Rpc
