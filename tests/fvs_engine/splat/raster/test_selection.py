import sys

import pytest
import torch

from fvs_engine.errors import BackendUnavailableError, InvalidInputError
from fvs_engine.splat.raster import create_rasterizer


@pytest.fixture
def broken_gsplat(tmp_path, monkeypatch):
    """A machine with a device and a gsplat whose kernels its compiler does not like."""
    (tmp_path / "gsplat").mkdir()
    complaint = "raise RuntimeError('many lines\\nunsupported GNU version')"
    (tmp_path / "gsplat" / "__init__.py").write_text(complaint)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    for name in [name for name in sys.modules if name.split(".")[0] == "gsplat"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "fvs_engine.splat.raster.cuda", raising=False)


@pytest.mark.usefixtures("broken_gsplat")
def test_kernels_that_do_not_compile_are_no_bug_of_ours(caplog):
    with pytest.raises(BackendUnavailableError, match="cannot be compiled here: unsupported GNU version"):
        create_rasterizer("cuda")
    assert not caplog.messages
    assert create_rasterizer("auto").name == "cpu"
    (said,) = caplog.messages
    assert "The CUDA device is not used." in said
    assert "unsupported GNU version" in said


def test_an_unknown_backend_gets_the_names_of_all():
    with pytest.raises(InvalidInputError, match=r"'abacus'.*auto, cpu, cuda, reference"):
        create_rasterizer("abacus")
