"""``chemage study tips``: how far contact area explains the friction drop of tips and rough contacts.

Tips of 10 to 100 nm radius (the scene ``silica-tips``) and rough contacts (``silica-patch``) of the same chemistry are
aged at equal nominal pressure and at equal contact area. The number of bonds is then predicted in steps, to quantify
what each explains: from the area alone; from area and mean pressure; from area and distribution of the pressure; and
also from the length of the rim, where sites have fewer neighbours. The effect of pressure is that in uniform periodic
contacts, which have neither a rim nor a distribution.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from chemage import Aging, ContactSolution, Scene, age, parse_scene
from chemage.plugin import FIT_WINDOW, Fit, override, scene_data, statistics

#: strength of the interaction between neighbours, eV: of the single asperities and of the rough contacts of the paper
STRENGTHS = (0.1, 0.5)
#: rms slope -> seeds of the rough surfaces at the nominal pressure of ``silica-patch``
SLOPES = {0.05: (1, 2, 3, 4), 0.1: (1, 2, 3, 4), 0.2: (1, 2, 3, 4)}
#: (radius nm, load nN) of the tips in the comparison at equal area, and seeds of the rough surfaces
EQUAL_AREA = ((50.0, 60.0), (50.0, 400.0), (100.0, 400.0))
EQUAL_AREA_SEEDS = (1, 2, 3, 4, 5, 6)
#: pressures of the uniform contacts, GPa, dense where the bonds increase fastest; the first is practically zero
UNIFORM = (1e-6, *(0.25 * step for step in range(1, 13)), 3.5, 4.0, 5.0, 6.0, 8.0, 10.0, 13.0, 17.0)
UNIFORM_PIXELS, UNIFORM_REPLICAS = 128, 8
#: approximate number of aged sites of each contact, over all replicas
SITES = 100_000
WINDOW = FIT_WINDOW
NOTHING = "nothing (ΔF itself)"
STAGES = (
    "area",
    "area, mean pressure",
    "area, distribution of the pressure",
    "area, distribution of the pressure, rim",
)


@dataclass(frozen=True)
class Aged:
    """One contact of the study, aged."""

    name: str
    #: ``tip``, ``rough`` (equal nominal pressure) or ``equal area``
    group: str
    contact: ContactSolution
    aging: Aging
    #: tip: radius, nm; rough: rms slope
    shape: float
    #: rough contacts at equal area: the tip they match
    partner: str = ""

    @property
    def density(self) -> np.ndarray:
        """Bonds per contact area, mean over replicas, 1/nm², (m,)."""
        return self.aging.bonds.mean(axis=0) / self.contact.area

    @property
    def density_error(self) -> np.ndarray:
        """Standard error of :attr:`density`, 1/nm², (m,)."""
        return statistics.standard_error(self.aging.bonds) / self.contact.area

    def fit(self) -> Fit:
        """Fit a line of Δμ against log t over the window."""
        return self.aging.fit(*WINDOW)

    def at(self, time: float) -> int:
        """Index of the hold time nearest to ``time``."""
        return int(np.argmin(np.abs(np.log(self.aging.hold_times / time))))


@dataclass(frozen=True)
class Collapse:
    """Deviation of the number of bonds from a prediction: the natural logarithm of their ratio."""

    what: str
    #: root mean square over contacts and the hold times in the window
    rms: float
    #: root mean square over contacts at each hold time, (m,)
    at: np.ndarray


@dataclass(frozen=True)
class Study:
    """The results of the study at one strength of the interaction."""

    strength: float
    contacts: list[Aged]
    #: hold times, s, (m,)
    times: np.ndarray
    #: bonds per area of uniform contacts, 1/nm², (pressures, m)
    uniform: np.ndarray
    collapses: list[Collapse] = field(default_factory=list)
    #: contribution of the finite number of replicas to each rms
    noise: float = math.nan
    #: relative change of the number of bonds per C/A, nm, (m,)
    rim: np.ndarray | None = None

    def group(self, name: str) -> list[Aged]:
        """List the contacts of a group."""
        return [aged for aged in self.contacts if aged.group == name]

    def rim_effect(self, time: float) -> float:
        """Relative change of the number of bonds per C/A at the hold time nearest to ``time`` (s), nm."""
        assert self.rim is not None
        return float(self.rim[self.contacts[0].at(time)])


# -- computing --------------------------------------------------------------------------------------------------------


def compute(strength: float, report: Callable[[str, int, int], None], *, quick: bool = False) -> Study:
    """Age every contact of the study and predict the numbers of bonds.

    Parameters
    ----------
    strength
        Strength of the interaction between neighbours, eV.
    report
        Receives (name of the stage, contacts done, contacts in total).
    quick
        Compute a few contacts with a tenth of the replicas only.
    """
    tips = [_scene(data, strength) for data in _tips()]
    patch = _scene(scene_data("silica-patch")[0], strength)
    if any(tip.chemistry != patch.chemistry or tip.hold is None or patch.hold is None for tip in tips):
        raise ValueError("the scenes silica-tips and silica-patch must have the same chemistry")
    slopes = {0.1: (1,)} if quick else SLOPES
    pairs, seeds = (EQUAL_AREA[1:2], (1,)) if quick else (EQUAL_AREA, EQUAL_AREA_SEEDS)
    tips = tips[::3] if quick else tips
    share = 0.1 if quick else 1.0
    jobs = len(tips) + sum(map(len, slopes.values())) + len(pairs) * len(seeds) + len(UNIFORM)
    done = 0

    def count(job: Any) -> Any:
        nonlocal done
        done += 1
        report(f"interaction {strength:g} eV", done, jobs)
        return job

    report(f"interaction {strength:g} eV", 0, jobs)
    contacts = [count(_tip(tip, share)) for tip in tips]
    surfaces: dict[tuple[float, int], Any] = {}
    for slope, numbers in slopes.items():
        for seed in numbers:
            rough = surfaces[slope, seed] = _rough(patch, slope, seed)
            contact = patch.contact.solve(rough, patch.load)
            contacts.append(count(_aged(f"rough {slope:g}, seed {seed}", "rough", contact, patch, slope, share)))
    for radius, load in pairs:
        data = override(_tips()[0], {"surface.radius": radius, "contact.load": load})
        tip = _tip(_scene(data, strength), share)
        if tip.name not in [aged.name for aged in contacts]:
            contacts.append(tip)
        for seed in seeds:
            rough = surfaces.get((0.1, seed)) or _rough(patch, 0.1, seed)
            contact = _pressed_to(patch, rough, tip.contact.sites.size)
            name = f"rough 0.1, seed {seed}, at the area of {tip.name}"
            contacts.append(count(_aged(name, "equal area", contact, patch, 0.1, share, tip.name)))
    uniform = np.stack([count(_uniform(patch, pressure, quick)) for pressure in UNIFORM])
    study = Study(strength, contacts, contacts[0].aging.hold_times, uniform)
    return _explained(study)


def _tips() -> list[dict[str, Any]]:
    data, _ = scene_data("silica-tips")
    sweep = data.pop("sweep")
    return [
        override(data, {"surface.radius": radius, "contact.load": load})
        for radius in sweep["surface.radius"]
        for load in sweep["contact.load"]
    ]


def _scene(data: dict[str, Any], strength: float) -> Scene:
    # before 1 s some of the contacts have no bond at all
    return parse_scene(override(data, {"interaction.strength": strength, "hold.start": "1 s"}))


def _tip(scene: Scene, share: float) -> Aged:
    maker: Any = scene.surface
    contact = scene.contact.solve(maker.make(), scene.load)
    return _aged(f"tip {maker.radius:g} nm, {scene.load:g} nN", "tip", contact, scene, maker.radius, share)


def _rough(patch: Scene, slope: float, seed: int) -> Any:
    return patch.surface.replace(rms_slope=slope).make(seed)


def _pressed_to(patch: Scene, rough: Any, sites: int) -> ContactSolution:
    """Find the rough contact whose number of pixels in contact is closest to ``sites``, by varying the load."""
    load = patch.load * sites / (0.01 * rough.heights.size)
    best: ContactSolution | None = None
    below = above = None
    for _ in range(12):
        contact = patch.contact.solve(rough, load, start=best)
        pixels = contact.sites.size
        if best is None or abs(pixels - sites) < abs(best.sites.size - sites):
            best = contact
        if abs(pixels - sites) <= 0.003 * sites:
            break
        if pixels < sites:
            below = (load, pixels)
        else:
            above = (load, pixels)
        if below is None or above is None:
            load *= 1.02 * sites / max(pixels, 1) if pixels < sites else 0.98 * sites / pixels
        else:  # the area is nearly proportional to the load
            power = math.log(above[0] / below[0]) / math.log(above[1] / below[1])
            load = below[0] * (sites / below[1]) ** power
    assert best is not None
    return best


def _aged(
    name: str, group: str, contact: ContactSolution, scene: Scene, shape: float, share: float, partner: str = ""
) -> Aged:
    replicas = max(8, round(share * SITES / max(contact.sites.size, 1)))
    return Aged(name, group, contact, _age(contact, scene, replicas), shape, partner)


def _age(contact: ContactSolution, scene: Scene, replicas: int) -> Aging:
    chemistry, engine, hold = scene.chemistry, scene.engine, scene.hold
    assert chemistry is not None
    assert engine is not None
    assert hold is not None
    return age(
        contact,
        chemistry,
        engine=engine,
        hold_times=hold.hold_times,
        temperature=hold.temperature,
        replicas=replicas,
        seed=hold.seed,
    )


def _uniform(patch: Scene, pressure: float, quick: bool) -> np.ndarray:
    """Bonds per area of a contact of uniform pressure without a rim, 1/nm², (m,)."""
    maker: Any = patch.surface
    pixels = UNIFORM_PIXELS // 2 if quick else UNIFORM_PIXELS
    contact = ContactSolution(
        pressure=np.full((pixels, pixels), pressure),
        load=pressure * (pixels * maker.pixel_size) ** 2,
        pixel_size=maker.pixel_size,
        modulus=35.3,
        periodic=True,
    )
    return _age(contact, patch, UNIFORM_REPLICAS).bonds.mean(axis=0) / contact.area


# -- predictions ------------------------------------------------------------------------------------------------------


def _explained(study: Study) -> Study:
    density = np.stack([aged.density for aged in study.contacts])
    errors = np.stack([aged.density_error for aged in study.contacts])
    area = np.array([aged.contact.area for aged in study.contacts])
    rim = np.array([aged.contact.perimeter_to_area for aged in study.contacts])
    means = of_pressure(study, np.array([aged.contact.mean_contact_pressure for aged in study.contacts]))
    fields = np.stack([_of_field(study, aged.contact) for aged in study.contacts])
    # a line through zero: without a rim the prediction has no correction
    slope = rim @ (density / fields - 1) / (rim @ rim)
    deviations = {
        NOTHING: np.log(density * area[:, None]),
        STAGES[0]: np.log(density),
        STAGES[1]: np.log(density / means),
        STAGES[2]: np.log(density / fields),
        STAGES[3]: np.log(density / fields / (1 + rim[:, None] * slope)),
    }
    for what in (NOTHING, STAGES[0]):  # here the prediction is the mean curve
        deviations[what] = deviations[what] - deviations[what].mean(axis=0)
    inside = (study.times >= WINDOW[0]) & (study.times <= WINDOW[1])
    collapses = [
        Collapse(what, float(np.sqrt(np.mean(logs[:, inside] ** 2))), np.sqrt(np.mean(logs**2, axis=0)))
        for what, logs in deviations.items()
    ]
    noise = math.sqrt(float(np.mean((errors / density)[:, inside] ** 2)))
    return replace(study, collapses=collapses, rim=slope, noise=noise)


def of_pressure(study: Study, pressure: np.ndarray) -> np.ndarray:
    """Bonds per area at each ``pressure`` (n,) GPa, interpolated between the uniform contacts, 1/nm², (n, m)."""
    return np.stack([np.interp(pressure, UNIFORM, column) for column in study.uniform.T], axis=-1)


def _of_field(study: Study, contact: ContactSolution) -> np.ndarray:
    """Bonds per area of uniform contacts, averaged over the pressures of a contact, 1/nm², (m,)."""
    # the interpolation is linear in the table, so that the weight of each uniform contact is sufficient
    pressure = contact.pressure[contact.contact]
    right = np.clip(np.searchsorted(UNIFORM, pressure), 1, len(UNIFORM) - 1)
    table = np.array(UNIFORM)
    part = np.clip((pressure - table[right - 1]) / (table[right] - table[right - 1]), 0, 1)
    weights = np.bincount(right, part, len(UNIFORM)) + np.bincount(right - 1, 1 - part, len(UNIFORM))
    return weights @ study.uniform / pressure.size


def deviation(study: Study, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Relative deviation of the bonds at ``time`` (s) from the prediction of area and distribution of the pressure.

    Returns
    -------
    tuple
        The deviation of each contact, (n,), and its C/A, 1/nm, (n,).
    """
    at = study.contacts[0].at(time)
    deviations = [aged.density[at] / _of_field(study, aged.contact)[at] - 1 for aged in study.contacts]
    return np.array(deviations), np.array([aged.contact.perimeter_to_area for aged in study.contacts])
