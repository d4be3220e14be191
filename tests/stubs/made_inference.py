"""An inference as :func:`chemage.infer` would find it, made up without any computation."""

from __future__ import annotations

import numpy as np

import chemage as ca
from chemage import Inference
from chemage.plugin import Forecast

SCENE = {
    "name": "made-tip",
    "surface": {"kind": "sphere", "radius": "5 nm", "pixels": 32, "pixel_size": "0.4518 nm"},
    "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "20 nN"},
    "forming": {"kind": "uniform", "lower": 0.8, "upper": 1.4},
    "engine": {"kind": "rejection-free"},
    "hold": {"start": "1 ms", "stop": "1e5 s", "per_decade": 2, "replicas": 3, "seed": 1},
}


def made_inference(peaks: tuple[float, ...] = (1.0,), *, members: int = 60, seed: int = 0, **more) -> Inference:
    """Samples about a density with Gaussian peaks (share of all sites: 0.9), seen from 0.75 to 1.2 eV."""
    rng = np.random.default_rng(seed)
    energies = np.linspace(0.55, 1.45, 61)
    visible = (energies > 0.75) & (energies < 1.2)
    base = sum(np.exp(-0.5 * ((energies - peak) / 0.06) ** 2) for peak in peaks)
    if not peaks:
        base = np.where((energies > 0.6) & (energies < 1.4), 1.0, 0.0)
    base = 0.9 * base / np.trapezoid(base, energies)
    narrow, wide = 0.06, 0.8
    factor = 1 + np.where(visible, narrow, wide) * _smooth(rng, members, energies.size)
    samples = np.maximum(base * factor, 0)
    samples /= np.maximum(np.trapezoid(samples, energies, axis=1)[:, None], 1.0)
    prior = np.abs(_smooth(rng, 80, energies.size)) * 1.5
    prior /= np.maximum(np.trapezoid(prior, energies, axis=1)[:, None], 1.0)
    times = np.geomspace(1e-3, 1e5, 25)
    cut = 0.02585 * np.log(1e13 * times)
    weight = 1 / (1 + np.exp((energies - cut[:, None]) / 0.02)) * np.gradient(energies)
    scale = 600.0
    fitted, prior_fitted = scale * samples @ weight.T, scale * prior @ weight.T
    truth = scale * weight @ base
    errors = 0.03 * truth + 1e-3
    values = truth + errors * rng.standard_normal(truth.size)
    fields = {
        "energies": energies,
        "samples": samples,
        "prior": prior,
        "visible": visible,
        "curve": np.zeros(times.size, dtype=np.int64),
        "hold_times": times,
        "values": values,
        "errors": errors,
        "fitted": fitted,
        "prior_fitted": prior_fitted,
        "curves": ({"name": "tip", "load": 20.0, "temperature": 300.0, "quantity": "friction_drop"},),
        "scores": {"density": 31.2, "gaussian": 32.9, "triangle": 30.1, "uniform": -14.8},
        "families": {
            "gaussian": {
                "parameters": {"mean": 1.0, "std": 0.06, "share": 0.9},
                "errors": {"mean": 0.004, "std": 0.003, "share": 0.02},
                "chi2": 23.0,
                "density": base.tolist(),
            },
            "uniform": {
                "parameters": {"lower": 0.82, "upper": 1.17, "share": 0.9},
                "errors": {"lower": 0.01, "upper": 0.02, "share": 0.03},
                "chi2": 143.0,
                "density": np.where((energies > 0.82) & (energies < 1.17), 0.9 / 0.35, 0.0).tolist(),
            },
        },
        "chi2": float((((values - fitted.mean(axis=0)) / errors) ** 2).sum()),
        "effective_parameters": 6.3,
        "resolution": 0.0634,
        "diagnostics": {"effective_samples": 800.0, "r_hat": 1.01, "cpu_seconds": 3.2},
        "seed": seed,
        "provenance": {"scene": ca.parse_scene(SCENE).todict(), "versions": {"chemage": "0.2.0"}, "unknown": {}},
    }
    fields |= more
    known = {"stated_errors": fields["errors"], "off": np.zeros(len(fields["errors"]))}
    return Inference(**(known | fields))


def made_forecast(load: float = 50.0, temperature: float = 350.0, unseen: float = 0.02, **more) -> Forecast:
    """A forecast that rises with the logarithm of the hold time."""
    rng = np.random.default_rng(3)
    times = np.geomspace(1e-3, 1e5, 17)
    slopes = 40 * (1 + 0.08 * rng.standard_normal(200))
    samples = slopes[:, None] * (1 + np.log10(times / 1e-3))
    return Forecast(load=load, temperature=temperature, hold_times=times, samples=samples, unseen=unseen, **more)


def _smooth(rng: np.random.Generator, count: int, size: int) -> np.ndarray:
    noise = rng.standard_normal((count, size + 8))
    window = np.exp(-0.5 * (np.arange(-4, 5) / 2.0) ** 2)
    window /= np.sqrt((window**2).sum())
    return np.stack([np.convolve(row, window, mode="valid") for row in noise])
