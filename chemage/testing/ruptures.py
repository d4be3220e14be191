"""Checks of a rupture law."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from chemage.friction.role import Bonded, Rupture
from chemage.lattices.chemistry import Chemistry
from chemage.testing.checks import check_of, require, run_checks, speed_variants
from chemage.testing.replicas import Even, finished, with_states

#: force per bond, nN, from entropic bonds of a few pN to beyond any covalent bond
LEAST, MOST = 1e-4, 100.0
TIMES = (0.0, 0.1, 10.0, 10.0, 1e4)


def check_rupture(component: Rupture, *, all: bool = False) -> None:
    """Run every check of the role ``rupture``; raises CheckFailed if one fails, with ``all`` every one that does."""
    run_checks(component, Rupture, {}, all)


def _bonded(component: Rupture, n: int, bonded: int, **options: Any) -> Bonded:
    """A finished replica with breaking barriers that differ from site to site, as the law receives it."""
    replica = finished(n, bonded, **{"times": TIMES, **options})
    contact, lattice, history = with_states(replica) if component.states else replica
    breaking = None
    if lattice.breaking is not None:
        breaking = Even()
        lattice = lattice.model_copy(update={"breaking": np.linspace(0.9, 1.3, n)})
        history = history.model_copy(update={"lattice_hash": lattice.digest()})
    return Bonded(contact, Chemistry(forming=Even(), breaking=breaking), lattice, history)


def _force(component: Rupture, bonded: Bonded, what: str) -> np.ndarray:
    """What the law gives, which must be a force in nN for each hold time."""
    try:
        found = np.asarray(component.force(bonded))
    except Exception as error:
        raise AssertionError(f"{what}: force() raised {type(error).__name__}: {error}") from error
    times = bonded.hold_times.size
    require(found.dtype.kind in "fiu", f"{what}: force() returned values of type {found.dtype}; expected forces in nN")
    require(found.shape == (times,), f"{what}: force() returned the shape {found.shape} for {times} hold times")
    require(np.isfinite(found).all(), f"{what}: not all forces are finite: {found}")
    require((found >= 0).all(), f"{what}: a force is negative: {found}")
    return found


def _replicas(component: Rupture) -> Iterator[tuple[str, Bonded]]:
    for n, bonded in ((40, 0), (40, 17), (40, 40), (1, 1), (0, 0)):
        yield f"{bonded} of {n} sites bonded", _bonded(component, n, bonded)


@check_of("rupture")
def _forces_are_forces(component: Rupture) -> None:
    """There is one force for each hold time, finite and not negative, with or without bonds and sites."""
    for what, bonded in _replicas(component):
        _force(component, bonded, what)


@check_of("rupture")
def _no_bonds_no_force(component: Rupture) -> None:
    """The force is 0 wherever there is no bond."""
    for what, bonded in _replicas(component):
        force = _force(component, bonded, what)[bonded.bonds == 0]
        require((force == 0).all(), f"{what}: a force of {force.max(initial=0.0):.4g} nN where there is no bond")


@check_of("rupture")
def _forces_are_in_nn(component: Rupture) -> None:
    """Forces are in nN: the mean force per bond is between 1e-4 and 100 nN, unless all are zero."""
    bonded = _bonded(component, 40, 40)
    force = float(_force(component, bonded, "all sites bonded")[-1]) / 40
    require(
        force == 0 or LEAST <= force <= MOST,
        f"the mean force per bond is {force:.3g} nN; expected {LEAST:g} to {MOST:g} nN: is it in N, pN or eV/nm?",
    )


@check_of("rupture")
def _parts_may_be_absent(component: Rupture) -> None:
    """Lattices without breaking barriers or without interaction, contacts that are not square, and a single hold time
    have a force too."""
    for breaking, interacting in ((False, True), (True, False), (False, False)):
        lack = [word for word, there in (("breaking", breaking), ("interaction", interacting)) if not there]
        bonded = _bonded(component, 40, 17, breaking=breaking, interacting=interacting)
        _force(component, bonded, f"a lattice without {' and '.join(lack)}")
    for grid in ((13, 5), (5, 13)):
        _force(component, _bonded(component, 40, 17, grid=grid), f"a grid of {grid[0]}x{grid[1]} pixels")
    for times in ((10.0,), (0.0,)):
        _force(component, _bonded(component, 40, 17, times=times), f"a single hold time of {times[0]:g} s")


@check_of("rupture")
def _force_disturbs_nothing(component: Rupture) -> None:
    """A replica has the same force every time, whatever was asked before or at the same time, and stays as it was."""
    replicas = [_bonded(component, n, bonded) for n, bonded in ((40, 17), (40, 40), (30, 5))]
    parts = [_bytes(one) for one in replicas]

    def found(bonded: Bonded) -> bytes:
        return _force(component, bonded, "a replica").tobytes()

    first = [found(one) for one in replicas]
    require([found(one) for one in replicas] == first, "a second call gave another force")
    with ThreadPoolExecutor(3) as pool:
        require(list(pool.map(found, replicas * 3)) == first * 3, "concurrent calls gave other forces")
    require([_bytes(one) for one in replicas] == parts, "force() changed the contact, the lattice or the history")


def _bytes(bonded: Bonded) -> list[bytes]:
    records: tuple[Any, ...] = (bonded.contact, bonded.lattice, bonded.history)
    return [
        value.tobytes() for record in records for value in record.todict().values() if isinstance(value, np.ndarray)
    ]


@check_of("rupture")
def _later_times_do_not_matter(component: Rupture) -> None:
    """The force after a hold time does not depend on what happens later: sliding after 10 s does not know of 1e4 s."""
    bonded = _bonded(component, 40, 30)
    whole = _force(component, bonded, "30 of 40 sites bonded")
    for number in range(1, bonded.hold_times.size):
        force = _force(component, _until(bonded, number), f"the first {number} hold times")
        require(
            np.allclose(force, whole[:number], rtol=1e-9, atol=0.0),
            f"the first {number} hold times alone: {force} nN, but {whole[:number]} nN where later ones follow; "
            "history.state are the bonds at the last hold time, set states = True for those at each",
        )


def _until(bonded: Bonded, number: int) -> Bonded:
    """The replica, had it been stopped after its first ``number`` hold times."""
    history = bonded.history
    changes: dict[str, Any] = {
        name: getattr(history, name)[:number] for name in ("hold_times", "bonds", "formed", "broken")
    }
    states = np.arange(bonded.lattice.sites.size) < history.bonds[:number, None]
    changes |= {"state": states[-1], "time": float(history.hold_times[number - 1])}
    changes["states"] = None if history.states is None else states
    return Bonded(bonded.contact, bonded.chemistry, bonded.lattice, history.model_copy(update=changes))


@check_of("rupture")
def _unbonded_sites_do_not_matter(component: Rupture) -> None:
    """A law that asks for the states does not depend on the barriers of sites that have no bond."""
    if not component.states:
        return
    bonded = _bonded(component, 40, 17)
    lattice, open_sites = bonded.lattice, ~bonded.history.state
    changes = {
        name: np.where(open_sites, getattr(lattice, name) + 0.1, getattr(lattice, name))
        for name in ("forming", "breaking")
    }
    other = Bonded(bonded.contact, bonded.chemistry, lattice.model_copy(update=changes), bonded.history)
    here, there = (_force(component, one, "17 of 40 sites bonded") for one in (bonded, other))
    require(
        np.allclose(here, there, rtol=1e-9, atol=0.0),
        f"barriers of unbonded sites were raised by 0.1 eV: {there} nN instead of {here} nN; states are (hold times, "
        "sites), in the order of lattice.sites",
    )


@check_of("rupture")
def _speed_does_not_change_the_force(component: Rupture) -> None:
    """Options in ``speed_only`` do not change a bit of any force."""
    bonded = _bonded(component, 40, 17)
    plain = _force(component, bonded, "a replica").tobytes()
    for what, variant in speed_variants(component):
        found = _force(variant, bonded, what).tobytes()
        require(found == plain, f"{what}: the forces differ, but speed_only says that they do not")
