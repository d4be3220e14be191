"""The method of ageing where none is chosen: the kinetics of every site of every replica."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from chemage.ageing.methods import AgedBonds, AgeingMethod, AgeingRequest, Origin, wants_states
from chemage.ageing.observables import Seen, measure, stacked
from chemage.friction.role import Bonded
from chemage.friction.stage import rupture_bonds


class Kinetics(AgeingMethod):
    """Every replica draws its disorder and runs its kinetics; its bonds are counted, broken and measured.

    It is part of chemage and has no role, so that no scene names it and no key or provenance contains it.
    """

    role = ""
    kind = "kinetics"
    observes = True
    ruptures = True
    shows_sites = True

    def age(self, request: AgeingRequest) -> AgedBonds:
        """See :meth:`chemage.plugin.AgeingMethod.age`."""
        states = wants_states(request.engine, request.rupture, request.observe)
        replicas = request.each(lambda number: _replica(request, number, states))
        return AgedBonds.of(
            [replica.origin for replica in replicas],
            bonds=np.stack([replica.bonds for replica in replicas]),
            sites=np.array([replica.sites for replica in replicas]),
            events=np.array([replica.events for replica in replicas]),
            rupture_force=_forces(request, replicas),
            observables=stacked([replica.seen.values for replica in replicas]),
            outputs=replicas[0].seen.outputs,
        )

    def expected(self, sites: float, kinetics: Mapping[str, float], replicas: int) -> dict[str, float]:
        """See :meth:`chemage.plugin.AgeingMethod.expected`."""
        return {name: value * (1 if name == "bytes" else replicas) for name, value in kinetics.items()}


#: in place of a method that is not chosen
EVERY_SITE: AgeingMethod = Kinetics()


class _Replica(NamedTuple):
    """What is kept of a finished replica; its lattice and state are not, because they would fill the memory."""

    bonds: np.ndarray
    #: None where it follows from the bonds by the constants of the chemistry
    force: np.ndarray | None
    events: int
    sites: int
    seen: Seen
    origin: Origin


def _replica(request: AgeingRequest, number: int, states: bool) -> _Replica:
    replica = request.follow(number, states=states)
    lattice, history = replica.lattice, replica.history
    force = rupture_bonds(Bonded(request.solution, request.chemistry, lattice, history), request.rupture)
    seen = measure(request.solution, lattice, history, request.observe)
    origin = replica.origin(force)
    return _Replica(
        bonds=history.bonds,
        force=force.force if request.rupture is not None or force.plugins else None,
        events=history.events,
        sites=lattice.sites.size,
        seen=seen,
        origin=origin._replace(plugins=origin.plugins | seen.plugins),
    )


def _forces(request: AgeingRequest, replicas: list[_Replica]) -> np.ndarray | None:
    """(replicas, m) nN where a rupture law or a plugin gave the force of a replica."""
    if all(replica.force is None for replica in replicas):
        return None
    mean = request.chemistry.bond_force * request.chemistry.front_factor
    return np.stack([replica.bonds * mean if replica.force is None else replica.force for replica in replicas])
