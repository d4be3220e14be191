"""A program that uses chemage and that type checkers must accept in their strictest mode; a test runs it."""

# pyright: strict

from __future__ import annotations

import numpy as np

import chemage as ca

tip = ca.surface("sphere", radius="30 nm", pixels=16, pixel_size="1 nm").make()
contact = ca.solve_contact(ca.contact("hertz", modulus="35.3 GPa"), tip, "20 nN")
chemistry = ca.chemistry(forming=ca.barriers("uniform", lower=0.7, upper="0.9 eV"), activation_volume="6 angstrom**3")
times = ca.hold_times("1 ms", "10 s", per_decade=2)
aging = ca.age(contact, chemistry, engine=ca.engine("rejection-free"), hold_times=times, temperature=300, replicas=2)
slope: float = aging.fit("10 ms", "1 s").beta
drop: np.ndarray = aging.mean_friction_drop
units = {name: output.unit for name, output in aging.measured.items()}
last: list[float] = [float(output.values[0]) for output in contact.measured.values()]
run: ca.Run = ca.run(
    {
        "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 16, "pixel_size": "1 nm"},
        "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "20 nN"},
    }
)
pressure: float = run.contact.mean_contact_pressure
words: str = run.approximate
