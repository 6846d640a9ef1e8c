import re
import runpy
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent.parent
IMAGES = REPOSITORY / "docs" / "images"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site without search and colours of code, in strict mode: a broken link or reference fails."""
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    folder = tmp_path_factory.mktemp("site")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NO_MKDOCS_2_WARNING", "1")
        patch.setenv("FVS_DOCS_WHOLE", "false")
        build(load_config(str(REPOSITORY / "mkdocs.yml"), strict=True, site_dir=str(folder)))
    return folder


@pytest.mark.system
def test_pages_load_nothing_from_elsewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r'<(?:script|img|iframe|link)\b[^>]*?(?:src|href)="?(https?:[^\s">]+)', text)
        assert loaded == [], page


@pytest.mark.system
def test_the_references_are_generated(site: Path) -> None:
    rest = (site / "reference" / "rest.html").read_text(encoding="utf-8")
    assert "POST /v1/scenes/{scene_id}/rankings" in rest
    assert 'id="rankingrequest"' in rest
    fvs = (site / "reference" / "fvs.html").read_text(encoding="utf-8")
    assert "fvs reconstruct" in fvs
    assert "fvs keys create" in fvs
    assert "--iterations" in fvs
    assert "fvs-client jobs wait" in (site / "reference" / "fvs-client.html").read_text(encoding="utf-8")
    settings = (site / "reference" / "settings.html").read_text(encoding="utf-8")
    assert "FVS_WORKER__JOBS_AT_ONCE" in settings
    assert "fvs_client.Client" in (site / "reference" / "client.html").read_text(encoding="utf-8")
    assert "fvs_engine.pipeline.rank" in (site / "reference" / "engine" / "pipeline.html").read_text(
        encoding="utf-8"
    )


def test_the_drawings_are_those_of_the_script() -> None:
    drawings = runpy.run_path(str(IMAGES / "diagrams.py"))["DRAWINGS"]
    for name, draw in drawings.items():
        assert (IMAGES / name).read_text(encoding="utf-8") == draw(), (
            f"python docs/images/diagrams.py makes {name}"
        )
