"""Where the elastic model ends: pressures above the hardness, and the shear stress that the bonds carry.

The contact is elastic at any pressure, and its bonds carry any shear stress. The options ``hardness`` and
``shear_strength`` of the chemistry say where the material would yield; they change no bond.
"""

from __future__ import annotations

import math

from chemage.ageing.aging import Aging
from chemage.contacts.solution import Contact
from chemage.lattices.chemistry import Chemistry

#: what is reported, where it is known: name -> (unit, meaning)
MEASURES: dict[str, tuple[str, str]] = {
    "hardness": ("GPa", "hardness of the material"),
    "area_above_hardness": ("1", "share of the contact area whose pressure is above the hardness"),
    "load_above_hardness": ("1", "share of the load carried where the pressure is above the hardness"),
    "mean_shear_stress": (
        "GPa",
        "friction drop at the last hold time over the area of the sites in contact, mean over replicas",
    ),
    "shear_strength": ("GPa", "shear strength of the material"),
    "shear_stress_to_strength": ("1", "mean shear stress over shear strength"),
}
#: a share of area or load, or a ratio of stress to strength, above this is noted
NOTED = 0.05


def compared(contact: Contact, chemistry: Chemistry) -> dict[str, float]:
    """The limits that ``chemistry`` gives, and the shares of area and load of ``contact`` above the hardness.

    This is what :attr:`Aging.elasticity` stores; it is empty where no limit is given.
    """
    limits = chemistry.given_limits()
    if "hardness" in limits:
        area, load = contact.above(limits["hardness"])
        if math.isfinite(area) and math.isfinite(load):
            limits |= {"area_above_hardness": area, "load_above_hardness": load}
    return limits


def compared_again(aging: Aging, contact: Contact, chemistry: Chemistry) -> Aging:
    """``aging``, which took place on ``contact``, compared with the limits of ``chemistry`` instead of its own."""
    return aging.model_copy(update={"elasticity": compared(contact, chemistry)})


def elastic_measures(aging: Aging | None) -> dict[str, float]:
    """Those of :data:`MEASURES` that are known of a result; none without ageing."""
    if aging is None:
        return {}
    measures = dict(aging.elasticity)
    if math.isfinite(stress := aging.mean_shear_stress):
        measures["mean_shear_stress"] = stress
        if "shear_strength" in measures:
            measures["shear_stress_to_strength"] = stress / measures["shear_strength"]
    return {name: measures[name] for name in MEASURES if name in measures}


def elastic_rows(aging: Aging | None) -> list[tuple[str, str]]:
    """The rows of a printed table: (quantity, text)."""
    measures = elastic_measures(aging)
    rows = []
    if "area_above_hardness" in measures:
        area, load = _percent(measures["area_above_hardness"]), _percent(measures["load_above_hardness"])
        rows.append(
            (f"above the hardness of {measures['hardness']:g} GPa", f"{area} of the contact area, {load} of the load")
        )
    if aging is not None and "mean_shear_stress" in measures:
        text = f"{measures['mean_shear_stress']:.4g} GPa"
        if "shear_strength" in measures:
            share = _percent(measures["shear_stress_to_strength"])
            text += f", {share} of the shear strength of {measures['shear_strength']:g} GPa"
        rows.append((f"mean shear stress at {aging.hold_times[-1]:g} s", text))
    return rows


def elastic_notes(aging: Aging | None) -> tuple[str, ...]:
    """What the user should know of pressures and stresses beyond :data:`NOTED`, in words."""
    measures = elastic_measures(aging)
    notes = []
    area, load = measures.get("area_above_hardness", 0.0), measures.get("load_above_hardness", 0.0)
    if max(area, load) > NOTED:
        notes.append(
            f"{_percent(area)} of the contact area, which carries {_percent(load)} of the load, is above the hardness "
            f"of {measures['hardness']:g} GPa: the elastic solution overestimates the pressure there, which plastic "
            "flow would limit"
        )
    if aging is not None and measures.get("shear_stress_to_strength", 0.0) > NOTED:
        stress, strength = measures["mean_shear_stress"], measures["shear_strength"]
        notes.append(
            f"at {aging.hold_times[-1]:g} s the bonds carry a mean shear stress of {stress:.3g} GPa, "
            f"{_percent(stress / strength)} of the shear strength of {strength:g} GPa: the model does not limit it, "
            "but the solid would yield at its strength"
        )
    return tuple(notes)


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %" if share < 0.1 else f"{100 * share:.0f} %"
