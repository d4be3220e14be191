"""The fifth stage: the force that breaks the bonds of one replica."""

from __future__ import annotations

from typing import Any

import numpy as np

from chemage.foundation.checks import expect
from chemage.foundation.errors import PluginError
from chemage.friction.role import Bonded, Rupture, RuptureForce
from chemage.plugins import registry
from chemage.plugins.sources import approximations, providers


def rupture(kind: str, **options: Any) -> Any:
    """A rupture law, from bonds to friction."""
    return registry.current().make("rupture", kind, options)


def rupture_bonds(bonded: Bonded, rupture: Rupture | None = None) -> RuptureForce:
    """Force that breaks the bonds of one replica after each hold time, through the hook ``chemage_rupture_bonds``.

    Without ``rupture`` it is the number of bonds times the mean force per bond and the front factor of the chemistry.
    The plugins that took part are noted in the ``provenance`` of the result.

    Raises
    ------
    PluginError
        What a law or a plugin gave is no force for each hold time.
    """
    expect("bonded", bonded, Bonded, "make one with chemage.plugin.Bonded(contact, chemistry, lattice, history)")
    if rupture is not None:
        expect("rupture", rupture, Rupture, 'make one with chemage.rupture("...")')
    force, plugins = registry.current().answer("chemage_rupture_bonds", np.ndarray, rupture=rupture, bonded=bonded)
    took_part = providers(*([] if rupture is None else [rupture])) | plugins
    if problem := _problem(force, bonded.hold_times.size):
        who = f"rupture law {rupture.kind!r}" if rupture is not None else "the hook chemage_rupture_bonds"
        named = ", ".join(f"{name} ({source})" for name, source in took_part.items()) or "chemage"
        raise PluginError(f"{who} of {named} {problem}; give one force in nN, not negative, for each hold time")
    rupture_force = RuptureForce(
        hold_times=bonded.hold_times,
        force=force,
        law="" if rupture is None else rupture.kind,
        provenance={} if rupture is None else {"rupture": rupture.todict()},
    )
    return rupture_force.noting(took_part, [] if rupture is None else approximations(rupture))


def _problem(force: np.ndarray, times: int) -> str:
    if force.dtype.kind not in "fiu":
        return f"gave values of type {force.dtype}"
    if force.shape != (times,):
        return f"gave an array of shape {force.shape} for {times} hold times"
    if bad := int(np.count_nonzero(~np.isfinite(force))):
        return f"gave {bad} forces of {times} that are not finite"
    return f"gave a negative force, {float(force.min()):.4g} nN" if (force < 0).any() else ""
