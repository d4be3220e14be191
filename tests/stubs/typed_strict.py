"""A program that uses a component of every role and that type checkers must accept in their strictest mode; a test runs
it."""

# pyright: strict

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import chemage as ca
from chemage.plugin import Drive, PullHistory, Reader, pull, reader_for

tip = ca.surface("sphere", radius="30 nm", pixels=16, pixel_size="1 nm").make()
contact = ca.solve_contact(ca.contact("hertz", modulus="35.3 GPa"), tip, "20 nN")
chemistry = ca.chemistry(forming=ca.barriers("uniform", lower=0.7, upper="0.9 eV"), activation_volume="6 angstrom**3")
times = ca.hold_times("1 ms", "10 s", per_decade=2)
ageing = ca.age(contact, chemistry, engine=ca.engine("rejection-free"), hold_times=times, temperature=300, replicas=2)
slope: float = ageing.fit("10 ms", "1 s").beta
drop: np.ndarray = ageing.mean_friction_drop
units = {name: output.unit for name, output in ageing.measured.items()}
last: list[float] = [float(output.values[0]) for output in contact.measured.values()]
run: ca.Run = ca.run(
    {
        "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 16, "pixel_size": "1 nm"},
        "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "20 nN"},
    }
)
pressure: float = run.contact.mean_contact_pressure
words: str = run.approximate

chemistry = chemistry.replace(
    breaking=ca.barriers("gaussian", mean="1.1 eV", std=0.02),
    interaction=ca.interaction("elastic-pairs", strength="5 meV"),
)
with_roles = ca.age(
    contact,
    chemistry,
    engine=ca.engine("bkl"),
    hold_times=times,
    temperature="300 K",
    replicas=2,
    rupture=ca.rupture("bell", transition_distance="0.05 nm", speed="1 um/s", stiffness="10 nN/nm"),
    observe=[ca.observable("barrier-spectrum", bins=4)],
)
spectra: list[np.ndarray] = list(with_roles.observables.values())
sampled: ca.Ageing = ca.age(
    contact,
    chemistry,
    engine=ca.engine("auto"),
    hold_times=times,
    temperature="300 K",
    replicas=2,
    method=ca.ageing_method("sample", share=0.5, window=4),
)
lattice = chemistry.on(contact)
drive = Drive(speed="1 um/s", bond_stiffness="10 nN/nm", transition_distance=0.03, partner="kept")
start = np.ones(lattice.sites.size, dtype=bool)
pulled: PullHistory = pull(
    ca.pulling("event-driven"), lattice, drive, [0.0, 1e-4], temperature=300, start=start, chemistry=chemistry
)
peak: float = pulled.peak
with tempfile.TemporaryDirectory() as folder:
    file = Path(folder, "heights.npy")
    np.save(file, tip.heights)
    reader: Reader = reader_for(file)
    again: ca.Surface = ca.surface("from-file", path=str(file), reader=reader, pixel_size="1 nm").make()
