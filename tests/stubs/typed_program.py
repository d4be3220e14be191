"""A program that type checkers must accept: CI checks it with pyright in a folder elsewhere, as an editor sees an
editable install, and a test runs it."""

from __future__ import annotations

import numpy as np
import pint

import chemage as ca
from chemage_contact import Hertz
from chemage_surfaces import Sphere

units = pint.UnitRegistry()
lengths = (30.0, 30, "30 nm", np.float64(30), np.float32(30), np.int64(30), units.Quantity(30, "nm"))
makers: list[ca.plugin.SurfaceMaker] = [
    ca.surface("sphere", radius=length, pixels=16, pixel_size="1 nm") for length in lengths
]
makers.append(Sphere(radius="30 nm", pixels=16, pixel_size=units.Quantity(1, "nm")))
tip: ca.Surface = makers[0].make()

solver = Hertz(modulus="35.3 GPa")
solver = solver.replace(modulus=units.Quantity(35.3, "GPa"))
loads = (20, "20 nN", np.float32(20), units.Quantity(20, "nN"))
contacts: list[ca.ContactSolution] = [solver.solve(tip, load=load) for load in loads]
stage: ca.ContactSolution = ca.solve_contact(ca.contact("hertz", modulus="35.3 GPa"), tip, units.Quantity(20, "nN"))

chemistry = ca.chemistry(
    forming=ca.barriers("gaussian", mean="0.9 eV", std=units.Quantity(50, "meV")),
    activation_volume="6.4 angstrom**3",
)
times = ca.hold_times("1 ms", units.Quantity(10, "s"), per_decade=2)
ageing: ca.Ageing = ca.age(
    contacts[0],
    chemistry,
    engine=ca.engine("auto"),
    hold_times=times,
    temperature=units.Quantity(27, "degC"),
    replicas=2,
    seed=1,
)
fit: ca.plugin.Fit = ageing.fit("10 ms", units.Quantity(1, "s"))
slope: float = fit.beta
