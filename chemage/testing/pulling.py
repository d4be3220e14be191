"""Checks of an engine that pulls a contact: closed forms of one bond and of steady sliding, energy, and going on."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from chemage.foundation.units import EV_PER_GPA_NM3, KB
from chemage.friction.pulling import BALANCE, Drive, Partners, PullHistory, Pulling
from chemage.lattices.lattice import ReactionLattice
from chemage.testing.answers import independent_calls
from chemage.testing.checks import (
    CHANCE,
    Checks,
    Questions,
    binomial_chance,
    known,
    refuses,
    require,
    seeds_are_harmless,
    whole,
)

check_pulling = whole(Pulling)

TEMPERATURE, NU = 300.0, 1e13
KT = KB * TEMPERATURE
#: standard errors within which a mean must agree with the closed form
FAR = 6.0


def _drive(**changes: Any) -> Drive:
    fields: dict[str, Any] = {
        "bond_stiffness": 10.0,
        "transition_distance": 0.05,
        "shape": "constant",
        "partner": "kept",
    }
    return Drive(**{"speed": 1e4, **fields, **changes})


def _lattice(
    n: int, forming: float = 3.0, breaking: float = 0.8, interacting: bool = False
) -> ReactionLattice:
    fields: dict[str, Any] = {
        "forming": np.full(n, forming),
        "breaking": np.full(n, breaking),
    }
    if interacting:
        ring = np.arange(n)
        neighbours = np.stack([np.roll(ring, 1), np.roll(ring, -1)], axis=1).astype(
            np.int32
        )
        fields |= {"neighbours": neighbours, "coupling": np.full((n, 2), 0.03)}
    return ReactionLattice(
        pixels=(n, 1), sites=np.arange(n), attempt_frequency=NU, **fields
    )


def _hazard(drive: Drive, breaking: float, stretch: np.ndarray) -> np.ndarray:
    """Of a bond that was stretched at a constant speed, by the trapezoidal rule on ``stretch`` (nm), from 0 on."""
    lowered = (
        drive.bond_stiffness * stretch * drive.transition_distance * EV_PER_GPA_NM3
    )
    left = np.clip(1 - drive.exponent * lowered / breaking, 0.0, 1.0)
    rate = (
        NU
        * left ** (1 / drive.exponent - 1)
        * np.exp(-breaking / KT * left ** (1 / drive.exponent))
    )
    return (
        np.concatenate(
            [[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(stretch))]
        )
        / drive.speed
    )


def _bytes(pulled: PullHistory) -> bytes:
    return pulled.force.tobytes() + pulled.state.tobytes() + pulled.stretch.tobytes()


class PullingChecks(Checks[Pulling], of=Pulling):
    """What every engine that pulls must do."""

    def _run(
        self,
        lattice: ReactionLattice,
        drive: Drive,
        times: Any,
        seed: Any = 3,
        **more: Any,
    ) -> PullHistory:
        pulled = self.component.run(
            lattice, drive, times, temperature=TEMPERATURE, seed=seed, **more
        )
        fault = pulled.fault() or pulled.fault_of(
            lattice, TEMPERATURE, more.get("start"), times=np.asarray(times)
        )
        require(not fault, f"{lattice!r} at {drive.speed:g} nm/s: {fault}")
        return pulled

    def questions(self) -> Questions:
        def ask(number: int, speed: float, seed: int) -> Any:
            lattice = _lattice(30 + number, 0.5, interacting=True)
            times = np.linspace(0, 1.0 / speed, 5)
            return lambda engine: _bytes(
                PullingChecks(engine)._run(lattice, _drive(speed=speed), times, seed)
            )

        for number, speed in enumerate((1e2, 1e4, 1e6)):
            for seed in (1, 2):
                yield f"{speed:g} nm/s, seed {seed}", ask(number, speed, seed)

    @known
    def bonds_break_as_their_barrier_falls(self) -> None:
        """Of bonds that are stretched at a constant speed, as many are left as the integral of their rate says, for
        each shape of the energy and also where the drive is a stiff spring."""
        n = 2000
        stretch = np.linspace(0, 0.4, 40_001)
        for shape, spring in product(("cusp", "cubic", "constant"), (None, 1e9)):
            drive = _drive(shape=shape, spring=spring)
            hazard = _hazard(drive, 0.8, stretch)
            at = np.searchsorted(hazard, [0.1, 0.7, 2.0])
            pulled = self._run(
                _lattice(n), drive, stretch[at] / drive.speed, start=np.ones(n, bool)
            )
            for bonds, where in zip(pulled.bonds, at, strict=True):
                left = float(np.exp(-hazard[where]))
                require(
                    binomial_chance(int(bonds), n, left) > CHANCE,
                    f"{shape}, spring {spring}: {bonds} of {n} bonds are left at a stretch of {stretch[where]:.4g} nm; "
                    f"expected {n * left:.1f}",
                )

    @known
    def steady_sliding_is_the_closed_form(self) -> None:
        """Independent sites in steady sliding carry Ḟ∫tS dt/(1/k_on + ∫S dt) each (Schallamach 1963)."""
        n, forming, breaking = 300, 0.5, 0.8
        lattice, stretch = _lattice(n, forming, breaking), np.linspace(0, 0.4, 100_001)
        for speed in (1e2, 1e4, 1e5):
            drive = _drive(speed=speed)
            survival = np.exp(-_hazard(drive, breaking, stretch)) * stretch[1]
            cycle = speed / (NU * np.exp(-forming / KT)) + float(survival.sum())
            expected = drive.bond_stiffness * float(stretch @ survival) / cycle
            times = np.array([8.0, 30.0]) * cycle / speed
            works = [
                np.diff(self._run(lattice, drive, times, seed).work)[0]
                for seed in range(10)
            ]
            forces = np.array(works) / (np.diff(times) * speed * n)
            error = np.std(forces, ddof=1) / len(forces) ** 0.5
            require(
                abs(np.mean(forces) - expected) < FAR * error,
                f"{np.mean(forces):.5g} ± {error:.2g} nN per site at {speed:g} nm/s; expected {expected:.5g} nN",
            )

    def spring_bonds_and_friction_balance(self) -> None:
        """The spring carries what the bonds and the friction of the slider hold, work is stored or lost, and the slider
        rests while the spring pulls less than they hold."""
        n = 200
        for spring, friction in ((None, 5.0), (1e3, 0.0), (1e3, 50.0), (20.0, 5.0)):
            drive, where = _drive(spring=spring, friction=friction), f"spring {spring}"
            times = np.linspace(0, 2.0 / drive.speed, 41)
            pulled = self._run(_lattice(n, 0.5), drive, times, start=np.ones(n, bool))
            worst = float(np.abs(pulled.imbalance).max())
            require(
                worst < BALANCE,
                f"{where}: energy is lost or made, {worst:.2g} of the work",
            )
            held = drive.bond_stiffness * float(pulled.stretch.sum()) + friction
            stiffness, force = spring or np.inf, pulled.force[-1]
            moved = drive.speed * times - pulled.displacement - pulled.force / stiffness
            require(
                np.allclose(moved, 0, atol=1e-9),
                f"{where}: drive, slider and spring do not fit together",
            )
            require(
                pulled.displacement[-1] <= 0 or np.isclose(force, held, rtol=1e-9),
                f"{where}: the force is {force:.6g} nN, but bonds and friction hold {held:.6g} nN",
            )
            rests = drive.speed * times < friction / stiffness
            require(
                not pulled.displacement[rests].any(),
                f"the slider moves although it has a friction of {friction} nN",
            )

    def going_on_is_exact(self) -> None:
        """A pull that is interrupted and goes on is the same bit for bit, and what is sampled changes nothing."""
        n = 60
        lattice = _lattice(n, 0.5, interacting=True)
        partners = Partners(np.linspace(0.4, 0.6, 50), np.zeros(n))
        times = np.linspace(0, 1e-4, 9)
        for changes in ({}, {"partner": "new"}, {"spring": 100.0, "friction": 3.0}):
            drive = _drive(**changes)
            more = {"partners": partners} if drive.partner == "new" else {}
            whole_run, first, once = (
                self._run(lattice, drive, part, **more)
                for part in (times, times[:4], times[-1:])
            )
            second = self._run(lattice, drive, times[4:], start=first, **more)
            for name in ("force", "displacement", "work", "bonds", "formed", "broken"):
                parts = np.concatenate([getattr(first, name), getattr(second, name)])
                require(
                    np.array_equal(parts, getattr(whole_run, name)),
                    f"{name} differs where a pull goes on ({changes})",
                )
            for other, what in ((second, "goes on"), (once, "is sampled less often")):
                require(
                    _bytes(other)[-9 * n :] == _bytes(whole_run)[-9 * n :],
                    f"the end differs where a pull {what}",
                )
                require(other.peak >= other.force.max(), "the peak is below a force")
            require(bool(whole_run.broken[-1]), "no bond broke")

    def at_rest_nothing_moves(self) -> None:
        """Without a speed nothing moves and no work is done; stretched bonds relax; the state goes back to a hold."""
        n = 80
        lattice = _lattice(n, 0.5)
        pulled = self._run(lattice, _drive(), [0.1 / 1e4], start=np.ones(n, bool))
        held = self._run(lattice, _drive(speed=0.0), [1.0, 1e3], start=pulled)
        require(
            (held.displacement == pulled.displacement[-1]).all(),
            "the slider moves although the drive stands still",
        )
        require(
            (held.work == pulled.work[-1]).all(),
            "work is done although the drive stands still",
        )
        require(
            held.force[-1] <= pulled.force[-1],
            "the force rises although the drive stands still",
        )
        require(
            held.history.fault() == "",
            f"the bonds are no history: {held.history.fault()}",
        )
        none = self._run(_lattice(n), _drive(), [1e-4])
        require(
            none.peak == 0 and not none.bonds.any(),
            "a contact without a bond carries a force",
        )

    def seeds_decide_the_noise(self) -> None:
        """The same seed gives the same pull, another one another."""
        lattice, times = _lattice(40, 0.5), np.array([1e-4])
        seeds_are_harmless(
            lambda seed: _bytes(self._run(lattice, _drive(), times, seed)),
            "a pull",
            chance=True,
        )

    calls_are_independent = independent_calls

    def what_cannot_be_pulled_is_refused(self) -> None:
        """Bonds that last, times before the start and new partners that are not given are refused."""
        lattice = _lattice(5)
        lasting = lattice.model_copy(update={"breaking": None})
        first = self._run(lattice, _drive(), [1e-5])
        refuses("bonds that last", lambda: self._run(lasting, _drive(), [1.0]))
        refuses(
            "an earlier time", lambda: self._run(lattice, _drive(), [1e-6], start=first)
        )
        refuses("no partners", lambda: self._run(lattice, _drive(partner="new"), [1.0]))
