"""What is doubtful or hopeless about a scene, found before anything is computed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from chemage.ageing.elasticity import NOTED
from chemage.ageing.fitting import why_not_fitted
from chemage.ageing.hold_times import within
from chemage.foundation.components import Component
from chemage.foundation.units import KB, unit_of
from chemage.lattices.independent import expected_kinetics, rough_pressures
from chemage.scene.cost import Cost
from chemage.scene.limits import check_parts, long_run
from chemage.scene.scene import Scene
from chemage.scene.sections import nested, sections

#: rms slopes of surfaces: beyond these heights or pixels are likely in another unit than they are said to be
SLOPES = (1e-6, 3.0)
#: sizes that quantities have, whatever the option is called: unit -> (least, most, what they are, a remedy); 0 is fine
USUAL: dict[str, tuple[float, float, str, str]] = {
    "nm": (1e-3, 1e9, "lengths in contacts are between picometres and a metre", 'such as "0.45 nm" or "10 um"'),
    "GPa": (1e-9, 2000.0, "moduli and strengths of solids are between 1 Pa and 2000 GPa", 'such as "35.3 GPa"'),
    "Hz": (1e8, 1e16, "attempt frequencies are those of atoms, 1e12 to 1e14 Hz", 'such as "10 THz"'),
    "nm**3": (0.0, 1.0, "activation volumes are a few atoms, 0.001 to 0.1 nm³", 'such as "6.4 angstrom**3"'),
    "eV": (0.0, 20.0, "barriers of bonds are 0.1 to 5 eV", 'such as "0.8 eV"'),
    "1/nm**2": (1e-6, 100.0, "surfaces have some sites per nm²", 'such as "4.9 /nm**2"'),
}
#: forces of one bond, nN
BOND_FORCES = (1e-3, 100.0)
#: sites, and bonds of all replicas together, below which a scene gives no number
NO_SITE, NO_BOND = 1.0, 1.0
#: below this temperature one in °C may be meant
COLD = 150.0
ZERO_CELSIUS = 273.15


class Doubt(NamedTuple):
    """One thing to warn of: ``kind`` is the same for the same doubt at every point of a sweep."""

    kind: str
    text: str


def doubts(scene: Scene, known: Cost) -> list[Doubt]:
    """Everything to warn of before ``scene`` runs, of which ``known`` are the estimates.

    Raises
    ------
    InputError
        A part of the scene would refuse it during the run.
    """
    found = [Doubt("parts", text) for text in check_parts(scene, known)]
    if text := long_run(scene, known):
        found.insert(0, Doubt("long", text))
    for check in (_units, _surface, _contact, _pressure, _times, _bonds):
        found += check(scene, known)
    return found


def _units(scene: Scene, known: Cost) -> Iterator[Doubt]:
    """Quantities of a size that nothing has."""
    parts = dict(sections(scene))
    if scene.chemistry is not None:
        parts["chemistry"] = scene.chemistry
    seen: set[str] = set()
    for name, part in parts.items():
        for path, component in nested(part, name):
            section = path.removeprefix("chemistry.")  # its components are sections of their own
            if section not in seen:
                seen.add(section)
                yield from _unusual(section, component)


def _unusual(path: str, component: Component) -> Iterator[Doubt]:
    for name, info in type(component).model_fields.items():
        value, unit = getattr(component, name), unit_of(info)
        if isinstance(value, bool) or not isinstance(value, int | float) or not value:
            continue
        if unit == "nN" and path == "chemistry":
            least, most, usual, such = *BOND_FORCES, "bonds break at some nN", 'such as "3 nN"'
        elif unit in USUAL:
            least, most, usual, such = USUAL[unit]
        else:
            continue
        if not least <= abs(value) <= most:
            text = f"{usual}; a bare number is in {unit}, give another unit as text, {such}"
            yield Doubt(f"unit of {path}.{name}", f"{path}.{name} = {value:g} {unit}: {text}")
        elif unit == "eV" and value < 0 and component.role == "barriers":
            yield Doubt(f"unit of {path}.{name}", f"{path}.{name} = {value:g} eV: a barrier is not negative")


def _surface(scene: Scene, known: Cost) -> Iterator[Doubt]:
    slope = known.surface.get("rms_slope")
    if slope is not None and slope > 0 and not SLOPES[0] <= slope <= SLOPES[1]:
        yield Doubt(
            "slope",
            f"the heights of the surface imply an rms slope of {slope:.2g} on pixels of "
            f"{known.surface.get('pixel_size', math.nan):g} nm, and rough surfaces have 0.001 to 1: are heights and "
            "pixels in nm? A file may be in metres or micrometres: give height_unit and pixel_size with their units",
        )
    wave, pixel = known.surface.get("shortest_wavelength"), known.surface.get("pixel_size")
    if wave and pixel and wave < 8 * pixel:
        yield Doubt(
            "wavelength",
            f"the shortest wavelength is {wave / pixel:.1f} pixels; pixel-scale errors of the contact area and "
            "pressure grow below about 8, compare with more pixels at the same size",
        )


def _contact(scene: Scene, known: Cost) -> Iterator[Doubt]:
    if scene.load == 0:
        yield Doubt("load", "the load is 0: nothing touches, the friction drop is 0 and its coefficient undefined")
        return
    pixels = known.area_fraction * known.pixels if known.area_fraction is not None and known.pixels else math.inf
    sites, where = (pixels, "pixels") if pixels < NO_SITE or known.sites is None else (known.sites, "sites")
    if sites < NO_SITE:
        cause = ""
        if (size := known.surface.get("pixel_size")) and known.area_fraction:
            area = known.area_fraction * known.pixels * size**2
            cause = f": the contact area is about {area:.2g} nm², and a pixel {size * size:.2g} nm²"
        yield Doubt(
            "sites",
            f"about {sites:.1g} {where} will be in contact{cause}; no number of this scene will mean anything. Is "
            f'load = {scene.load:g} nN meant? A bare number is in nN; give another unit as text, such as "20 uN", or '
            "use smaller pixels",
        )
    elif known.sites is not None and known.sites < 100:
        yield Doubt(
            "sites", f"only about {known.sites:.0f} sites will be in contact; averages need many replicas or seeds"
        )
    if (known.area_fraction or 0.0) > 0.95:
        yield Doubt("area", "the contact is expected to be nearly full")


def _pressure(scene: Scene, known: Cost) -> Iterator[Doubt]:
    limits = scene.chemistry.given_limits() if scene.chemistry is not None else {}
    hardness, mean = limits.get("hardness"), known.mean_pressure
    if hardness is None or mean is None:
        return
    ratio = hardness / mean
    # Hertz: p0 = 3/2 of the mean; rough: a Rayleigh distribution
    share = max(1 - (ratio / 1.5) ** 2, 0.0) if "radius" in known.surface else math.exp(-math.pi / 4 * ratio**2)
    if share > NOTED or mean > hardness:
        yield Doubt(
            "hardness",
            f"the mean contact pressure is expected to be {mean:.3g} GPa, with {100 * share:.0f} % of the contact area "
            f"above the hardness of {hardness:g} GPa, where the material would flow: use a smaller load or rms slope, "
            "or check modulus and hardness",
        )


def _times(scene: Scene, known: Cost) -> Iterator[Doubt]:
    hold = scene.hold
    if hold is None or scene.chemistry is None or not scene.ages:
        return
    if reason := why_not_fitted(hold.hold_times, (scene.fit.start, scene.fit.stop)):
        yield Doubt("fit", f"beta will not be fitted: {reason}")
        return
    inside = within(hold.hold_times, (scene.fit.start, scene.fit.stop))
    if np.count_nonzero(inside) < 3:
        yield Doubt(
            "fit", f"only {np.count_nonzero(inside)} hold times lie in the fit window; beta will be poor or absent"
        )


def _bonds(scene: Scene, known: Cost) -> Iterator[Doubt]:
    """Hold times and temperature beside the barriers."""
    chemistry, hold = scene.chemistry, scene.hold
    if chemistry is None or hold is None or not scene.ages:
        return
    times, nu = hold.hold_times, chemistry.attempt_frequency
    lowest, median, highest = chemistry.forming.quantile(np.array([0.05, 0.5, 0.95]))
    active = KB * hold.temperature * np.log(max(nu * times[-1], 1.0))
    if median < 0:
        yield Doubt("barriers", f"half of the forming barriers are below {median:.3g} eV: no barrier is left to cross")
    if known.bonded is not None and known.sites is not None and times[-1] > 0 and scene.load > 0:
        bonds = known.bonded * known.sites * hold.replicas
        if bonds < NO_BOND and known.sites >= NO_SITE:
            yield Doubt("bonds", _no_bond(scene, known, bonds, active, float(lowest)))
            return
    if active < lowest:
        yield Doubt(
            "bonds",
            f"by {times[-1]:g} s only barriers up to {active:.2f} eV react, below 95 % of the forming barriers"
            + _celsius(scene, known),
        )
    elif KB * hold.temperature * np.log(max(nu * max(times[0], 1e-300), 1.0)) > highest:
        yield Doubt("bonds", f"at {times[0]:g} s nearly every forming barrier is already crossed; start earlier")


def _no_bond(scene: Scene, known: Cost, bonds: float, active: float, lowest: float) -> str:
    assert scene.hold is not None
    where = f"at {scene.hold.temperature:g} K and {scene.hold.hold_times[-1]:g} s"
    few = f"{bonds:.1g}" if bonds > 1e-3 else "none"
    text = f"no bond is expected {where}, {few} in all replicas together"
    if active < lowest:
        why = f": barriers up to {active:.2f} eV react, and 95 % of the forming barriers are above {lowest:.2f} eV"
        return text + why + _celsius(scene, known)
    return text + ": bonds break sooner than they form, or few sites are reactive"


def _celsius(scene: Scene, known: Cost) -> str:
    """A question about the unit of the temperature, where in °C it would make sense."""
    chemistry, hold = scene.chemistry, scene.hold
    if chemistry is None or hold is None or hold.temperature >= COLD or not known.mean_pressure:
        return ""
    warm = hold.temperature + ZERO_CELSIUS
    found = expected_kinetics(chemistry, rough_pressures(known.mean_pressure), float(hold.hold_times[-1]), warm)
    if found.bonded < 1e-3:
        return ""
    return f'; is {hold.temperature:g} °C meant? Write temperature = "{hold.temperature:g} degC", which is {warm:g} K'
