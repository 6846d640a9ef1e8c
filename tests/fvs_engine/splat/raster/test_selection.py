import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.splat.raster import create_rasterizer


def test_a_device_that_is_not_used_is_a_warning(fake_gsplat, caplog):
    (fake_gsplat / "__init__.py").write_text("")
    assert create_rasterizer("auto").name == "cpu"
    (said,) = caplog.messages
    assert "The CUDA device is not used." in said
    assert "with its kernels compiled" in said


def test_an_unknown_backend_gets_the_names_of_all():
    with pytest.raises(InvalidInputError, match=r"'abacus'.*auto, cpu, gsplat, triton, reference"):
        create_rasterizer("abacus")
