"""A result of each kind whose figures are drawn, made up from closed forms and fixed random numbers, in a second."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from made_inference import made_forecast, made_inference
from seen import Comparison, Entry

import chemage as ca
from chemage.plugin import ContactStatistics
from chemage_inference.result import InferenceResult

SCENE = {
    "name": "rough",
    "title": "Rough silica",
    "surface": {"kind": "self-affine", "pixels": 64, "pixel_size": 0.45, "rms_slope": 0.1, "hurst": 0.8, "zeta": 8,
                "seed": 3},
    "contact": {"kind": "fft-bem", "modulus": 35.3, "load": 100.0},
    "forming": {"kind": "uniform", "lower": 0.8, "upper": 1.4},
    "engine": {"kind": "independent"},
    "hold": {"start": 1e-2, "stop": 1e4, "per_decade": 1, "replicas": 3, "seed": 5, "temperature": 300.0},
}  # fmt: skip
TIMES = np.geomspace(1e-2, 1e4, 7)


def made_surface() -> ca.Surface:
    """A rough periodic surface."""
    rng = np.random.default_rng(1)
    q = np.hypot(*np.meshgrid(np.fft.fftfreq(96), np.fft.fftfreq(96)))
    spectrum = np.where((q > 0.02) & (q < 0.2), np.maximum(q, 1e-3) ** -1.8, 0.0)
    heights = np.fft.ifft2(spectrum * np.fft.fft2(rng.standard_normal((96, 96)))).real
    return ca.Surface(heights=heights / heights.std(), pixel_size=0.5, periodic=True)


def made_contact(pixels: int = 1000, spots: int = 60) -> ca.ContactSolution:
    """Hertz-like spots on about 1 % of the area."""
    rng = np.random.default_rng(2)
    pressure, x = np.zeros((pixels, pixels)), np.arange(pixels)
    for (i, j), radius in zip(rng.uniform(0, pixels, (spots, 2)), rng.uniform(2, 14, spots), strict=True):
        distance = ((x[:, None] - i) ** 2 + (x - j) ** 2) / radius**2
        pressure = np.maximum(pressure, radius / 2 * np.sqrt(np.maximum(1 - distance, 0)))
    load = float(pressure.sum()) * 0.45**2
    return ca.ContactSolution(pressure=pressure, load=load, pixel_size=0.45, modulus=35.3)


def made_ageing(temperature: float = 300.0, load: float = 100.0, seed: int = 0) -> ca.Ageing:
    """Bonds that grow with the logarithm of the hold time, in five replicas."""
    rng = np.random.default_rng(seed)
    times = np.geomspace(1e-3, 1e5, 25)
    share = np.clip(0.05 * (np.log(times * 1e13) * temperature / 300.0 - 20.0), 0, 1)
    bonds = np.round(1000 * share * (1 + 0.04 * rng.standard_normal((5, 1))) + 8 * rng.standard_normal((5, 25)))
    bonds = np.maximum.accumulate(np.clip(bonds, 0, 2000), axis=1).astype(np.int64)
    fields = {"events": [40] * 5, "load": load, "temperature": temperature, "engine": "by-hand"}
    return ca.Ageing(hold_times=times, bonds=bonds, sites=[2000] * 5, **fields)


def made_ensemble(random: bool = True, ages: bool = True, seed: int = 0) -> ca.Ensemble:
    """An ensemble of 20 samples that scatter by 10 %, corrected by nothing, with an error of the grid of 1 % of the
    friction."""
    rng = np.random.default_rng(seed)
    times = TIMES if ages else np.zeros(0)
    scale = 1 + 0.1 * rng.normal(size=(20, 1))
    drop = 10 * np.arange(1.0, times.size + 1) * scale
    measures = np.column_stack([0.02 * scale[:, 0], 12 * scale[:, 0]])
    x = np.log10(times[3:])
    beta = (drop[:, 3:] @ (x - x.mean()) / ((x - x.mean()) @ (x - x.mean())) / 100)[:, None] if ages else drop[:, :0]
    rows = np.concatenate([beta, drop, measures], axis=1)
    known = np.full(rows.shape[1], 0.01)
    scene = SCENE if ages else {name: SCENE[name] for name in ("name", "title", "surface", "contact")}
    level = {"words": "64 x 64 pixels, 1 replica", "replicas": 1, "samples": 20, "cpu_seconds": 0.1, "random": random}
    return ca.Ensemble(
        hold_times=times,
        load=100.0,
        window=(10.0, 1e4),
        measures=("area_fraction", "patches"),
        levels=({**level, "seeds": [[1, 2], [3, 4]]},),
        rows={"0": rows},
        known={"discretisation": known} if random else {},
        known_how={"discretisation": "measured before on other surfaces"} if random else {},
        goals={"beta": 0.06} if ages else {"area_fraction": 0.06},
        stopped="the accuracy was reached",
        notes=("a note",),
        provenance={
            "scene": ca.parse_scene(scene).todict(),
            "versions": {"chemage": "0.2.0"},
            "cite": ["A. Author, doi:10.1/1"],
        },
    )


def made_trade() -> ca.Tradeoff:
    """A map of speed and accuracy with a front of combinations."""

    observables = ["beta", "corrected_area", "friction_drop@1000 s"]

    def point(seconds: float, error: float, **choices: str) -> ca.plugin.TradePoint:
        return ca.plugin.TradePoint(
            choices=choices,
            changes={},
            own=not choices,
            contact_seconds=[seconds, 1.1 * seconds, seconds],
            ageing_seconds=[0.1 * seconds] * 3,
            differences=dict.fromkeys(observables, (error, 0.1 * error, 3)),
            values={"beta": 0.4},
            scatter={"beta": 0.05},
        )

    points = [
        point(1.0, 0.0005),
        point(0.1, 0.02, **{"contact.tolerance": "0.01"}),
        point(0.3, 0.05, **{"surface.pixels": "512", "contact.tolerance": "0.001"}),
        point(0.5, 0.004, **{"engine.kind": "independent, coarse"}),
    ]
    more = {"scene": {"name": "made"}, "question": "q", "versions": {}, "machine": {}, "rounds": 3, "random": True}
    return ca.Tradeoff(**more, replicas=10, observables=observables, points=points).marked()


def made_result_of_inference() -> InferenceResult:
    """An inference of two curves, with an unknown force and forecasts by load and temperature."""
    one = made_inference((0.9, 1.05))
    half = np.arange(one.hold_times.size) % 2
    curves = tuple({**one.curves[0], "name": f"tip-{kelvin}", "temperature": float(kelvin)} for kelvin in (300, 350))
    force = np.random.default_rng(4).normal(2.0, 0.2, len(one.samples))
    one = one.model_copy(
        update={
            "curve": half.astype(np.int64),
            "curves": curves,
            "scalars": {"bond_force": force},
            "scalar_bounds": {"bond_force": (1.0, 3.0)},
        }
    )
    forecasts = {
        f"load={load:g} nN, temperature={kelvin:g} K": made_forecast(load, kelvin, unseen)
        for load, kelvin, unseen in ((20, 350, 0.02), (50, 350, 0.3), (50, 400, 0.1), (80, 400, 0.95), (100, 300, 0.0))
    }
    return InferenceResult(one, forecasts)


def made_run(ageing: ca.Ageing, **scene: Any) -> ca.Run:
    """A run with a known scatter between surfaces."""
    data = ca.parse_scene({**SCENE, **scene}).todict()
    return ca.Run(data, made_contact(), surface=made_surface(), ageing=ageing)


def made_comparison() -> Comparison:
    """Three results with measurements."""
    entries = []
    for number, name in enumerate(("rough", "a tip with a rather long name", "mean")):
        thing = made_ensemble() if name == "mean" else made_ageing(300 + 20 * number, 60.0 + 40 * number, number)
        entries.append(replace(Entry.of(thing), name=name))
    times = np.geomspace(0.1, 1e4, 6)
    measured = ca.Measurements(
        "afm", times, 0.1 + 0.02 * np.log10(times), "friction_coefficient_drop", 0.01 + 0 * times
    )
    return Comparison(entries, (measured,))


def every_result() -> Mapping[str, Any]:
    """Name -> result, one of each kind that has a picture."""
    area = np.exp(-np.linspace(0, 4, 40))
    theory = ContactStatistics(
        pressure=np.linspace(0.5, 20, 40), area=area, load=30.0, nominal_area=1e3, modulus=35.3, rms_slope=0.1
    )
    times = np.geomspace(0.1, 1e4, 11)
    counts = np.arange(11) * 10
    history = ca.plugin.BondHistory(
        hold_times=times, bonds=counts, formed=counts, broken=0 * counts, state=np.arange(200) < 100, time=1e4,
        temperature=300.0, engine="by-hand",
    )  # fmt: skip
    return {
        "run": made_run(made_ageing()),
        "one patch": made_contact(300, 1),
        "theory": theory,
        "history": history,
        "force": made_ageing(load=0.0),
        "ensemble": made_ensemble(),
        "bare ensemble": made_ensemble(ages=False),
        "arrhenius": ca.arrhenius([made_ageing(kelvin) for kelvin in (280.0, 300.0, 320.0, 340.0)]),
        "trade": made_trade(),
        "inference": made_result_of_inference(),
    }
