"""Lattices with several sites in a pixel: what is accepted, and that every stage treats each site as its own."""

from __future__ import annotations

import inspect
from types import ModuleType

import numpy as np
import pytest

import chemage as ca
from chemage import InputError, ReactionLattice
from chemage.plugin import registry

ENGINES = ("rejection-free", "bkl", "next-reaction", "independent", "auto")
#: a plugin whose lattice has two sites in each pixel in contact
TWO = """
    import chemage

    @chemage.plugin.hookimpl(wrapper=True)
    def chemage_build_lattice(contact, seed):
        import numpy as np
        from chemage import ReactionLattice
        from chemage.plugin import random

        lattice = yield
        sites = np.repeat(lattice.sites, 2)
        x, y = np.divmod(sites, contact.shape[1])
        along = np.tile([0.25, 0.75], lattice.sites.size)
        positions = np.stack([x + along, y + 0.5], axis=1) * contact.pixel_size
        bare = ReactionLattice(
            pixels=lattice.pixels, sites=sites, positions=positions, forming=np.zeros(sites.size),
            pixel_size=contact.pixel_size, attempt_frequency=lattice.attempt_frequency,
        )
        numbers = random.uniforms(seed, random.stream("two/forming"), bare.random_index)
        return bare.model_copy(update={"forming": 0.8 + 0.2 * numbers})
"""


def pairs(n: int = 3, **changes):
    """Two sites in each of ``n`` pixels of 0.5 nm in a row."""
    sites = np.repeat(np.arange(n), 2)
    positions = 0.5 * np.stack([sites + np.tile([0.25, 0.75], n), np.full(2 * n, 0.5)], axis=1)
    fields = {"pixels": (n, 1), "sites": sites, "positions": positions, "forming": np.full(2 * n, 0.8)}
    return ReactionLattice(**{**fields, "pixel_size": 0.5, **changes})


def test_a_lattice_with_several_sites_in_a_pixel():
    made = ReactionLattice(
        pixels=(2, 3), sites=[1, 4, 4, 4], forming=[1.0] * 4, positions=[[0.5, 1.5], [1.2, 1.5], [1.5, 1.0], [1.5, 2.0]]
    )
    assert made.positions.dtype == np.float64
    assert not made.positions.flags.writeable
    assert made.random_index.tolist() == [1, 4, 10, 16]
    assert made.per_pixel(np.array([1.0, 2.0, 3.0, 4.0])).tolist() == [[0, 1, 0], [0, 9, 0]]
    assert np.allclose(made.to_atoms().positions[1], [12.0, 15.0, 0.0])
    assert ReactionLattice.fromdict(made.todict()) == made
    empty = ReactionLattice(pixels=(2, 3), sites=[], forming=[], positions=np.empty((0, 2)))
    assert empty.random_index.size == 0
    assert empty.per_pixel(np.empty(0)).shape == (2, 3)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"positions": None}, "pixel 0 is listed twice; list each once, or give positions as well"),
        ({"sites": [0, 0, 2, 2, 1, 1]}, "sites: not in ascending order"),
        ({"positions": np.zeros((6, 3))}, r"positions: shape \(6, 3\), but there are 6 sites"),
        ({"positions": np.full((6, 2), np.nan)}, "positions: 12 of 12 values are not finite"),
        (
            {"pixel_size": 1.0},
            r"positions\[2\]: \(0.625, 0.25\) nm is outside pixel 1, whose centre is at \(1.5, 0.5\)",
        ),
    ],
)
def test_wrong_positions_are_refused(changes, problem):
    with pytest.raises(InputError, match=problem):
        pairs(**changes)


def test_a_lattice_without_positions_has_the_digest_and_the_random_numbers_of_before(examples):
    plain = examples.lattice()
    assert plain.digest() == "b62a7b1b5c856319065f3858329a9fd3"
    assert plain.random_index is plain.sites
    centred = plain.model_copy(update={"positions": 0.45 * (np.stack(np.divmod(plain.sites, 3), axis=1) + 0.5)})
    assert centred.digest() != plain.digest()
    for name in ENGINES[:3]:
        one, two = (ca.engine(name).run(made, [1e-3, 1.0], temperature=300, seed=3) for made in (plain, centred))
        assert np.array_equal(one.bonds, two.bonds)
        assert np.array_equal(one.state, two.state)


def test_files_keep_positions(tmp_path):
    made = pairs()
    ca.write(tmp_path / "lattice.h5", made)
    assert ca.read(tmp_path / "lattice.h5") == made


@pytest.mark.parametrize("name", ENGINES)
def test_the_sites_of_a_pixel_are_independent(name):
    made = pairs(4000)
    rate = 1e13 * np.exp(-0.8 / (ca.plugin.KB * 300))
    state = ca.engine(name).run(made, [np.log(2) / rate], temperature=300, seed=1).state.reshape(-1, 2)
    # 2000 ± 32 each, 1000 ± 27 both
    assert abs(state.sum() - 4000) < 5 * np.sqrt(2000)
    assert abs(np.all(state, axis=1).sum() - 1000) < 5 * np.sqrt(750)


@pytest.mark.parametrize("name", ENGINES[:3])
def test_coupled_sites_of_a_pixel_are_the_master_equation(name):
    """A bond lowers the barrier of the other site of its pixel: the mean of 4000 pairs against three states."""
    n, gain = 4000, -0.03
    near = np.arange(2 * n).reshape(n, 2)[:, ::-1].reshape(-1, 1)
    made = pairs(n, neighbours=near, coupling=np.full((2 * n, 1), gain, np.float32))
    slow, fast = (1e13 * np.exp(-(0.8 + more) / (ca.plugin.KB * 300)) for more in (0.0, gain))
    # p0' = -2 slow p0, p1' = 2 slow p0 - fast p1
    t = 0.4 / slow
    none = np.exp(-2 * slow * t)
    one = 2 * slow / (fast - 2 * slow) * (np.exp(-2 * slow * t) - np.exp(-fast * t))
    state = ca.engine(name).run(made, [t], temperature=300, seed=2).state.reshape(-1, 2).sum(axis=1)
    counts = np.bincount(state, minlength=3)
    for count, probability in zip(counts, (none, one, 1 - none - one), strict=True):
        assert abs(count - n * probability) < 5 * np.sqrt(n * probability * (1 - probability))


@pytest.fixture
def two():
    module = ModuleType("two")
    exec(inspect.cleandoc(TWO), module.__dict__)
    with registry.using(registry.Registry()) as copy:
        copy.register(module, "two")
        yield copy


@pytest.mark.parametrize("name", ["rejection-free", "next-reaction", "independent"])
def test_a_plugin_with_two_sites_in_a_pixel_ages_as_the_closed_form(two, examples, name):
    maker = ca.surface("sphere", radius="30 nm", pixels=48, pixel_size="0.4518 nm")
    contact = ca.contact("hertz", modulus="35.3 GPa").solve(maker.make(), "50 nN")
    chemistry = ca.chemistry(forming=ca.barriers("uniform", lower=0.8, upper=1.0))
    times = [1e-2, 1.0, 100.0]
    spectra = [ca.observable("pressure-spectrum"), ca.observable("barrier-spectrum")]
    ageing = ca.age(
        contact, chemistry, engine=ca.engine(name), hold_times=times, temperature=300, replicas=20, observe=spectra
    )
    n = contact.sites.size
    assert ageing.sites.tolist() == [2 * n] * 20
    assert list(ageing.plugins) == ["two"]
    energy = 0.8 + 0.2 * (np.arange(20_000) + 0.5) / 20_000
    rates = 1e13 * np.exp(-energy / (ca.plugin.KB * 300))
    for bonds, t in zip(ageing.bonds.T, times, strict=True):
        chance = -np.expm1(-rates * t).mean()
        # sum over sites of 1 - exp(-k t), and its binomial scatter
        assert abs(bonds.mean() - 2 * n * chance) < 5 * np.sqrt(2 * n * chance * (1 - chance) / 20)
    edges = ageing.observables["pressure_edges"][0]
    assert np.allclose(ageing.observables["pressures"] @ np.diff(edges), 1.0)
    again = ca.Ageing.fromdict(ageing.todict())
    assert again == ageing


def test_an_observable_adds_the_sites_of_a_pixel(two):
    lattice = pairs()
    history = ca.engine("rejection-free").run(lattice, [1e5], temperature=300)
    assert lattice.per_pixel(history.state).tolist() == [[2.0], [2.0], [2.0]]


# -- what is offered to interactions and engines ----------------------------------------------------------------------


class Far(ca.plugin.Interaction):
    """Pixels closer than ``reach`` along x, by the size of the pixels; stronger across the edge."""

    kind = "far"
    reach: ca.plugin.Length = 1.0
    """nm"""

    def neighbours(self, pixels, periodic, sites, *, pixel_size=1.0):
        step = max(1, int(self.reach / pixel_size))
        x, y = np.divmod(sites, pixels[1])
        found = np.full((sites.size, 2), -1, np.int32)
        for slot, sign in enumerate((-1, 1)):
            i = x + sign * step
            inside = (i >= 0) & (i < pixels[0])
            flat = (i % pixels[0]) * pixels[1] + y
            at = np.searchsorted(sites, flat).clip(max=max(sites.size - 1, 0))
            there = (sites[at] == flat if sites.size else np.zeros(0, bool)) & (inside | periodic) & (flat != sites)
            there &= ~(found == at[:, None]).any(axis=1)
            found[there, slot] = at[there]
        return found

    def coupling(self, sites, neighbours, seed, pixel_size=1.0, periodic=False, pixels=(0, 0)):
        assert pixels != (0, 0)
        return np.where(neighbours >= 0, 0.1 * pixel_size / self.reach * (2 if periodic else 1), 0.0)


def test_an_interaction_gets_what_it_names(examples):
    pressure = np.ones((8, 3))
    for periodic, energy in ((True, 0.1), (False, 0.05)):
        contact = examples.contact(pressure=pressure, periodic=periodic)  # pixels of 0.5 nm
        forming = ca.barriers("uniform", lower=0.8, upper=1.0)
        chemistry = ca.chemistry(forming=forming, interaction=Far(), site_density="pixel")
        lattice = chemistry.on(contact)
        assert lattice.neighbours[9, 1] == 9 + 2 * 3
        assert np.unique(lattice.coupling[lattice.neighbours >= 0]).tolist() == [energy]
        some = ca.plugin.build_lattice(chemistry.replace(hydroxylation=0.5), contact)
        assert 0 < some.sites.size < 24
    ca.testing.check_component(Far())


def test_the_hook_of_the_kinetics_gets_contact_and_chemistry(examples):
    seen = []

    class Plugin:
        @ca.plugin.hookimpl
        def chemage_run_kinetics(self, contact, chemistry, lattice):
            seen.append((contact, chemistry, lattice))

    contact = examples.contact()
    chemistry = ca.chemistry(forming=ca.barriers("uniform", lower=0.8, upper=1.0))
    engine = ca.engine("rejection-free")
    with registry.using(registry.Registry()) as copy:
        copy.register(Plugin(), "looking")
        ca.age(contact, chemistry, engine=engine, hold_times=[1.0], temperature=300, replicas=1)
        lattice = chemistry.on(contact)
        ca.plugin.run_kinetics(engine, lattice, [1.0], temperature=300)
    assert [one[:2] for one in seen] == [(contact, chemistry), (None, None)]


def test_the_hook_gets_them_where_checkpoints_are_kept(examples, tmp_path):
    seen = []

    class Plugin:
        @ca.plugin.hookimpl
        def chemage_run_kinetics(self, contact, chemistry):
            seen.append((contact, chemistry))

    contact = examples.contact()
    chemistry = ca.chemistry(forming=ca.barriers("uniform", lower=0.8, upper=1.0))
    with registry.using(registry.Registry()) as copy:
        for again in range(2):
            if again:
                copy.register(Plugin(), "looking")
            ca.age(
                contact,
                chemistry,
                engine=ca.engine("rejection-free"),
                hold_times=[1.0, 2.0],
                temperature=300,
                replicas=1,
                checkpoints=tmp_path,
            )
    # the plugin that is new is asked whether it would answer
    assert seen == [(contact, chemistry)]
