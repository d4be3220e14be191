"""What a pulled contact must show, at full size: ``python tests/benchmarks/pulling.py [PART ...]``.

Parts: ``master`` (interacting patches against the master equation, five seeds and three programmes), ``sliding``
(six decades of speed and of the forming rate), ``renewed`` (partners that change with slip against a transport equation),
``stability`` (where stick-slip begins), ``speed``, and ``fuzz`` (random pulls).
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "stubs"))
from pulled_models import (
    KT,
    Independent,
    Renewed,
    chi_square,
    codes,
    drive_of,
    lattice_of,
    master_equation,
    patches,
    random_pull,
)
from scipy.stats import kstest

import chemage as ca

EXACT = ca.pulling("event-driven")


def run(lattice, drive, times, **options):
    return EXACT.run(lattice, drive, times, temperature=300, **options)


def master(count: int = 20_000, steps: int = 200) -> None:
    """p-values of chi-square tests of all joint states, for 5 seeds × 3 speeds, and the convergence of the steps."""
    found = []
    for speed, forming in ((1e2, 0.55), (1e4, 0.42), (1e6, 0.3)):
        drive = drive_of(speed)
        law = ca.rupture("bell", transition_distance=0.05, speed=speed, stiffness=10)
        end = 1.04 * law.mean_forces(np.array([1.1]), 300.0)[0] / 10 / speed
        for seed in range(5):
            lattice = patches(count, seed, forming=forming)
            expected = master_equation(lattice, drive, end, steps)
            coarse = master_equation(lattice, drive, end, steps // 2)
            pulled = run(lattice, drive, [end], seed=seed, start=np.ones(9 * count, bool))
            p = chi_square(codes(pulled, count), expected, count)
            found.append(p)
            again = pulled.formed[-1] / pulled.broken[-1]
            print(f"{speed:8.0e} nm/s  seed {seed}  p = {p:.3f}  formed again {again:.2f}", end="  ")
            print(f"half the steps: {abs(expected - coarse).sum():.1e}")
    print(f"the 15 p-values are uniform: Kolmogorov-Smirnov p = {kstest(found, 'uniform').pvalue:.3f}")


def sliding() -> None:
    """Deviations from the closed form in standard errors, over six decades of speed and of the forming rate."""
    deviations, balance = [], 0.0
    for decade in range(7):
        forming = KT * np.log(1e13 / 10.0 ** (decade + 1))
        for speed in 10.0 ** np.arange(7):
            model = Independent(speed, drive_of(speed), 0.8, forming)
            cycle = speed / model.k_on + model.stretch[np.searchsorted(model.hazard, 1)]
            # sites that begin together take long to lose step
            times = np.array([80, 120]) * cycle / speed
            pulls = [run(lattice_of(400, forming, 0.8), model.drive, times, seed=seed) for seed in range(16)]
            forces = [np.diff(one.work)[0] / (np.diff(times)[0] * speed * 400) for one in pulls]
            error = np.std(forces, ddof=1) / 4
            balance = max(balance, *(float(np.abs(one.imbalance).max()) for one in pulls))
            deviations.append((np.mean(forces) - model.mean_force) / error)
            if abs(deviations[-1]) > 2.5:
                print(f"{speed:g} nm/s, k_on {model.k_on:.3g} Hz: {deviations[-1]:+.2f} standard errors")
    print(f"{len(deviations)} points: deviations in standard errors, rms {np.std(deviations):.2f}")
    print(f"largest {np.abs(deviations).max():.2f}, {np.count_nonzero(np.abs(deviations) > 3)} above 3")
    print(f"energy balance within {balance:.1e}")


def renewed_force(model: Renewed, n: int, spacings: tuple[int, int], replicas: int) -> tuple[float, float]:
    """Mean force per site over these spacings of slip, nN, and its standard error."""
    times = np.array(spacings) * model.spacing / model.drive.speed
    forces = []
    for seed in range(replicas):
        lattice, partners = model.sites(n, seed)
        pulled = EXACT.run(lattice, model.drive, times, temperature=300, seed=seed, partners=partners)
        forces.append(np.diff(pulled.work)[0] / np.diff(times)[0] / model.drive.speed / n)
    return float(np.mean(forces)), float(np.std(forces, ddof=1) / replicas**0.5)


#: barriers to forming and breaking, stiffness of bonds, shares of free sites that bind
RENEWED = {
    "one height": ((0.7,), (0.8,), 10.0),
    "0.70 and 0.85 eV": ((0.7, 0.85), (0.8,), 10.0),
    "0.60 and 1.00 eV": ((0.6, 1.0), (0.8,), 10.0),
    "both barriers": ((0.6, 0.75), (0.7, 0.85), 10.0),
    "spectrum": (tuple(np.linspace(0.6, 1.0, 32)), (0.8,), 10.0),
    "soft bonds": ((0.6, 1.0), (0.8,), 1.0),
}


def renewed(bonds: float = 1e5, most: float = 2e8) -> None:
    """Deviations of steady sliding from the transport equation, from 0.1 nm/s to 0.1 mm/s; of so many bonds that form,
    but ``most`` partners that sites meet."""
    found = []
    for name, (forming, breaking, stiffness) in RENEWED.items():
        for speed in 10.0 ** np.arange(-1, 6):
            drive = drive_of(speed, bond_stiffness=stiffness, partner="renewed")
            model, begin = Renewed(drive, forming, breaking), time.process_time()
            # bonds that form in a site on one spacing, about
            rate = 1e13 * np.exp(-np.array(forming) / KT) * model.spacing / speed
            share = float(np.mean(rate / (1 + rate)))
            spacings = min(max(bonds / share, 1e5), most) / 16
            ahead = int(40 + 3 / share) if share > 0.01 else 40
            slid = int(max(3 * ahead, 60))
            mean, error = renewed_force(model, int(spacings / slid) + 1, (ahead, ahead + slid), 16)
            exact = model.mean_force
            found.append((mean - exact) / error)
            print(
                f"{name}, {speed:g} nm/s: {mean:.5g} nN, {100 * (mean / exact - 1):+.2f} ± {100 * error / exact:.2f} %, "
                f"{found[-1]:+.1f} standard errors, {time.process_time() - begin:.0f} s",
                flush=True,
            )
    print(f"{len(found)} forces: rms {np.std(found):.2f}, largest {np.abs(found).max():.2f} standard errors")


def amplitudes(model: Independent, n: int, stiffnesses: np.ndarray, omega: float, seed: int) -> np.ndarray:
    """Of the oscillation of the force in each of 8 periods after a step of the speed by 7 %, (k, 8) complex."""
    lattice, speed, period = lattice_of(n, model.forming, model.breaking), model.speed, 2 * np.pi / omega
    # steady sliding, in which sites that began together have lost step
    before = run(lattice, drive_of(0.93 * speed), [60 * period], seed=seed)
    times = before.time + np.linspace(0, 8 * period, 800, endpoint=False)
    wave = np.exp(-1j * omega * (times - before.time)).reshape(8, 100)
    found = []
    for stiffness in stiffnesses:
        force = run(lattice, drive_of(speed, spring=stiffness), times, seed=seed, start=before).force.reshape(8, 100)
        found.append(((force - force.mean(axis=1, keepdims=True)) * wave).mean(axis=1) / n)
    return np.array(found)


def stability(n: int = 20_000, seeds: int = 24) -> None:
    """Stiffness at which an oscillation neither grows nor decays, beside that of the linear stability of the model."""
    factors = np.array([0.9, 0.95, 1.05, 1.1])
    for speed, forming in ((1e4, 0.5), (1e3, 0.55)):
        model = Independent(speed, drive_of(speed), 0.8, forming)
        critical, omega = model.critical()
        # the response to the step is the same in all, their noise is not
        each = np.array([amplitudes(model, n, factors * critical * n, omega, seed) for seed in range(seeds)])

        def zero(chosen: np.ndarray) -> tuple[float, np.ndarray]:
            size = np.abs(chosen.mean(axis=0))
            rates = np.polyfit(np.arange(1, 5), np.log(size[:, 1:5]).T, 1)[0]
            slope, offset = np.polyfit(factors, rates, 1)
            return -offset / slope, rates

        at, rates = zero(each)
        left = [zero(np.delete(each, seed, axis=0))[0] for seed in range(seeds)]
        error = np.std(left) * (seeds - 1) ** 0.5
        shown = ", ".join(f"{f:g}: {r:+.3f}" for f, r in zip(factors, rates, strict=True))
        print(f"{speed:g} nm/s: theory {critical:.4g} nN/nm per site, growth per period at parts of it {shown}")
        print(f"  zero at {at:.3f} ± {error:.3f} (jackknife) of it")


def speed() -> None:
    """Seconds of a rigid pull of 60,000 sites through its peak, and events per second in steady sliding."""
    n = 60_000
    rng = np.random.default_rng(1)
    plain = lattice_of(n, rng.uniform(0.8, 1.4, n), rng.normal(1.1, 0.02, n))
    run(plain, drive_of(1e3), [0.0])
    for what, forming, times in (("through the peak", None, 5e-4), ("sliding", 0.3, 3e-3)):
        lattice = plain if forming is None else plain.model_copy(update={"forming": np.full(n, forming)})
        for spring in (None, 1e6):
            begin = time.process_time()
            pulled = run(lattice, drive_of(1e3, spring=spring), np.linspace(0, times, 51), start=np.ones(n, bool))
            spent = time.process_time() - begin
            events = int(pulled.formed[-1] + pulled.broken[-1])
            print(f"{what}, spring {spring}: {events} events, {spent:.2f} CPU s, {events / spent:.3g} events/s")


def foreseen(lattice, drive, times, options) -> float:
    """Events that a pull is expected to have, as it says when it may have none."""
    try:
        ca.pulling("event-driven", most_events=1e-300).run(lattice, drive, times, **options)
    except ca.InputError as refused:
        return float(str(refused).split("about ")[1].split()[0])
    return 0.0


def fuzz(count: int = 400) -> None:
    """Random pulls over many decades: balance of energy, seconds, and events foreseen over those that happened."""
    worst, longest, refused, faults, off = 0.0, 0.0, 0, 0, []
    for seed in range(count):
        lattice, drive, times, options = random_pull(seed)
        begin = time.process_time()
        try:
            pulled = EXACT.run(lattice, drive, times, **options)
        except ca.InputError as error:
            refused += 1
            print(f"{seed}: {error}")
            continue
        finally:
            longest = max(longest, time.process_time() - begin)
        worst = max(worst, float(np.abs(pulled.imbalance).max()))
        faults += bool(pulled.fault())
        if (events := int(pulled.formed[-1] + pulled.broken[-1])) > 1000:
            off.append(foreseen(lattice, drive, times, options) / events)
    print(f"{count} pulls: {faults} contradict themselves, balance of energy within {worst:.1e}")
    print(f"{refused} refused, longest {longest:.1f} CPU s; foreseen over happened {min(off):.2f} to {max(off):.2f}")


if __name__ == "__main__":
    parts = {
        "master": master,
        "sliding": sliding,
        "renewed": renewed,
        "stability": stability,
        "speed": speed,
        "fuzz": fuzz,
    }
    for name in sys.argv[1:] or parts:
        print(f"-- {name}")
        parts[name]()
