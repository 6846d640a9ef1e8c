from collections.abc import Callable
from pathlib import Path

import pytest
from fvs_client.spool.wholeness import is_whole


@pytest.mark.parametrize("image_format", ["JPEG", "PNG", "WEBP"])
def test_a_file_is_whole_with_its_last_byte(
    tmp_path: Path, photograph: Callable[..., bytes], image_format: str
) -> None:
    content = photograph(1, image_format=image_format)
    file = tmp_path / "photograph"
    for size in (0, 1, 20, len(content) // 2, len(content) - 1):
        file.write_bytes(content[:size])
        assert not is_whole(file), size
    file.write_bytes(content)
    assert is_whole(file)


def test_the_end_of_a_thumbnail_is_not_that_of_the_photograph(
    tmp_path: Path, photograph: Callable[..., bytes]
) -> None:
    thumbnail = photograph(2, size=(32, 24))
    segment = b"\xff\xe1" + (len(thumbnail) + 2).to_bytes(2) + thumbnail
    content = photograph(1, size=(300, 300))
    content = content[:2] + segment + content[2:]
    file = tmp_path / "photograph.jpg"
    file.write_bytes(content[: len(content) // 2])
    assert not is_whole(file)
    file.write_bytes(content[: 2 + len(segment)])
    assert not is_whole(file)
    file.write_bytes(content)
    assert is_whole(file)


def test_zeros_that_a_camera_reserves_are_no_content(
    tmp_path: Path, photograph: Callable[..., bytes]
) -> None:
    content = photograph(1, size=(300, 300))
    file = tmp_path / "photograph.jpg"
    file.write_bytes(bytes(len(content)))
    assert not is_whole(file)
    file.write_bytes(content[:5_000] + bytes(200_000))
    assert not is_whole(file)
    file.write_bytes(content + bytes(200_000))
    assert is_whole(file)


def test_what_a_camera_writes_after_the_end_does_not_hide_it(
    tmp_path: Path, photograph: Callable[..., bytes]
) -> None:
    file = tmp_path / "photograph.jpg"
    for size in ((300, 300), (40, 30)):
        content = photograph(1, size=size)
        file.write_bytes(content + b"SEFH" + bytes(range(1, 255)) * 600 + b"SEFT")
        assert is_whole(file)
        file.write_bytes(content[:-2] + b"SEFH" + b"trailer" * 600 + b"SEFT")
        assert not is_whole(file)
