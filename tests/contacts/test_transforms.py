"""Libraries for Fourier transforms: how they are called, with stand-ins that behave as documented."""

from __future__ import annotations

import sys
import types

import numpy as np
import pytest
from scipy import fft as sfft

import chemage as ca
from chemage import InputError
from chemage_contact._grid import Transforms


def ducc0() -> dict[str, types.ModuleType]:
    """https://mtr.pages.mpcdf.de/ducc: forward is the sign of the exponent, inorm 2 divides by the length."""
    module, inner = types.ModuleType("ducc0"), types.ModuleType("ducc0.fft")

    def r2c(a, axes=None, *, forward=True, inorm=0, out=None, nthreads=1):
        assert forward
        assert inorm == 0
        assert out is None
        return sfft.rfftn(a, axes=axes, workers=nthreads)

    def c2r(a, axes=None, *, lastsize=0, forward=False, inorm=0, out=None, nthreads=1):
        assert not forward
        assert inorm == 2
        assert out is None
        return sfft.irfftn(a, s=(a.shape[0], lastsize), axes=axes, workers=nthreads)

    def c2c(a, axes=None, *, forward=True, inorm=0, out=None, nthreads=1):
        assert inorm == (0 if forward else 2)
        out[...] = (sfft.fftn if forward else sfft.ifftn)(a, axes=axes, workers=nthreads)
        return out

    inner.r2c, inner.c2r, inner.c2c = r2c, c2r, c2c  # pyright: ignore[reportAttributeAccessIssue]
    module.fft = inner  # pyright: ignore[reportAttributeAccessIssue]
    return {"ducc0": module, "ducc0.fft": inner}


def scipy_like(name: str) -> dict[str, types.ModuleType]:
    """pyFFTW and mkl_fft have scipy's interface; neither guarantees to work in place."""
    module = types.ModuleType(f"{name}.interfaces.scipy_fft")

    def named(function):
        def call(x, s=None, overwrite_x=False, workers=1):
            return getattr(sfft, function)(np.array(x), s=s, workers=workers)

        return call

    for function in ("rfft2", "irfft2", "fft2", "ifft2"):
        setattr(module, function, named(function))
    cache = types.ModuleType(f"{name}.interfaces.cache")
    cache.enable = lambda: None  # pyright: ignore[reportAttributeAccessIssue]
    parents = {part: types.ModuleType(part) for part in (name, f"{name}.interfaces")}
    return {**parents, module.__name__: module, cache.__name__: cache}


STANDINS = {
    "scipy": dict,
    "ducc0": ducc0,
    "pyfftw": lambda: scipy_like("pyfftw"),
    "mkl_fft": lambda: scipy_like("mkl_fft"),
}


@pytest.fixture(params=STANDINS)
def library(request, monkeypatch) -> str:
    for name, module in STANDINS[request.param]().items():
        monkeypatch.setitem(sys.modules, name, module)
    return request.param


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(("shape", "padded"), [((12, 10), (12, 10)), ((7, 9), (15, 18)), ((5, 1), (5, 1))])
def test_transforms_are_numpys(library, shape, padded, dtype):
    x = np.random.default_rng(1).standard_normal(shape).astype(dtype)
    kept = x.copy()
    transforms = Transforms(shape, padded, library, 2)
    spectrum = transforms.forward(x)
    tolerance = 50 * np.finfo(dtype).eps
    np.testing.assert_allclose(spectrum, np.fft.rfft2(x, s=padded), atol=tolerance)
    np.testing.assert_array_equal(x, kept)
    assert spectrum.dtype == np.result_type(dtype, np.complex64)
    back = transforms.backward(spectrum)
    np.testing.assert_allclose(back, x, atol=tolerance)
    assert back.flags.c_contiguous
    assert back.dtype == dtype
    z = (x[:, : shape[1] // 2 * 2 : 2] + 1j * x[:, 1::2][:, : shape[1] // 2]).astype(spectrum.dtype)
    if z.size:
        there = transforms.in_place(z.copy(), True)
        np.testing.assert_allclose(there, np.fft.fft2(z), atol=tolerance)
        again = transforms.in_place(there, False)
        np.testing.assert_allclose(again, z, atol=tolerance)
        assert again.flags.c_contiguous
        assert again.dtype == z.dtype


def test_every_library_solves_the_same_contact(library):
    rough = ca.surface("self-affine", pixels=128, pixel_size=0.45, rms_slope=0.1, hurst=0.8, zeta=16, eta=3).make(2)
    solver = ca.contact("fft-bem", modulus=35.3, tolerance=1e-8)
    plain = solver.solve(rough, 200.0)
    found = solver.replace(fft=library).solve(rough, 200.0)
    np.testing.assert_allclose(found.pressure, plain.pressure, atol=1e-5 * plain.pressure.max())


@pytest.mark.parametrize("missing", ["ducc0", "pyfftw", "mkl_fft"])
def test_a_library_that_is_not_there_is_named_with_the_remedy(missing, monkeypatch):
    for name in STANDINS[missing]():
        monkeypatch.setitem(sys.modules, name, None)
    rough = ca.surface("self-affine", pixels=16, pixel_size=0.45, rms_slope=0.1, hurst=0.8, zeta=4, eta=2).make(2)
    with pytest.raises(InputError, match=rf"fft = '{missing}': cannot be imported .*pip install .*choose 'scipy'"):
        ca.contact("fft-bem", modulus=35.3, fft=missing).solve(rough, 10.0)
