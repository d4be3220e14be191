"""Other codes as contact solvers: imported only where they are chosen, and of one opinion with ``fft-bem``."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import chemage as ca
from chemage import InputError
from chemage.testing import rough_surface

LIBRARIES = {"tamaas": "tamaas", "contactmechanics": "ContactMechanics"}


@pytest.fixture(params=LIBRARIES)
def peer(request) -> str:
    pytest.importorskip(LIBRARIES[request.param])
    return request.param


@pytest.mark.parametrize("kind", LIBRARIES)
def test_a_library_that_is_not_there_is_one_error_with_the_command(kind, monkeypatch):
    monkeypatch.setitem(sys.modules, LIBRARIES[kind], None)
    solver, surface = ca.contact(kind, modulus=35.3), rough_surface()
    for fails in (lambda: solver.solve(surface, 1.0), lambda: solver.check({}, 1.0)):
        with pytest.raises(InputError, match=rf"{LIBRARIES[kind]} is not installed; run: pip .*'chemage\[{kind}\]'"):
            fails()


def test_nothing_is_imported_before_it_is_used():
    code = (
        "import sys, chemage as ca\n"
        "for kind in ('tamaas', 'contactmechanics'): ca.contact(kind, modulus=35.3)\n"
        "assert not {'tamaas', 'ContactMechanics', 'SurfaceTopography'} & set(sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_licence_is_in_the_list_of_plugins(command):
    assert "needs tamaas (AGPL-3.0)" in command("plugins", "list", "--json").out
    assert "AGPL-3.0" in command("plugins", "show", "tamaas").out


@pytest.mark.parametrize("pressure", [0.01, 0.3, 1.5])
def test_the_codes_agree(peer, pressure):
    surface = ca.surface("self-affine", pixels=64, pixel_size=0.5, rms_slope=0.1, hurst=0.8, zeta=16, eta=3).make(1)
    load = pressure * surface.nominal_area
    ours = ca.contact("fft-bem", modulus=35.3, tolerance=1e-10, precision="double").solve(surface, load)
    theirs = ca.contact(peer, modulus=35.3, tolerance=1e-9).solve(surface, load)
    assert np.linalg.norm(theirs.pressure - ours.pressure) < 1e-6 * np.linalg.norm(ours.pressure)
    assert max(theirs.convergence["rms_gap"], theirs.convergence["penetration"]) < 1e-6


def test_pressure_is_limited_by_the_hardness_and_carries_the_load():
    """Where it is between zero and the hardness the bodies touch; where it is zero, they do not overlap."""
    pytest.importorskip("tamaas")
    surface = ca.surface("self-affine", pixels=64, pixel_size=0.5, rms_slope=0.4, hurst=0.8, zeta=16, eta=3).make(1)
    solver = ca.contact("tamaas", modulus=35.3, hardness="3 GPa", tolerance=1e-8)
    found = solver.solve(surface, "0.6 GPa")
    assert found.max_pressure == 3.0
    assert found.carried == pytest.approx(found.load, rel=1e-9)
    assert found.convergence["rms_gap"] < 1e-6
    assert found.convergence["penetration"] < 1e-6
    with pytest.raises(InputError, match=r"hardness = 3.0: the nominal pressure is 4 GPa.*give a hardness above 4 GPa"):
        solver.solve(surface, "4 GPa")


@pytest.mark.parametrize("hardness", ["0.6006 GPa", "0.66 GPa", "3 GPa"])
def test_tamaas_finds_the_same_contact_with_a_hardness(hardness):
    """From where hardly a pixel is free, on."""
    pytest.importorskip("tamaas")
    surface = ca.surface("self-affine", pixels=64, pixel_size=0.5, rms_slope=0.4, hurst=0.8, zeta=16, eta=3).make(1)
    ours, theirs = (
        ca.contact(kind, modulus=35.3, hardness=hardness, tolerance=1e-9).solve(surface, "0.6 GPa")
        for kind in ("fft-bem", "tamaas")
    )
    assert np.linalg.norm(theirs.pressure - ours.pressure) < 1e-5 * np.linalg.norm(ours.pressure)


def test_what_tamaas_cannot_do_is_refused_with_the_remedy():
    pytest.importorskip("tamaas")
    tip = rough_surface(periodic=False)
    solver = ca.contact("tamaas", modulus=35.3)
    for fails in (lambda: solver.solve(tip, 1.0), lambda: solver.check({"periodic": 0.0}, 1.0)):
        with pytest.raises(InputError, match=r"needs a periodic surface.*use contact 'fft-bem'"):
            fails()
    assert solver.replace(boundary="periodic").solve(tip, 1.0).periodic


def test_a_solver_that_gives_up_says_so(peer):
    surface = rough_surface((64, 64))
    with pytest.raises(ca.plugin.ConvergenceError, match="did not reach the tolerance of 1e-12"):
        ca.contact(peer, modulus=35.3, tolerance=1e-12, max_iterations=3).solve(surface, 100.0)
