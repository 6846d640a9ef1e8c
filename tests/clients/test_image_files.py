import os
from pathlib import Path

from fvs_client.image_files import find_image_files


def test_names_in_a_scene_are_text_without_slashes(tmp_path: Path) -> None:
    for name in (b"caf\xe9.jpg", b"caf\xe8.jpg", b"left/0001.JPG", b"new\nline.png"):
        path = tmp_path / os.fsdecode(name)
        path.parent.mkdir(exist_ok=True)
        path.touch()
    names = {file.name for file in find_image_files(tmp_path)}
    assert names == {"caf%E9.jpg", "caf%E8.jpg", "left_0001.JPG", "new_line.png"}
