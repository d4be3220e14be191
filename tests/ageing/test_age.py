"""From contact to ageing: which seed goes where, how many threads, who watches, and what is refused."""

from __future__ import annotations

import itertools
import threading
import time
from typing import ClassVar

import numpy as np
import pytest

import chemage as ca
from chemage import ContactSolution, InputError
from chemage.plugin import Barriers, BondHistory, ContactSolver, Engine, Observable, PluginError, random

TIMES = [1.0, 10.0, 100.0]


class Ladder(Barriers):
    """Barriers evenly between 0 and 1 eV."""

    kind = "ladder"

    def quantile(self, uniform):
        return uniform

    def density(self, energy):
        return np.where((energy >= 0) & (energy <= 1), 1.0, 0.0)


class Tally(Engine):
    """A stub: the number of bonds is drawn from the seed, so that it tells which seed and lattice it was given."""

    kind = "tally"
    threads_seen: ClassVar[set[str]] = set()
    delays: ClassVar[dict[int, float]] = {}
    #: (lattice, seed) of every replica
    followed: ClassVar[list] = []
    #: where replicas wait for each other
    meeting: ClassVar[threading.Barrier | None] = None

    def _run(self, lattice, hold_times, temperature, seed, start):
        type(self).threads_seen.add(threading.current_thread().name)
        type(self).followed.append((lattice, seed))
        words = seed.generate_state(2) if isinstance(seed, np.random.SeedSequence) else np.array([seed, seed])
        if isinstance(seed, np.random.SeedSequence):
            time.sleep(self.delays.get(seed.spawn_key[-2], 0.0))
        if self.meeting is not None:
            self.meeting.wait(60)
        sites = lattice.sites.size
        bonds = np.minimum(words[0] % max(sites, 1) + np.arange(hold_times.size), sites).astype(np.int64)
        return BondHistory(
            hold_times=hold_times,
            bonds=bonds,
            formed=bonds + int(lattice.forming.sum() * 1e6),
            broken=np.full(bonds.size, int(lattice.forming.sum() * 1e6)),
            state=np.arange(sites) < bonds[-1],
            time=hold_times[-1],
            temperature=temperature,
            engine=self.kind,
        )


class Own(Tally):
    kind = "own"

    def concurrency(self):
        return 4


class Never(ContactSolver):
    """Is not asked."""

    kind = "never"

    def _solve(self, surface, load, start):
        raise AssertionError


class Watch(Observable):
    """The mean barrier and the first count."""

    kind = "watch"

    def measure(self, contact, lattice, history):
        return {"barrier": lattice.forming.mean(), "counts": history.bonds}


@pytest.fixture(autouse=True)
def plain(isolated_registry):
    """No plugin takes part, and the stub has seen nothing."""
    Tally.threads_seen.clear()
    Tally.delays.clear()
    Tally.followed.clear()


@pytest.fixture
def contact():
    pressure = np.zeros((33, 44))
    pressure[1:31, 2:42] = np.linspace(0.5, 3, 1200).reshape(30, 40)
    return ContactSolution(pressure=pressure, load=pressure.sum() * 0.25, pixel_size=0.5, modulus=30.0)


def chemistry(**options):
    return ca.chemistry(forming=Ladder(), **{"site_density": "pixel", **options})


def age(contact, **options):
    given = {"engine": Tally(), "hold_times": TIMES, "temperature": 300, "replicas": 5, "seed": 3, **options}
    return ca.age(contact, chemistry(), **given)


# -- seeds ------------------------------------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_ageing(contact):
    assert age(contact) == age(contact)
    assert age(contact, seed=4) != age(contact)


def test_replicas_differ_in_disorder_and_in_noise(contact):
    made = age(contact, replicas=8)
    assert np.unique(made.bonds[:, 0]).size == 8
    assert np.unique(made.events - made.bonds[:, -1]).size == 8  # the sum of the barriers


def test_a_replica_depends_on_its_number_alone(contact):
    few, many = age(contact, replicas=2), age(contact, replicas=6)
    assert np.array_equal(many.bonds[:2], few.bonds)
    assert np.array_equal(many.events[:2], few.events)


def test_a_seed_sequence_is_a_seed_and_is_left_as_it_was(contact):
    sequence = np.random.SeedSequence(3)
    assert np.array_equal(age(contact, seed=sequence).bonds, age(contact, seed=3).bonds)
    assert sequence.n_children_spawned == 0
    child, other = sequence.spawn(2)
    assert not np.array_equal(age(contact, seed=child).bonds, age(contact, seed=other).bonds)


def test_seeds_are_all_different(contact):
    for seed, kelvin in itertools.product((0, 1, np.random.SeedSequence(0, spawn_key=(1,))), (300, 301)):
        age(contact, seed=seed, temperature=kelvin, replicas=50)
    keys = {tuple(random.key(noise)) for _, noise in Tally.followed}
    assert len(keys) == len({lattice.digest() for lattice, _ in Tally.followed}) == 2 * 3 * 50
    # nor is the disorder drawn with the seed of the noise
    for lattice, noise in Tally.followed[:5]:
        assert lattice != ca.plugin.build_lattice(chemistry(), contact, noise)


def test_one_replica_by_hand_is_the_replica_of_age(contact):
    made = age(contact, threads=1)
    lattice, noise = Tally.followed[4]
    history = ca.plugin.run_kinetics(Tally(), lattice, TIMES, temperature=300, seed=noise)
    assert np.array_equal(made.bonds[4], history.bonds)


# -- threads ----------------------------------------------------------------------------------------------------------


def test_results_do_not_depend_on_the_number_of_threads_nor_on_who_is_first(contact):
    alone = age(contact, threads=1)
    assert Tally.threads_seen == {threading.main_thread().name}
    Tally.delays.update({0: 0.05, 1: 0.02})  # the first come last
    for threads in (2, 3, 16):
        assert age(contact, threads=threads) == alone


def test_replicas_run_side_by_side(contact, monkeypatch):
    monkeypatch.setattr(Tally, "meeting", threading.Barrier(2))
    age(contact, replicas=4, threads=2)
    assert len(Tally.threads_seen) == 2
    assert all(name.startswith("chemage-replica") for name in Tally.threads_seen)


def test_replicas_share_the_processors_with_an_engine_that_uses_several(contact, monkeypatch):
    made = ca.age(contact, chemistry(), engine=Own(), hold_times=TIMES, temperature=300, replicas=4, threads=4)
    assert made.engine == "own"
    assert Tally.threads_seen == {threading.main_thread().name}
    monkeypatch.setattr(Tally, "meeting", threading.Barrier(2))
    Tally.threads_seen.clear()
    ca.age(contact, chemistry(), engine=Own(), hold_times=TIMES, temperature=300, replicas=4, threads=8)
    assert len(Tally.threads_seen) == 2


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_progress_counts_up_to_all(contact, threads):
    seen = []
    age(contact, threads=threads, progress=lambda done, total: seen.append((done, total)))
    assert [total for _, total in seen] == [5] * len(seen)
    counts = [done for done, _ in seen]
    assert counts == sorted(counts)
    assert counts[-1] == 5
    if threads == 1:
        assert counts == [1, 2, 3, 4, 5]


class Failing(Tally):
    kind = "failing"
    started: ClassVar[list[int]] = []

    def _run(self, lattice, hold_times, temperature, seed, start):
        number = seed.spawn_key[-2]
        self.started.append(number)
        if number == 1:
            raise InputError("replica 1 has had enough")
        time.sleep(0.02)
        return super()._run(lattice, hold_times, temperature, seed, start)


@pytest.mark.parametrize("threads", [1, 2])
def test_the_first_failure_stops_the_rest(contact, threads):
    Failing.started.clear()
    with pytest.raises(InputError, match="replica 1 has had enough"):
        age(contact, engine=Failing(), replicas=1000, threads=threads)
    assert 2 <= len(Failing.started) < 1000
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("chemage-replica")]


# -- what comes out ---------------------------------------------------------------------------------------------------


def test_the_result_says_what_made_it(contact):
    silica = chemistry(bond_force="2 nN", front_factor=0.15)
    made = ca.age(contact, silica, engine=Tally(), hold_times=TIMES, temperature="26.85 degC", replicas=2, seed=3)
    assert made.hold_times.tolist() == TIMES
    assert (made.load, made.temperature, made.bond_force, made.front_factor) == (contact.load, 300.0, 2.0, 0.15)
    assert made.engine == "tally"
    assert made.sites.tolist() == [1200, 1200]
    assert made.contact == pytest.approx(contact.summary(), nan_ok=True)
    assert made.provenance["chemistry"] == {k: v for k, v in silica.todict().items() if k not in silica.limits}
    assert made.provenance["seed"] == "3"


def test_observables_are_stacked_over_replicas(contact):
    made = age(contact, observe=[Watch()], threads=1)
    assert made.observables["barrier"].shape == (5,)
    assert np.array_equal(made.observables["counts"], made.bonds)
    assert made.observables["barrier"].tolist() == [lattice.forming.mean() for lattice, _ in Tally.followed]


def test_two_observables_of_one_name_are_refused(contact):
    with pytest.raises(PluginError, match="two observables give 'barrier'; rename one"):
        age(contact, observe=[Watch(), Watch()])


@pytest.mark.long
def test_classes_that_are_not_packaged_are_named_from_many_threads(contact):
    """Reading a source is not safe in two threads at once (Python 3.11)."""
    for _ in range(20):

        class Fresh(Tally):
            kind = "fresh"

        made = ca.age(contact, chemistry(), engine=Fresh(), hold_times=TIMES, temperature=300, replicas=16, threads=8)
        assert any(name.endswith("Fresh") for name in made.plugins)


def test_half_hydroxylated_contacts_differ_in_their_sites(contact):
    silica = chemistry(hydroxylation=0.5)
    made = ca.age(contact, silica, engine=Tally(), hold_times=TIMES, temperature=300, replicas=30)
    assert np.unique(made.sites).size > 3
    assert abs(made.sites.mean() - 600) < 30


def test_no_load_has_no_sites_and_no_bonds():
    none = ContactSolution(pressure=np.zeros((4, 4)), load=0.0, pixel_size=1.0, modulus=1.0)
    made = ca.age(none, chemistry(), engine=Tally(), hold_times=TIMES, temperature=300, replicas=2)
    assert made.sites.tolist() == [0, 0]
    assert np.isnan(made.friction_coefficient_drop).all()


def test_more_bonds_than_sites_are_refused(contact):
    class Crowded(Tally):
        kind = "crowded"

        def _run(self, *arguments):
            history = super()._run(*arguments)
            return history.model_copy(update={"bonds": history.bonds + 1200})

    with pytest.raises(PluginError, match=r"engine 'crowded' of .*bonds: up to \d+, but there are 1200 sites"):
        age(contact, engine=Crowded())


# -- what is refused --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"replicas": 0}, "replicas = 0: must be a whole number of at least 1"),
        ({"replicas": 2.5}, "replicas = 2.5"),
        ({"replicas": True}, "replicas = True"),
        ({"seed": -1}, "seed = -1: must be a whole number, 0 or larger"),
        ({"seed": 1.5}, "seed = 1.5"),
        ({"seed": "x"}, "seed = 'x'"),
        ({"threads": 0}, "threads = 0: must be a whole number of at least 1"),
        ({"hold_times": []}, "hold_times"),
        ({"hold_times": [2, 1]}, r"hold_times\[1\] = 1.0: comes after 2.0"),
        ({"temperature": 0}, "temperature = 0"),
        ({"temperature": "1 nm"}, "nanometer"),
        ({"engine": "tally"}, r"engine must be an Engine, got 'tally' \(str\); make one with chemage.engine"),
        ({"engine": Tally}, "engine must be an Engine, got .*Tally"),
        ({"observe": ["watch"]}, "observe must be an Observable, got 'watch'"),
        ({"observe": [Tally()]}, "observe must be an Observable"),
    ],
)
def test_wrong_arguments_of_age(contact, options, problem):
    with pytest.raises(InputError, match=problem):
        age(contact, **options)


def test_numpy_integers_are_whole_numbers(contact):
    assert age(contact, replicas=np.int64(5), seed=np.uint32(3)).bonds.tolist() == age(contact).bonds.tolist()


def test_stages_in_the_wrong_order_are_named(contact):
    with pytest.raises(InputError, match=r"contact must be an? Contact, got "):
        ca.age(chemistry(), contact, engine=Tally(), hold_times=TIMES, temperature=300)  # pyright: ignore
    with pytest.raises(InputError, match=r"chemistry must be an? Chemistry, got "):
        ca.plugin.build_lattice(Ladder(), contact)  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match=r"surface must be an? Surface, got "):
        ca.solve_contact(Never(), contact, 1.0)  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match=r"maker must be an? SurfaceMaker, got "):
        ca.make_surface("sphere")  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match=r"lattice must be an? ReactionLattice, got "):
        ca.plugin.run_kinetics(Tally(), contact, TIMES, temperature=300)  # pyright: ignore[reportArgumentType]
