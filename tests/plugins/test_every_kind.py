"""Every installed kind of every role keeps the promises of its role."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import ase.io
import h5py
import instrument_files
import numpy as np
import pytest
from ase.build import fcc100
from made_inference import made_inference

import chemage as ca
from chemage import Surface
from chemage.plugin import registry
from chemage.testing import CheckFailed, checks_for, rough_surface

FILES = Path(tempfile.mkdtemp(prefix="chemage-readers-"))
atexit.register(shutil.rmtree, FILES, ignore_errors=True)
MAP = Surface(heights=rough_surface((9, 7)).heights, pixel_size=0.5, periodic=False)
np.save(FILES / "map.npy", rough_surface((9, 7)).heights)
np.savetxt(FILES / "map.txt", rough_surface((9, 7)).heights, header="pixel_size = 0.5 nm")
with h5py.File(FILES / "map.h5", "w") as file:
    file["heights"] = rough_surface((9, 7)).heights
    file["heights"].attrs["pixel_size"] = 0.5
np.savetxt(FILES / "wide.txt", rough_surface((32, 32)).heights, header="pixel_size = 2 nm")
ROUGH = {"kind": "self-affine", "pixels": 64, "pixel_size": 2, "rms_slope": 0.1, "hurst": 0.8, "zeta": 32}
BELOW = {"kind": "from-file", "path": str(FILES / "part.txt")}
BALL = {"kind": "sphere", "radius": "300 nm", "pixels": 24, "pixel_size": 2}
PART = {"kind": "measured", "path": str(FILES / "part.txt"), "height_unit": "nm"}
rough = registry.current().fromdict("surface", ROUGH).make(1).heights
np.savetxt(FILES / "part.txt", rough[:40, :40], header="pixel_size = 2 nm")
ca.write(FILES / "inferred.h5", made_inference())
COPPER = fcc100("Cu", (2, 2, 3), vacuum=5, periodic=True)
COPPER.info = {}
ase.io.write(FILES / "copper.extxyz", COPPER)
# images of other programs
POINTS = np.indices((9, 7)).reshape(2, -1) * 0.5
np.savetxt(FILES / "map.xyz", np.column_stack([*POINTS, rough_surface((9, 7)).heights.ravel()]))
METRES = rough_surface((9, 7)).heights * 1e-9
for ending, content in (
    ("gwy", instrument_files.gwy(METRES, side=5e-10)),
    ("x3p", instrument_files.x3p(METRES, sides=(5e-10, 5e-10))),
    ("cdf", instrument_files.netcdf(METRES, side=5e-10)),
    ("sdf", instrument_files.sdf(METRES, (5e-10, 5e-10))),
):
    (FILES / f"map.{ending}").write_bytes(content)

#: (role, kind) -> options of the choices to check, and what their checks need from outside
CASES: dict[tuple[str, str], list[dict[str, Any]]] = {
    ("surface", "self-affine"): [
        {"pixels": 48, "pixel_size": "0.5 nm", "rms_slope": 0.1, "hurst": 0.8, "zeta": 12, "eta": 3},
        {"pixels": [33, 21], "pixel_size": 0.5, "rms_height": "1 nm", "hurst": 0.5, "zeta": 8, "eta": 1},
    ],
    ("surface", "sphere"): [{"radius": "30 nm", "pixels": 48, "pixel_size": 0.5}],
    ("surface", "spherical-cap"): [{"radius": "30 nm", "pixels": 48, "pixel_size": 0.5}],
    ("surface", "cone"): [{"radius": "5 nm", "half_angle": "70 deg", "pixels": [48, 33], "pixel_size": 0.5}],
    ("surface", "tip"): [
        {"body": BALL},
        {"body": BALL, "own_roughness": ROUGH, "counterface": ROUGH, "place": [64, "50 nm"]},
        {
            "body": BALL,
            "own_roughness": ROUGH,
            "roughness_seed": 4,
            "counterface": {"kind": "from-file", "path": str(FILES / "part.txt")},
        },
    ],
    ("surface", "from-file"): [
        {"path": str(FILES / "map.txt")},
        {"path": str(FILES / "map.npy"), "pixel_size": 0.5, "reader": "npy", "detrend": "plane"},
    ],
    ("surface", "measured"): [
        {"path": str(FILES / "map.txt"), "height_unit": "nm", "detrend": "quadratic"},
        {"path": str(FILES / "wide.txt"), "height_unit": 1, "crop": [2, 4, 30, 40], "resample": 3, "window": "mirror"},
    ],
    ("surface", "atoms"): [
        {"file": str(FILES / "copper.extxyz"), "resolution": "0.04 nm", "sites": "Cu"},
        {"atoms": COPPER[:8], "resolution": 0.06, "probe_radius": "1 angstrom", "radii": "covalent"},
    ],
    ("surface", "roughened"): [
        {"surface": ROUGH, "pixel_size": 0.5, "hurst": 0.8, "fit_from": 40},
        {"surface": PART, "pixel_size": 0.8, "hurst": 0.8, "fit_from": 40, "resolution": 5},
    ],
    ("contact", "fft-bem"): [{"modulus": "35.3 GPa"}, {"modulus": 35.3, "tolerance": 1e-7, "gap": True}],
    ("contact", "hertz"): [{"modulus": "35.3 GPa"}],
    ("contact", "tamaas"): [{"modulus": "35.3 GPa"}, {"modulus": 35.3, "hardness": "10 GPa"}],
    ("contact", "contactmechanics"): [{"modulus": "35.3 GPa"}],
    ("contact", "adhesive-bem"): [
        {"modulus": 35.3, "work_of_adhesion": "50 mJ/m^2", "range": 0.3},
        {"modulus": 35.3, "work_of_adhesion": 0.05, "range": 0.3, "law": "dugdale", "start": "contact"},
    ],
    ("contact", "jkr"): [{"modulus": "35.3 GPa", "work_of_adhesion": "50 mJ/m^2"}],
    ("contact", "dmt"): [{"modulus": "35.3 GPa", "work_of_adhesion": "50 mJ/m^2"}],
    ("contact", "maugis"): [{"modulus": "35.3 GPa", "work_of_adhesion": 0.05, "range": 0.2}],
    ("contact", "persson"): [{"modulus": "35.3 GPa"}, {"modulus": 35.3, "kappa": 2.1}],
    ("barriers", "gaussian"): [
        {"mean": "1.1 eV", "std": "0.02 eV"},
        {"mean": 1.1, "std": 0.1, "lower": 1.0, "upper": 1.15},
        {"mean": 1.1, "std": 0},
    ],
    ("barriers", "uniform"): [{"lower": "0.8 eV", "upper": 1.4}],
    ("barriers", "md-silica"): [{}, {"member": 15}],
    ("barriers", "tabulated"): [
        {"energies": [0.8, 1.0, 1.1, 1.4], "weights": [0, 2, 3, 0]},
        {"samples": [0.85, 0.9, 1.0, 1.04, 1.3]},
    ],
    ("barriers", "inferred"): [{"path": str(FILES / "inferred.h5")}, {"path": str(FILES / "inferred.h5"), "member": 3}],
    ("interaction", "elastic-pairs"): [{"strength": "0.5 eV", "bias": 0.1}],
    ("engine", "rejection-free"): [{}],
    ("engine", "bkl"): [{}],
    ("engine", "next-reaction"): [{}],
    ("engine", "independent"): [{}],
    ("engine", "many-states"): [{}],
    ("engine", "auto"): [{}],
    ("ageing", "closure"): [{}],
    ("protocol", "steps"): [{"step": [{"duration": 1}, {"speed": 3, "distance": 2}]}],
    ("protocol", "slide-hold-slide"): [{"speed": 10, "distance": 3, "holds": [1, 10]}],
    ("protocol", "velocity-steps"): [{"speeds": [10, 100], "distance": 3}],
    ("protocol", "load-steps"): [{"loads": [50, "10 MPa"], "durations": [1, 2]}],
    ("protocol", "heating"): [{"temperatures": [300, 310], "duration": 1}],
    ("protocol", "creep"): [{"duration": 10, "rate": 0.02, "contacts": 3}],
    ("ageing", "sample"): [{"share": 0.3, "window": 4}],
    ("pulling", "event-driven"): [{}],
    ("rupture", "pulled"): [
        {"speed": 1e3, "bond_stiffness": 10, "transition_distance": 0.03, "distance": 0.6, "points": 20},
        {"speed": 1e5, "spring": 50, "friction": 2, "bond_stiffness": 5, "transition_distance": 0.05, "distance": 2},
    ],
    ("rupture", "bell"): [{"transition_distance": 0.05, "speed": 1e3, "stiffness": 10}],
    ("rupture", "dudko-hummer-szabo"): [
        {"transition_distance": 0.03, "loading_rate": 1e3, "shape": shape} for shape in ("cusp", "cubic", "constant")
    ],
    ("rupture", "friddle"): [{"transition_distance": 0.03, "loading_rate": 1e3, "front_factor": 0.5}],
    ("rupture", "mean-force"): [{}, {"bond_force": "100 pN", "front_factor": 0.15}],
    ("observable", "barrier-spectrum"): [{}, {"lower": "0.9 eV", "upper": 1.2, "bins": 7}],
    ("observable", "pressure-spectrum"): [{}, {"upper": "1 GPa", "bins": 7}],
    ("reader", "npy"): [{"pixel_size": 0.5}],
    ("reader", "text"): [{}],
    ("reader", "hdf5"): [{}],
    ("reader", "gwy"): [{}],
    ("reader", "x3p"): [{}],
    ("reader", "netcdf"): [{}],
    ("reader", "xyz"): [{"unit": "nm"}],
    ("reader", "topography"): [{}],
}
#: kinds that need an optional library
OPTIONAL = {
    ("reader", "topography"): "SurfaceTopography",
    ("contact", "tamaas"): "tamaas",
    ("contact", "contactmechanics"): "ContactMechanics",
}
for absent in [kind for kind, library in OPTIONAL.items() if find_spec(library) is None]:
    del CASES[absent]

INPUTS: dict[tuple[str, str], dict[str, Any]] = {
    ("reader", kind): {"path": FILES / f"map.{ending}", "surface": MAP}
    for kind, ending in (
        *(("npy", "npy"), ("text", "txt"), ("hdf5", "h5"), ("gwy", "gwy"), ("x3p", "x3p"), ("netcdf", "cdf")),
        *(("xyz", "xyz"), ("topography", "sdf")),
    )
}

#: (role, kind, check) -> why it cannot hold
EXPECTED_FAILURES: dict[tuple[str, str, str], str] = {
    ("surface", "roughened", "lengths_scale_together"): "the lengths of the surface inside are not among its options",
}


#: (role, kind, number) of options of which others are checked at once, or their parts are
SECOND = {
    ("surface", "roughened", 0),
    ("surface", "roughened", 1),
    ("contact", "adhesive-bem", 0),
    # the kinetics of these is compared with the master equation elsewhere too
    ("engine", "bkl", 0),
    ("engine", "next-reaction", 0),
    ("engine", "many-states", 0),
    ("contact", "fft-bem", 1),
    # as jkr and dmt, and closure
    ("contact", "maugis", 0),
    ("ageing", "sample", 0),
    ("observable", "barrier-spectrum", 1),
    ("rupture", "pulled", 0),
    ("rupture", "pulled", 1),
    ("rupture", "dudko-hummer-szabo", 1),
    ("rupture", "dudko-hummer-szabo", 2),
}

#: checks of engines that take longest; `auto` runs one of the others
LONGEST = {
    "going_on_keeps_the_rates",
    "barrierless_is_the_attempt_frequency",
    "one_site_is_the_closed_form",
    "rates_follow_the_temperature",
}
OTHERS = {
    "coupled_sites_are_refused_or_right",
    "barriers_end_at_zero",
    "sites_keep_their_own_rates",
    "rates_follow_the_attempt_frequency",
    "empty_slots_are_skipped",
    "start_is_taken",
    "options_keep_the_rates",
}
SLOW = {
    "rejection-free": LONGEST | {"options_keep_the_rates"},
    "bkl": LONGEST,
    "next-reaction": LONGEST | {"options_keep_the_rates", "history_adds_up"},
    "independent": LONGEST,
    "many-states": LONGEST,
    "auto": LONGEST | OTHERS,
}


def own_kinds() -> set[tuple[str, str]]:
    """(role, kind) of the distribution chemage; what else is installed here is not this project's to test."""
    return {
        (role, kind)
        for record in registry.current().records
        if record.distribution == "chemage"
        for role, kinds in record.kinds.items()
        for kind in kinds
    }


def cases(slow: bool) -> list[Any]:
    """Every kind with its options; ``slow``: those with checks that take longest."""

    def marks(role: str, kind: str, number: int) -> list[pytest.MarkDecorator]:
        if (slow and kind in ("auto", "next-reaction")) or (kind, number) == ("adhesive-bem", 1):
            return [pytest.mark.campaign]
        return [pytest.mark.long] if (role, kind, number) in SECOND else []

    return [
        pytest.param(role, kind, options, id=f"{role}-{kind}-{number}", marks=marks(role, kind, number))
        for (role, kind), alternatives in CASES.items()
        for number, options in enumerate(alternatives)
        if not slow or (role == "engine" and SLOW[kind])
    ]


def run_checks(role: str, kind: str, options: dict[str, Any], slow: bool) -> None:
    """Run the checks that take longest, or all others; those expected to fail must."""
    component, problems = registry.current().make(role, kind, options), []
    for check in checks_for(component, **INPUTS.get((role, kind), {})):
        if (role == "engine" and check.name in SLOW[kind]) == slow:
            try:
                check(component)
                failure = ""
            except CheckFailed as error:
                failure = str(error)
            if bool(failure) != ((role, kind, check.name) in EXPECTED_FAILURES):
                problems.append(failure or f"{check.name} does not fail any more")
    assert not problems, "\n".join(problems)


@pytest.mark.parametrize(("role", "kind", "options"), cases(slow=False))
def test_keeps_its_promises(role, kind, options):
    run_checks(role, kind, options, slow=False)


@pytest.mark.long
@pytest.mark.parametrize(("role", "kind", "options"), cases(slow=True))
def test_keeps_the_promises_that_take_longest(role, kind, options):
    run_checks(role, kind, options, slow=True)


def test_every_installed_kind_is_checked():
    assert own_kinds() - set(CASES) <= set(OPTIONAL)
    assert set(CASES) <= own_kinds()


def test_every_role_has_a_kind():
    for role in registry.current().roles:
        assert registry.current().kinds(role), f"no {role} is installed"


def test_nothing_is_broken():
    assert registry.current().check() == []


def test_expected_failures_name_checks_that_exist():
    for role, kind, check in EXPECTED_FAILURES:
        assert (role, kind) in CASES
        assert check in {one.name for one in checks_for(registry.current().role(role))}
