"""The keys of blobs: everything of a scene is below its own prefix."""


def scene_prefix(scene_id: str) -> str:
    """The prefix of all blobs of a scene."""
    return f"scenes/{scene_id}/"


def image_key(scene_id: str, sha256: str) -> str:
    """The key of an image, by the digest of its bytes."""
    return f"{scene_prefix(scene_id)}images/{sha256}"


def thumbnail_key(scene_id: str, image_sha256: str) -> str:
    """The key of an image's thumbnail, by the digest of the image."""
    return f"{scene_prefix(scene_id)}thumbnails/{image_sha256}"


def mask_key(scene_id: str, image_sha256: str, sha256: str) -> str:
    """The key of an image's mask, by the digests of the bytes of both."""
    return f"{scene_prefix(scene_id)}masks/{image_sha256}-{sha256}"


def video_key(scene_id: str, sha256: str) -> str:
    """The key of a video whose frames are not taken yet, by the digest of its bytes."""
    return f"{scene_prefix(scene_id)}videos/{sha256}"


def subtitles_key(scene_id: str, video_sha256: str) -> str:
    """The key of a video's subtitles, by the digest of the video, which may come later."""
    return f"{scene_prefix(scene_id)}subtitles/{video_sha256}"


def artifact_key(scene_id: str, sha256: str) -> str:
    """The key of an artifact, by the digest of its bytes: equal artifacts of a scene are one blob."""
    return f"{scene_prefix(scene_id)}artifacts/{sha256}"


def manifest_key(scene_id: str, snapshot_id: str) -> str:
    """The key of a snapshot's list of artifacts."""
    return f"{scene_prefix(scene_id)}snapshots/{snapshot_id}.json"


def working_copy_key(scene_id: str, name: str) -> str:
    """The key of a working copy of a scene's folder."""
    return f"{scene_prefix(scene_id)}working/{name}.tar"


def ranking_prefix(scene_id: str, ranking_id: str) -> str:
    """The prefix of the renders of a ranking's candidates."""
    return f"{scene_prefix(scene_id)}rankings/{ranking_id}/"
