"""What the service says of itself."""

from fvs_client.models.base import Answer


class Limits(Answer):
    """What one request, scene or tenant may use; a limit that the service does not tell is None."""

    image_bytes: int | None = None
    image_pixels: int | None = None
    images_per_scene: int | None = None
    digests_per_check: int | None = None
    candidates_per_ranking: int | None = None
    open_uploads_per_tenant: int | None = None
    page_items: int | None = None


class Capabilities(Answer):
    """What the service can do, and how much of it."""

    version: str
    api: tuple[str, ...]
    methods: tuple[str, ...]
    """What candidates can be ranked by."""
    generators: tuple[str, ...]
    image_formats: tuple[str, ...]
    keys_required: bool
    limits: Limits


class Health(Answer):
    """That the service is up."""

    status: str
