"""What a component or a plugin gives is checked at once, and a fault names the one that gave it."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

import chemage as ca
from chemage.plugin import PluginError, hookimpl, registry


def pressed() -> ca.ContactSolution:
    surface = ca.make_surface(ca.surface("sphere", radius="30 nm", pixels=24, pixel_size="0.6 nm"))
    return ca.solve_contact(ca.contact("hertz", modulus="35.3 GPa"), surface, 50)


def silica() -> ca.Chemistry:
    barriers = ca.barriers("uniform", lower=0.7, upper=0.9)
    return ca.chemistry(forming=barriers, site_density="pixel")


def aged() -> ca.Ageing:
    options = {"engine": ca.engine("rejection-free"), "hold_times": [1e-6, 1.0], "temperature": 300, "replicas": 2}
    return ca.age(pressed(), silica(), **options)


def changing(hook: str, change):
    """A plugin that changes what others answer."""

    def wrapper(self):
        return change((yield))

    return type("Changing", (), {hook: hookimpl(wrapper=True)(_named(wrapper, hook))})()


def _named(function, name):
    function.__name__ = name
    return function


def updated(**changes):
    return lambda found: found.model_copy(update={name: change(found) for name, change in changes.items()})


#: hook, what a plugin makes of the answer, what runs it, what is said
FAULTS = {
    "a capped pressure": (
        "chemage_solve_contact",
        updated(pressure=lambda found: np.minimum(found.pressure, 1.0)),
        pressed,
        r"the pressure adds up to [\d.]+ nN, and the load is 50 nN; .* carries",
    ),
    "another load": ("chemage_solve_contact", updated(load=lambda found: 40.0), pressed, "but 50 nN were asked for"),
    "other pixels": (
        "chemage_solve_contact",
        updated(pixel_size=lambda found: 1.2),
        pressed,
        "pixel_size is 1.2, but that of the surface is 0.6",
    ),
    "repeats": ("chemage_solve_contact", updated(periodic=lambda found: True), pressed, "periodic is True, but"),
    "another slope": ("chemage_solve_contact", updated(rms_slope=lambda found: 9.0), pressed, "rms_slope is 9, but"),
    "a periodic tip": ("chemage_make_surface", updated(periodic=lambda found: True), pressed, "periodic=False"),
    "pixels of another size": (
        "chemage_build_lattice",
        updated(pixel_size=lambda found: 2 * found.pixel_size),
        aged,
        "pixel_size is 1.2 nm, but that of the contact is 0.6 nm",
    ),
    "more bonds": (
        "chemage_run_kinetics",
        updated(bonds=lambda found: found.bonds + 1),
        aged,
        r"bonds\[-1\] = \d+, but \d+ sites are bonded",
    ),
    "bonds that nobody formed": (
        "chemage_run_kinetics",
        updated(formed=lambda found: found.formed + 3),
        aged,
        "less broken",
    ),
    "other hold times": (
        "chemage_run_kinetics",
        updated(hold_times=lambda found: 2 * found.hold_times, time=lambda found: 2 * found.time),
        aged,
        "not those of the run, 1e-06, 1 s",
    ),
    "warm": ("chemage_run_kinetics", updated(temperature=lambda found: 310.0), aged, "the run is at 300 K"),
    "a force that pushes": ("chemage_rupture_bonds", lambda force: force - 1e6, aged, "gave a negative force"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_a_hook_changes_is_checked_and_the_plugin_named(name):
    hook, change, run, said = FAULTS[name]
    with registry.using(registry.Registry()) as installed:
        installed.register(changing(hook, lambda found: found), "idle")
        installed.register(changing(hook, change), "guilty")
        with pytest.raises(PluginError, match=rf"^plugin 'guilty' \(Changing\): {hook}: .*{said}"):
            run()


def test_a_fault_of_the_component_names_it_and_not_the_plugin_around_it():
    class Halved(ca.plugin.ContactSolver):
        """Half of the load is lost."""

        kind = "halved"

        def _solve(self, surface, load, start):
            found = ca.contact("hertz", modulus=35.3).solve(surface, load)
            return found.model_copy(update={"pressure": 0.5 * found.pressure})

    surface = ca.make_surface(ca.surface("sphere", radius="30 nm", pixels=24, pixel_size="0.6 nm"))
    with registry.using(registry.Registry()) as installed:
        installed.register(changing("chemage_solve_contact", lambda found: found), "idle")
        with pytest.raises(PluginError, match=r"^contact 'halved' of .*Halved \(source .*25 nN.*50 nN"):
            ca.solve_contact(Halved(), surface, 50)


def test_a_contact_that_says_that_it_does_not_carry_its_load_says_so_everywhere(tmp_path, command):
    fields = {"pressure": lambda found: np.minimum(found.pressure, 1.0), "carries": lambda found: "it yields at 1 GPa"}
    with registry.using(registry.Registry()) as installed:
        installed.register(changing("chemage_solve_contact", updated(**fields)), "plastic")
        run = ca.run(
            {
                "name": "tip",
                "surface": {"kind": "sphere", "radius": "30 nm", "pixels": 24, "pixel_size": "0.6 nm"},
                "contact": {"kind": "hertz", "modulus": "35.3 GPa", "load": "50 nN"},
                "forming": {"kind": "uniform", "lower": 0.7, "upper": 0.9},
                "engine": {"kind": "independent"},
                "hold": {"start": "1 ms", "stop": "1 s", "replicas": 2},
            }
        )
        assert run.contact.mean_contact_pressure <= run.contact.max_pressure == 1.0
        words = f"hertz (carries {run.contact.carried:.4g} of 50 nN: it yields at 1 GPa)"
        assert words in run.approximate
        for name in ("a.h5", "b.h5"):
            ca.write(tmp_path / name, run)
        assert ca.read(tmp_path / "a.h5").contact.carries == "it yields at 1 GPa"
        for line in ("show a.h5", "compare a.h5 b.h5", "show a.h5 --json"):
            told = command(*(str(tmp_path / word) if word.endswith(".h5") else word for word in line.split()))
            assert words in re.sub(r"\s+", " ", told.out), line
        assert words in json.loads(told.out)["approximate"]
