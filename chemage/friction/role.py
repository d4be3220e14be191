"""The role that turns bonds into friction, what it receives, the force that it gives, and the fifth stage."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from pydantic import model_validator

from chemage.contacts.solution import ContactSolution
from chemage.foundation.checks import Seed, expect
from chemage.foundation.components import Component
from chemage.foundation.errors import PluginError
from chemage.foundation.outputs import Observing
from chemage.foundation.records import Doubles, Named, Record
from chemage.kinetics.history import BondHistory
from chemage.lattices.chemistry import Chemistry
from chemage.lattices.lattice import ReactionLattice
from chemage.plugins import registry
from chemage.plugins.sources import noted


@dataclass(frozen=True)
class Bonded:
    """What a rupture law receives: the bonds of one replica at each hold time, and where they are."""

    contact: ContactSolution
    chemistry: Chemistry
    #: the n sites of this replica, with the barriers of each
    lattice: ReactionLattice
    #: bonds at each hold time; ``history.state`` are the bonded sites at the last one, (n,) bool
    history: BondHistory
    #: of the random numbers of this replica; a law that draws some takes one seed of its own for each hold time
    seed: Seed = 0

    def seed_at(self, number: int) -> np.random.SeedSequence:
        """The seed for the hold time with this number."""
        if isinstance(self.seed, np.random.SeedSequence):
            return type(self.seed)(
                self.seed.entropy, spawn_key=(*self.seed.spawn_key, number)
            )
        return np.random.SeedSequence(self.seed, spawn_key=(number,))

    @property
    def temperature(self) -> float:
        """K."""
        return self.history.temperature

    @property
    def hold_times(self) -> np.ndarray:
        """(m,) s."""
        return self.history.hold_times

    @property
    def bonds(self) -> np.ndarray:
        """Number of bonds at each hold time, (m,)."""
        return self.history.bonds

    @property
    def states(self) -> np.ndarray:
        """Whether each site is bonded at each hold time, (m, n) bool.

        Raises
        ------
        PluginError
            Nothing asked for them: the class of the rupture law must set ``states = True``.
        """
        if self.history.states is None:
            raise PluginError(
                "the states at every hold time were not asked for; set states = True in the class"
            )
        return self.history.states


class RuptureForce(Observing, Record):
    """Force that breaks all bonds of one replica, after each hold time."""

    arrays = {
        "hold_times": (("hold_time",), "s", "time since the contact was made"),
        "force": (("hold_time",), "nN", "force that breaks all bonds"),
    }
    stored_names = {"hold_times": "hold_time"}
    added = ("observables", "outputs")

    hold_times: Doubles
    """(m,) s"""
    force: Doubles
    """(m,) nN"""
    law: str = ""
    """kind of the rupture law; empty for the mean force per bond of the chemistry"""
    provenance: dict[str, Any] = {}
    """how it was made: plain JSON values"""
    observables: Named = {}
    """name -> what was recorded on the way to this, see :class:`chemage.plugin.Output`"""
    outputs: dict[str, dict[str, Any]] = {}
    """the same names -> dims, unit and description"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.hold_times.ndim != 1 or self.force.shape != self.hold_times.shape:
            raise ValueError(
                f"force: shape {self.force.shape}; give one number for each of the hold times"
            )
        return self

    def __repr__(self) -> str:
        return (
            f"<RuptureForce {self.force[-1]:.4g} nN at {self.hold_times[-1]:g} s>"
        )

    __str__ = __repr__


class Rupture(Component, ABC):
    """Role ``rupture``: the force that breaks the bonds of a contact when it starts to slide."""

    role = "rupture"
    error_of = "the force"
    #: draws random numbers, so that its force is a sample, and depends on the sites as they are numbered
    sampled: ClassVar[bool] = False
    # not annotated for type checkers, so that a class can make it a property
    if TYPE_CHECKING:
        states = False
    else:
        #: asks for the state of every site at every hold time, :attr:`chemage.plugin.Bonded.states`; the engine must be
        #: able to resume from a history (``restart``)
        states: ClassVar[bool] = False

    def expected(
        self, sites: float, hold_times: int, replicas: int
    ) -> dict[str, float]:
        """Estimate the cost for all replicas on ``sites`` sites, as far as it is known: ``cpu_seconds``, ``bytes``.

        A component may add ``chemistry``, ``times`` (the hold times, s), ``temperature`` (K) and ``pressure`` (the mean
        in contact, GPa), and chemage then passes them.
        """
        return {}

    def remarks(self, observables: Mapping[str, np.ndarray]) -> Sequence[str]:
        """Say in sentences what users should know of a result, from what its replicas recorded: name -> (replicas, ...)
        values."""
        return ()

    def check(
        self, chemistry: Chemistry, temperature: float
    ) -> Sequence[str] | None:
        """Refuse, before anything is computed, what :meth:`force` would refuse at ``temperature`` (K); return doubts as
        sentences. Used by ``chemage check``. A component may add ``sites``, which is None where their number is not
        known, ``times`` and ``pressure``, as for :meth:`expected`.

        Raises
        ------
        InputError
            Naming what the law cannot treat, and the remedy.
        """

    @abstractmethod
    def force(self, bonded: Bonded) -> np.ndarray:
        """Force in nN that breaks all bonds there are after each hold time, (m,), finite and not negative.

        It is the friction drop ΔF, so that a front factor, if there is one, is part of it.
        """


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
    expect(
        "bonded",
        bonded,
        Bonded,
        "make one with chemage.plugin.Bonded(contact, chemistry, lattice, history)",
    )
    if rupture is not None:
        expect("rupture", rupture, Rupture, 'make one with chemage.rupture("...")')
    force, took_part, recorded = registry.current().answer(
        "chemage_rupture_bonds", np.ndarray, rupture=rupture, bonded=bonded
    )
    rupture_force = RuptureForce(
        hold_times=bonded.hold_times,
        force=force,
        law="" if rupture is None else rupture.kind,
        provenance={} if rupture is None else {"rupture": rupture.todict()},
    )
    return noted(rupture_force, recorded, took_part, rupture)
