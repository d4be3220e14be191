"""Checks of an engine that pulls a contact: closed forms of one bond and of steady sliding, energy, and going on."""

from __future__ import annotations

from itertools import cycle, product
from typing import Any

import numpy as np

from chemage.foundation.units import EV_PER_GPA_NM3, KB
from chemage.friction.pulling import (
    BALANCE,
    Drive,
    Partners,
    PullHistory,
    Pulling,
    partners_of,
)
from chemage.lattices.lattice import ReactionLattice
from chemage.testing.answers import independent_calls
from chemage.testing.checks import (
    CHANCE,
    Checks,
    Questions,
    binomial_chance,
    known,
    naming,
    refuses,
    require,
    seeds_are_harmless,
    whole,
)
from chemage.testing.small_systems import Group, agree, coupled, reacting, states
from chemage.testing.trials import TRIALS, Trial

check_pulling = whole(Pulling)

#: the columns of a pull
CURVES = ("force", "displacement", "work", "bonds", "formed", "broken")
#: standard errors within which a mean must agree with the closed form
FAR = 6.0
#: a bond that forms 4e4 times per second and breaks, without a force, every three seconds
USUALLY, USUAL = Trial(), Group((0.5,), (0.8,))
#: in which forces are compared with closed forms
SITUATIONS = (
    *TRIALS,
    Trial(temperature=250.0, attempt_frequency=3e13, start="after pull"),
)


def _quick() -> Group:
    """Four coupled sites that form and break bonds within a pull."""
    group = coupled()
    return Group(
        tuple(0.6 * energy for energy in group.forming), group.breaking, group.pair
    )


def _at(trial: Trial, group: Group = USUAL) -> Group:
    """The group with the same rates there."""
    return group.at(trial.temperature, trial.attempt_frequency)


def _drive(trial: Trial, **changes: Any) -> Drive:
    """A drive whose force lowers the barriers of bonds by the same share everywhere."""
    fields: dict[str, Any] = {
        "speed": 1e4,
        "bond_stiffness": 10.0 * trial.scale,
        "transition_distance": 0.05,
        "shape": "constant",
        "partner": "kept",
    }
    return Drive(**{**fields, **changes})


def _partners(trial: Trial, n: int) -> Partners:
    """Forming barriers within 8 % of the usual one, at three pressures, and two breaking barriers; so near to each other
    that no bond breaks in the spacing in which it formed, and that it is at any place between two when it breaks."""
    group = _at(trial)
    (middle,), (breaking,) = group.forming, group.breaking or (np.inf,)
    forming = middle * np.linspace(0.92, 1.08, 4001)
    shift = -0.04 * middle * (np.arange(n) % 3)
    return Partners(forming, breaking * np.repeat([0.97, 1.03], 2000), shift, 0.01)


def _free_way(trial: Trial, met: Partners, speed: float) -> np.ndarray:
    """nm that the slider goes, in the mean, until a site binds whose bond broke between two partners, for each shift of
    ``met``: it is left the rest of one spacing, then whole ones, over which ``few`` of the partners do not bind."""
    barriers = met.forming + np.unique(met.shift)[::-1, None]
    rates = trial.attempt_frequency * np.exp(-barriers / (KB * trial.temperature))
    met_for = rates * (met.spacing / speed)
    binds = -np.expm1(-met_for)
    few = binds / met_for
    first = ((1 - few) / met_for).mean(axis=1)
    whole = few.mean(axis=1) / binds.mean(axis=1)
    return met.spacing * (first + few.mean(axis=1) * whole)


def _hazard(
    trial: Trial, drive: Drive, group: Group, stretch: np.ndarray
) -> np.ndarray:
    """Of a bond that was stretched at a constant speed, by the trapezoidal rule on ``stretch`` (nm), from 0 on."""
    (breaking,) = group.breaking or (np.inf,)
    lowered = (
        drive.bond_stiffness * stretch * drive.transition_distance * EV_PER_GPA_NM3
    )
    left = np.clip(1 - drive.exponent * lowered / breaking, 0.0, 1.0)
    rate = (
        trial.attempt_frequency
        * left ** (1 / drive.exponent - 1)
        * np.exp(
            -breaking / (KB * trial.temperature) * left ** (1 / drive.exponent)
        )
    )
    return (
        np.concatenate(
            [[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(stretch))]
        )
        / drive.speed
    )


def _bytes(pulled: PullHistory) -> bytes:
    return (
        pulled.force.tobytes() + pulled.state.tobytes() + pulled.stretch.tobytes()
    )


class PullingChecks(Checks[Pulling], of=Pulling):
    """What every engine that pulls must do."""

    def _run(
        self,
        lattice: ReactionLattice,
        drive: Drive,
        times: Any,
        trial: Trial = USUALLY,
        seed: Any = 3,
        **more: Any,
    ) -> PullHistory:
        pulled = self.component.run(
            lattice, drive, times, temperature=trial.temperature, seed=seed, **more
        )
        fault = pulled.fault() or pulled.fault_of(
            lattice, trial.temperature, more.get("start"), times=np.asarray(times)
        )
        require(not fault, f"{lattice!r} at {drive.speed:g} nm/s: {fault}")
        return pulled

    def _begun(
        self, trial: Trial, lattice: ReactionLattice, state: np.ndarray, time: float
    ) -> Any:
        """What a pull starts from: these bonds, unstretched, at once or after ``time`` s."""
        if trial.start == "fresh":
            return state
        if trial.start == "after hold":
            return trial.before(lattice, state, time)
        still = _drive(trial, speed=0.0)
        return self._run(lattice, still, [time], trial, start=state)

    def questions(self) -> Questions:
        changes: dict[str, dict[str, Any]] = {
            "with another seed": {"seed": 2},
            "at another temperature": {"warmer": 17.0},
            "at another speed": {"speed": 3e4},
            "of which every third is bonded at first": {"begin": 3},
            "with other breaking barriers": {"raised": 0.02},
            "with other partners": {"partner": "renewed"},
        }

        def ask(
            number: int,
            *,
            seed: int = 1,
            warmer: float = 0.0,
            speed: float = 1e4,
            begin: int = 0,
            raised: float = 0.0,
            partner: str = "kept",
        ) -> Any:
            trial = Trial()
            lattice, _ = trial.placed(_quick(), number)
            higher = np.asarray(lattice.breaking) + raised
            lattice = lattice.model_copy(update={"breaking": higher})
            n = lattice.sites.size
            start = np.arange(n) % max(begin, 1) == 1 - begin % 2
            drive = _drive(trial, speed=speed, partner=partner)
            partners = _partners(trial, n) if partner == "renewed" else None
            times = np.linspace(0, 1.0 / speed, 5)
            return lambda engine: _bytes(
                engine.run(
                    lattice,
                    drive,
                    times,
                    temperature=280.0 + number + warmer,
                    seed=seed,
                    start=start,
                    partners=partners,
                )
            )

        for number, (what, change) in enumerate(changes.items(), 8):
            yield f"{4 * number} sites", ask(number)
            yield f"{4 * number} sites {what}", ask(number, **change)

    calls_are_independent = independent_calls

    def seeds_decide_the_noise(self) -> None:
        """The same seed gives the same pull, another one another."""
        lattice, _ = USUALLY.placed(USUAL, 40)
        drive, times = _drive(USUALLY), np.array([1e-4])
        seeds_are_harmless(
            lambda seed: _bytes(self._run(lattice, drive, times, seed=seed)),
            "a pull",
            chance=True,
        )

    @known
    def bonds_break_as_their_barrier_falls(self) -> None:
        """Of bonds that are stretched at a constant speed, as many are left as the integral of their rate says, for
        each shape of the energy and also where the drive is a stiff spring; the peak is the largest force on the way,
        also where it is asked for at the end alone."""
        n = 2000
        stretch = np.linspace(0, 0.4, 40_001)
        shapes = product(("cusp", "cubic", "constant"), (None, 1e9))
        for trial, (shape, spring) in zip(SITUATIONS, shapes, strict=True):
            with naming(trial):
                group = _at(trial, Group((3.0,), (0.8,)))
                lattice, _ = trial.placed(group, n)
                drive = _drive(trial, shape=shape, spring=spring)
                hazard = _hazard(trial, drive, group, stretch)
                at = np.searchsorted(hazard, [0.1, 0.7, 2.0])
                time = 1e-3 if trial.start == "after pull" else 1e3
                start = self._begun(trial, lattice, np.ones(n, bool), time)
                bonded = start if isinstance(start, np.ndarray) else start.state
                first = 0.0 if trial.start == "fresh" else time
                times = first + stretch[at] / drive.speed
                pulled, once = (
                    self._run(lattice, drive, when, trial, start=start)
                    for when in (times, times[-1:])
                )
                total = int(np.count_nonzero(bonded))
                for bonds, where in zip(pulled.bonds, at, strict=True):
                    left = float(np.exp(-hazard[where]))
                    require(
                        binomial_chance(int(bonds), total, left) > CHANCE,
                        f"{shape}, spring {spring}: {bonds} of {total} bonds are left at a stretch of "
                        f"{stretch[where]:.4g} nm; expected {total * left:.1f}",
                    )
                share = stretch * np.exp(-hazard)
                most = total * drive.bond_stiffness * float(share[: at[-1]].max())
                for peak in (pulled.peak, once.peak):
                    require(
                        abs(peak / most - 1) < FAR / total**0.5,
                        f"{shape}, spring {spring}: the peak is {peak:.5g} nN, expected {most:.5g} nN, between the "
                        "times as well",
                    )

    @known
    def steady_sliding_is_the_closed_form(self) -> None:
        """Independent sites in steady sliding carry Ḟ∫tS dt/(1/k_on + ∫S dt) each (Schallamach 1963); where they meet
        others, with the mean way to the next bond and of both integrals over the partners."""
        n, stretch = 300, np.linspace(0, 0.4, 100_001)
        speeds = (1e2, 1e4, 1e5)
        for trial, speed in zip(SITUATIONS, cycle(speeds)):
            group = _at(trial)
            lattice, _ = trial.placed(group, n)
            drive = _drive(trial, speed=speed, partner=trial.partner)
            partners, breaking = None, group.breaking or (np.inf,)
            (barrier,) = group.forming
            pace = trial.attempt_frequency * np.exp(
                -barrier / (KB * trial.temperature)
            )
            free = np.array([speed / pace])
            if trial.partner == "renewed":
                partners = _partners(trial, n)
                breaking = tuple(np.unique(partners.breaking))
                free = _free_way(trial, partners, speed)
            survival = np.mean(
                [
                    np.exp(
                        -_hazard(trial, drive, Group((barrier,), (one,)), stretch)
                    )
                    for one in breaking
                ],
                axis=0,
            )
            cycles = free + stretch[1] * float(survival.sum())
            carried = stretch[1] * float(stretch @ survival)
            expected = drive.bond_stiffness * float((carried / cycles).mean())
            times = np.array([8.0, 30.0]) * float(cycles.max()) / speed
            works = [
                np.diff(
                    self._run(
                        lattice, drive, times, trial, seed, partners=partners
                    ).work
                )[0]
                for seed in range(10)
            ]
            forces = np.array(works) / (np.diff(times) * speed * n)
            error = np.std(forces, ddof=1) / len(forces) ** 0.5
            with naming(trial):
                require(
                    abs(np.mean(forces) - expected) < FAR * error,
                    f"{np.mean(forces):.5g} ± {error:.2g} nN per site at {speed:g} nm/s; expected {expected:.5g} nN",
                )

    @known
    def bonds_without_force_are_those_of_a_hold(self) -> None:
        """Sites follow their master equation while the drive stands still, and while it moves and its force lowers no
        barrier: also where they are coupled, after a hold, and beside 70,000 others."""
        for trial in (*SITUATIONS, Trial(idle=70_000, hold_times=1)):
            group = coupled() if trial.coupled else reacting((3.0, 1.0), (0.5, 1.5))
            group, m = _at(trial, group), len(group.forming)
            copies, runs = (200, 3) if trial.idle else (12, 40)
            lattice, places = trial.placed(group, copies)
            state = np.zeros(lattice.sites.size, bool)
            for speed in (0.0, 1e-3):
                drive = _drive(trial, speed=speed, bond_stiffness=1e-9)
                counts = np.zeros(2**m, np.int64)
                for seed in range(runs):
                    start = state if trial.start == "fresh" else None
                    first = 0.0
                    if trial.start != "fresh":
                        first, start = 1e3, trial.before(lattice, state, 1e3)
                    times = first + 0.8 * np.arange(1, 4) / 3
                    pulled = self._run(
                        lattice, drive, times, trial, seed, start=start
                    )
                    counts += states(pulled.state[places], m)
                chances = group.probabilities(
                    0.8, trial.temperature, trial.attempt_frequency
                )
                with naming(trial):
                    agree(f"at {speed:g} nm/s, after 0.8 s", counts, chances)

    def spring_bonds_and_friction_balance(self) -> None:
        """The spring carries what the bonds and the friction of the slider hold, work is stored or lost, and the slider
        rests while the spring pulls less than they hold."""
        n = 200
        lattice, _ = USUALLY.placed(USUAL, n)
        for spring, friction in ((None, 5.0), (1e3, 0.0), (1e3, 50.0), (20.0, 5.0)):
            drive = _drive(USUALLY, spring=spring, friction=friction)
            where, times = f"spring {spring}", np.linspace(0, 2.0 / drive.speed, 41)
            pulled = self._run(lattice, drive, times, start=np.ones(n, bool))
            worst = float(np.abs(pulled.imbalance).max())
            require(
                worst < BALANCE,
                f"{where}: energy is lost or made, {worst:.2g} of the work",
            )
            held = drive.bond_stiffness * float(pulled.stretch.sum()) + friction
            stiffness, force = spring or np.inf, pulled.force[-1]
            moved = (
                drive.speed * times - pulled.displacement - pulled.force / stiffness
            )
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
        for number, trial in enumerate(SITUATIONS):
            if not trial.breaking:
                continue
            replica, lower = trial.replica(), 0.4 * trial.scale
            lattice = replica.lattice  # whose bonds are to form within the pull
            lattice = lattice.model_copy(
                update={"forming": lattice.forming - lower}
            )
            change = {"spring": 100.0, "friction": 3.0} if number % 2 else {}
            drive, more = _drive(trial, partner=trial.partner, **change), {}
            if trial.partner == "renewed":
                made = partners_of(replica.chemistry, lattice, replica.contact)
                more = {"partners": made._replace(forming=made.forming - lower)}
            times = np.linspace(0, 1e-4, 100)
            with naming(trial):
                whole_run, first, once = (
                    self._run(lattice, drive, part, trial, **more)
                    for part in (times, times[:44], times[-1:])
                )
                second = self._run(
                    lattice, drive, times[44:], trial, start=first, **more
                )
                for name in CURVES:
                    parts = np.concatenate(
                        [getattr(first, name), getattr(second, name)]
                    )
                    require(
                        np.array_equal(parts, getattr(whole_run, name)),
                        f"{name} differs where a pull goes on ({change})",
                    )
                for other, what in (
                    (second, "goes on"),
                    (once, "is sampled less often"),
                ):
                    require(
                        _bytes(other)[-9 * lattice.sites.size :]
                        == _bytes(whole_run)[-9 * lattice.sites.size :],
                        f"the end differs where a pull {what}",
                    )
                    require(
                        other.peak >= whole_run.force.max(),
                        f"the peak is below a force where a pull {what}",
                    )
                    require(
                        other.least <= whole_run.force.min() + BALANCE * other.peak,
                        f"the least force is above a force where a pull {what}",
                    )
                require(bool(whole_run.broken[-1]), "no bond broke")

    def at_rest_nothing_moves(self) -> None:
        """Without a speed nothing moves, no site meets another and no work is done; stretched bonds relax; the state goes
        back to a hold."""
        n = 80
        lattice, _ = USUALLY.placed(USUAL, n)
        drive, met = _drive(USUALLY), _partners(USUALLY, n)
        moving, still = (
            _drive(USUALLY, speed=speed, partner="renewed") for speed in (1e4, 0.0)
        )
        begin = np.ones(n, bool)
        pulled = self._run(lattice, moving, [0.1 / 1e4], start=begin, partners=met)
        held = self._run(lattice, still, [1.0, 1e3], start=pulled, partners=met)
        require(
            np.array_equal(held.forming, pulled.forming),
            "sites meet others although the drive stands still",
        )
        require(
            len(np.unique(pulled.forming)) > n / 2,
            "sites do not meet others although the slider moves",
        )
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
        unbonded, _ = USUALLY.placed(Group((3.0,), (0.8,)), n)
        none = self._run(unbonded, drive, [1e-4])
        require(
            none.peak == 0 and not none.bonds.any(),
            "a contact without a bond carries a force",
        )

    def what_cannot_be_pulled_is_refused(self) -> None:
        """Bonds that last, times before the start and partners that are not given are refused."""
        lattice, _ = USUALLY.placed(USUAL, 5)
        drive, new = _drive(USUALLY), _drive(USUALLY, partner="renewed")
        lasting = lattice.model_copy(update={"breaking": None})
        first = self._run(lattice, drive, [1e-5])
        refuses("bonds that last", lambda: self._run(lasting, drive, [1.0]))
        refuses(
            "an earlier time",
            lambda: self._run(lattice, drive, [1e-6], start=first),
        )
        refuses("no partners", lambda: self._run(lattice, new, [1.0]))
