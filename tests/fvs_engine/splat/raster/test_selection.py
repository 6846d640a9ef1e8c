import pytest

from fvs_engine.errors import BackendUnavailableError, InvalidInputError
from fvs_engine.splat.raster import create_rasterizer


def test_kernels_that_do_not_compile_are_no_bug_of_ours(fake_gsplat, caplog):
    complaint = "raise RuntimeError('many lines\\nunsupported GNU version')"
    (fake_gsplat / "__init__.py").write_text(complaint)
    with pytest.raises(BackendUnavailableError, match="cannot be compiled here: unsupported GNU version"):
        create_rasterizer("gsplat")
    assert not caplog.messages
    assert create_rasterizer("auto").name == "cpu"
    (said,) = caplog.messages
    assert "The CUDA device is not used." in said
    assert "unsupported GNU version" in said


def test_an_unknown_backend_gets_the_names_of_all():
    with pytest.raises(InvalidInputError, match=r"'abacus'.*auto, cpu, gsplat, triton, reference"):
        create_rasterizer("abacus")
