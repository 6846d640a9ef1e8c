"""Images over gRPC."""

from collections.abc import AsyncIterator, Awaitable, Callable

from anyio.to_thread import run_sync
from fvs.v1 import images_pb2 as pb
from fvs.v1.downloads_pb2 import DownloadPart

from fvs_schema.base import Page
from fvs_schema.images import DigestAnswer, DigestCheck, Image, ImageList
from fvs_service.application import Application
from fvs_service.gateway.rpc.calls import Call
from fvs_service.gateway.rpc.conversion import pick, read
from fvs_service.gateway.rpc.downloads import download
from fvs_service.gateway.rpc.requests import digest_of
from fvs_service.images.rpc_uploads import ImageUpload
from fvs_service.images.uploads import PartialUpload
from fvs_service.principal import Principal, Scope
from fvs_service.uninterrupted import to_its_end


class ImageServicer:
    """``fvs.v1.ImageService``."""

    service = pb.DESCRIPTOR.services_by_name["ImageService"]

    def __init__(self, app: Application) -> None:
        self._app = app

    def check_images(self, caller: Principal, request: pb.CheckImagesRequest) -> DigestAnswer:
        """Check which images the scene has."""
        self._app.scenes.require(caller, Scope.UPLOAD, request.scene_id)
        check = read(DigestCheck, request.check, self._app.storage.settings.limits)
        return self._app.images.check(caller, request.scene_id, check)

    async def upload_image(
        self, call: Call, caller: Principal, receive: Callable[[], Awaitable[bytes | None]]
    ) -> pb.UploadImageResponse:
        """Receive an image, from its first byte or from where an upload broke off."""
        return await ImageUpload(self._app, call.gateway.metrics, caller, receive, call.name).run()

    def get_upload(self, caller: Principal, request: pb.GetUploadRequest) -> PartialUpload:
        """Return how far an upload that broke off has come."""
        self._app.scenes.require(caller, Scope.UPLOAD, request.scene_id)
        return self._app.uploads.find_part(caller.tenant_id, request.scene_id, digest_of(request))

    def list_images(self, caller: Principal, request: pb.ListImagesRequest) -> ImageList:
        """List the images of a scene."""
        page = pick(Page, request)
        return self._app.images.of_scene(caller, request.scene_id, page)

    def get_image(self, caller: Principal, request: pb.GetImageRequest) -> Image:
        """Return an image."""
        return self._app.images.get(caller, request.scene_id, digest_of(request))

    def delete_image(self, caller: Principal, request: pb.DeleteImageRequest) -> None:
        """Delete an image."""
        self._app.exclusions.delete(caller, request.scene_id, digest_of(request))

    def exclude_image(self, caller: Principal, request: pb.ExcludeImageRequest) -> Image:
        """Leave an image out of the next model."""
        return self._app.exclusions.exclude(caller, request.scene_id, digest_of(request))

    def include_image(self, caller: Principal, request: pb.IncludeImageRequest) -> Image:
        """Use an image again."""
        return self._app.exclusions.include(caller, request.scene_id, digest_of(request))

    async def set_mask(self, _call: Call, caller: Principal, request: pb.SetMaskRequest) -> Image:
        """Give an image a mask."""
        await run_sync(self._app.scenes.require, caller, Scope.UPLOAD, request.scene_id)
        digest = digest_of(request)
        with self._app.uploads.receive() as receiver:
            await run_sync(receiver.write, request.mask)
            mask = receiver.finish()
            async with self._app.inspection_turns.turn(caller):
                return await to_its_end(run_sync(self._app.masks.set, caller, request.scene_id, digest, mask))

    def remove_mask(self, caller: Principal, request: pb.RemoveMaskRequest) -> Image:
        """Take the mask of an image away."""
        return self._app.masks.remove(caller, request.scene_id, digest_of(request))

    async def set_subtitles(self, _call: Call, caller: Principal, request: pb.SetSubtitlesRequest) -> None:
        """Keep the subtitles of a video that is sent next."""
        await run_sync(self._app.scenes.require, caller, Scope.UPLOAD, request.scene_id)
        digest = digest_of(request)
        with self._app.uploads.receive() as receiver:
            await run_sync(receiver.write, request.subtitles)
            file = receiver.finish()
            await to_its_end(run_sync(self._app.videos.set_subtitles, caller, request.scene_id, digest, file))

    def get_thumbnail(self, caller: Principal, request: pb.GetThumbnailRequest) -> pb.Thumbnail:
        """Return an accepted image as a small JPEG."""
        image = self._app.images.original(caller, request.scene_id, digest_of(request))
        return pb.Thumbnail(jpeg=self._app.images.thumbnail(image))

    async def download_image(
        self, _call: Call, caller: Principal, request: pb.DownloadImageRequest
    ) -> AsyncIterator[DownloadPart]:
        """Stream the original of an accepted image or a range of it."""
        image = await run_sync(self._app.images.original, caller, request.scene_id, digest_of(request))
        async for part in download(
            request,
            image.media_type,
            image.size_bytes,
            image.sha256,
            lambda start, stop: self._app.images.content(image, start, stop),
        ):
            yield part
