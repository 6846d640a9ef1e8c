"""Scenes, rankings, plans and renders in a notebook."""

from typing import Any

import nbformat
import pytest
from fvs_client import Client
from nbclient import NotebookClient

NAME = '<b>pit</b> & "quarry"'


@pytest.mark.system
@pytest.mark.process
def test_a_notebook_shows_what_a_scene_has(
    client: Client, gateway: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Any
) -> None:
    monkeypatch.setenv("FVS_URL", client.url)
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    scene = client.scenes.create(NAME)
    gateway.model(scene.id)
    cells = [
        f"from fvs_client import Client, Orbit\nclient = Client()\nclient.scenes.get({scene.id!r})",
        "scene = _\nscene.rank(generator=Orbit(count=40), top_k=35)",
        "ranking = _\nscene.plan(generator=Orbit(count=8), views=3)",
        "ranking.render(ranking.best)",
        "print(scene)\nscene.rank(generator=Orbit(cuont=3))",
    ]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(source) for source in cells])
    NotebookClient(notebook, timeout=60, kernel_name="python3", allow_errors=True).execute()
    outputs = [cell.outputs for cell in notebook.cells]
    shown = [output[0]["data"]["text/html"] for output in outputs[:4]]
    assert "&lt;b&gt;pit&lt;/b&gt; &amp; &quot;quarry&quot;" in shown[0]
    assert "<b>" not in "".join(shown)
    assert shown[1].count("<tr>") == 31
    assert "… and 5 more" in shown[1]
    assert "by median-frequency" in shown[1]
    assert shown[2].count("<tr>") >= 4
    assert "3 more photographs" in shown[2]
    assert shown[3].startswith('<img src="data:image/png;base64,')
    assert outputs[4][0]["text"].startswith("Scene(id=")
    assert outputs[4][1]["evalue"] == "cuont: there is no such field. Did you mean `count`?"
