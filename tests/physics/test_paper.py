"""The reference contact against Li, Pastewka & Szlufarska, Phys. Rev. E 98, 023001 (2018), on one typical surface.

Means over many surfaces are in plugins/chemage_li2018/docs/reproduction.md. The bounds are the paper's value and the
scatter between surfaces.
"""

from functools import cache

import numpy as np
import pytest

import chemage as ca
from chemage import Run


@cache
def contact_at(slope: float) -> ca.ContactSolution:
    scene = ca.load_scene("silica-rough", {"surface.rms_slope": slope})
    return ca.solve_contact(scene.contact, ca.make_surface(scene.surface, scene.surface_seed), scene.load)


@cache
def reference(slope: float, volume: str | float) -> Run:
    scene = ca.load_scene(
        "silica-rough", {"surface.rms_slope": slope, "chemistry.activation_volume": volume, "hold.replicas": 4}
    )
    return ca.run(scene, contact=contact_at(slope))


def test_reference_contact_has_the_papers_measures():
    contact = contact_at(0.1)
    assert 0.0085 < contact.area_fraction < 0.0110
    assert 2.0 < contact.kappa < 2.35
    assert 0.38 < contact.perimeter_to_area < 0.50
    assert 60 <= contact.patches <= 130


def test_reference_beta():
    fit = reference(0.1, "6.4 angstrom**3").fit()
    assert fit is not None
    assert 0.39 < fit.beta < 0.49


@pytest.mark.parametrize(
    ("slope", "volume", "published", "tolerance"),
    [
        pytest.param(0.05, "6.4 angstrom**3", 0.89, 0.15, marks=pytest.mark.long),
        (0.1, "6.4 angstrom**3", 0.45, 0.15),
        pytest.param(0.2, "6.4 angstrom**3", 0.20, 0.15, marks=pytest.mark.long),
        pytest.param(0.05, 0.0, 0.98, 0.20, marks=pytest.mark.long),
        (0.1, 0.0, 0.49, 0.20),
        pytest.param(0.2, 0.0, 0.24, 0.20, marks=pytest.mark.long),
    ],
)
def test_beta_against_slope(slope: float, volume: str | float, published: float, tolerance: float):
    fit = reference(slope, volume).fit()
    assert fit is not None
    assert fit.beta == pytest.approx(published, rel=tolerance)


@pytest.mark.long
def test_roughness_raises_friction_at_a_second_and_lowers_it_at_a_thousand():
    """Fig. 3(b, c): pressure lets few, strongly pressed sites react early; later the area decides."""

    def coefficient(slope: float, volume: str | float, time: float) -> float:
        ageing = reference(slope, volume).ageing
        assert ageing is not None
        return float(ageing.mean_friction_coefficient_drop[np.argmin(np.abs(ageing.hold_times - time))])

    pressed = "6.4 angstrom**3"
    assert coefficient(0.05, pressed, 1.0) < coefficient(0.1, pressed, 1.0) < coefficient(0.2, pressed, 1.0)
    assert coefficient(0.05, pressed, 1e3) > coefficient(0.1, pressed, 1e3) > coefficient(0.2, pressed, 1e3)
    for time in (1.0, 1e3):
        assert coefficient(0.05, 0.0, time) > coefficient(0.1, 0.0, time) > coefficient(0.2, 0.0, time)


@pytest.mark.long
def test_without_activation_volume_friction_follows_the_contact_area():
    """With ΔV = 0 pressure only decides who is in contact: Δμ is proportional to A at all times."""
    ratios = []
    for slope in (0.05, 0.1, 0.2):
        ageing = reference(slope, 0.0).ageing
        assert ageing is not None
        late = ageing.hold_times >= 1.0
        ratios.append(ageing.mean_friction_drop[late] / contact_at(slope).area)
    spread = np.ptp(ratios, axis=0) / np.mean(ratios, axis=0)
    assert spread[-1] < 0.05
    assert spread.max() < 0.25
