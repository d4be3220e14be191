"""One small result of every kind in the table "Equal bytes" of docs/file-format.md, as arrays: run as a program, this
writes them to the npz file that is named.

Kinetics and fits are of a contact whose pressure is rounded, so that it is the same on every machine.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np

import chemage as ca
from chemage_inference import infer, problem, sampling

TIP = {"kind": "sphere", "radius": "30 nm", "pixels": 64, "pixel_size": "0.4518 nm"}
ROUGH = {"pixels": 64, "pixel_size": "0.4518 nm", "rms_slope": 0.1, "hurst": 0.8, "zeta": 16, "eta": 2}
TIMES = ca.hold_times("1 ms", "1e4 s", per_decade=2)
PAIRS = ca.interaction("elastic-pairs", strength="0.5 eV", bias=0.1)
DATA = Path(__file__).parents[2] / "docs" / "data" / "tip.csv"


def contacts() -> dict[str, list[np.ndarray]]:
    tip = ca.make_surface(ca.surface(**TIP))
    rough = ca.surface("self-affine", **ROUGH).make(seed=1)

    def pressure(surface, kind, load="50 nN", **options):
        return ca.contact(kind, modulus="35.3 GPa", **options).solve(surface, load=load).pressure

    work = {"work_of_adhesion": "50 mJ/m**2"}
    return {
        "heights": [rough.heights, tip.heights],
        "closed forms": [
            pressure(tip, "hertz"),
            pressure(tip, "jkr", **work),
            pressure(tip, "dmt", **work),
            pressure(tip, "maugis", range="0.5 nm", **work),
        ],
        "spheres that flow": [pressure(tip, "hertz", hardness="1.5 GPa")],
        "`fft-bem`, single": [pressure(rough, "fft-bem", "0.2 uN")],
        "`fft-bem`, mixed and double": [
            pressure(rough, "fft-bem", "0.2 uN", precision="mixed"),
            pressure(rough, "fft-bem", "0.2 uN", precision="double"),
            pressure(rough, "fft-bem", "0.2 uN", precision="double", hardness="5 GPa"),
        ],
        "`adhesive-bem`": [pressure(tip, "adhesive-bem", "20 nN", range="0.5 nm", **work)],
    }


def ageing() -> dict[str, list[np.ndarray]]:
    tip = ca.make_surface(ca.surface(**TIP))
    hertz = ca.contact("hertz", modulus="35.3 GPa").solve(tip, load="50 nN")
    pressure = np.round(hertz.pressure * 256) / 256
    load = float(pressure.sum()) * hertz.pixel_size**2
    contact = ca.ContactSolution(
        pressure=pressure, pixel_size=hertz.pixel_size, load=load, modulus=35.3, periodic=False
    )
    breaking = ca.barriers("gaussian", mean="1.1 eV", std="0.02 eV")
    coupled = ca.chemistry(
        forming=ca.barriers("md-silica"), breaking=breaking, interaction=PAIRS, activation_volume="6.4 angstrom**3"
    )
    apart = coupled.replace(interaction=None)

    def aged(engine, chemistry=coupled, **options):
        return ca.age(contact, chemistry, engine=ca.engine(engine), hold_times=TIMES, temperature="300 K", **options)

    bonds = [aged(name, replicas=3).bonds for name in ("rejection-free", "bkl", "next-reaction")]
    one = aged("rejection-free", replicas=4)
    fits = [
        ca.fit_ageing(one, model=model, bootstrap=drawn) for model in ("line", "curve") for drawn in (None, "replicas")
    ]
    sample = aged("rejection-free", replicas=2, method=ca.ageing_method("sample", share=0.5))
    closed = aged("rejection-free", apart, method=ca.ageing_method("closure"))
    pulled = ca.rupture(
        "pulled", speed="1 um/s", bond_stiffness="10 nN/nm", transition_distance="0.03 nm", distance="1 nm"
    )
    return {
        "bonds of every engine": [*bonds, aged("independent", apart, replicas=3).bonds, sample.bonds],
        "friction, β and its intervals": [
            one.friction_drop,
            *(np.array([fit.beta, *fit.beta_interval, fit.beta_stderr, fit.log_cutoff]) for fit in fits),
        ],
        "pulls": [aged("rejection-free", replicas=2, rupture=pulled).friction_drop],
        "`closure`": [closed.bonds],
    }


def studies() -> dict[str, list[np.ndarray]]:
    sampling.ENOUGH, sampling.AGREED, sampling.WARM, problem.MOVES, infer.PRIOR_SAMPLES = 0, np.inf, 20, 50, 50
    scene = {
        "name": "tip",
        "surface": TIP,
        "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "50 nN"},
        "forming": {"kind": "uniform", "lower": "0.8 eV", "upper": "1.4 eV"},
        "chemistry": {"activation_volume": "6.4 angstrom**3", "bond_force": "3 nN"},
        "engine": {"kind": "rejection-free"},
        "hold": {"start": "1 ms", "stop": "1e3 s"},
    }
    inferred = ca.infer(DATA, scene=scene, samples=50)
    return {"`infer`": [inferred.samples, inferred.prior, inferred.fitted]}


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    kinds = {**contacts(), **ageing(), **studies()}
    arrays = {f"{name}/{number}": array for name, found in kinds.items() for number, array in enumerate(found)}
    np.savez(sys.argv[1], **arrays)
