"""Compiles kernels once for all workers of a parallel run: each worker some, where all would compile the same ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import chemage as ca
from chemage.foundation import algebra
from chemage.plugin import Drive


def _engine(kind: str) -> None:
    """The kernels of an engine, for couplings in single precision; with superbasins where quick tests have them."""
    for superbasins in (False,) if kind == "bkl" else (False, True):
        lattice = ca.ReactionLattice(
            pixels=(1, 2),
            sites=[0, 1],
            forming=[0.8, 0.8],
            breaking=[0.9, 0.9],
            neighbours=[[1], [0]],
            coupling=np.float32([[0.1], [0.1]]),
        )
        ca.engine(kind, superbasins=superbasins).run(lattice, [1.0], temperature=300.0)


def _contact() -> None:
    """The kernels of contacts in every precision, and those that follow a contact to friction."""
    surface = ca.surface("self-affine", pixels=64, pixel_size=0.5, rms_slope=0.1, hurst=0.8, zeta=8).make(seed=1)
    for precision in ("single", "mixed", "double"):
        contact = ca.contact("fft-bem", modulus=35.3, precision=precision).solve(surface, 400.0)
    chemistry = ca.chemistry(
        forming=ca.barriers("uniform", lower=0.8, upper=1.4), interaction=ca.interaction("elastic-pairs", strength=0.5)
    )
    chemistry.on(contact, seed=1)
    alone = ca.ReactionLattice(pixels=(1, 2), sites=[0, 1], forming=[0.8, 0.8])
    ca.engine("independent").run(alone, [1.0], temperature=300.0)


def _pulled() -> None:
    """The kernels of a pull."""
    drive = Drive(speed=1e4, bond_stiffness=10.0, transition_distance=0.05, partner="kept", shape="constant")
    alone = ca.ReactionLattice(pixels=(2, 1), sites=[0, 1], forming=[0.8, 0.8], breaking=[0.8, 0.8])
    ca.pulling("event-driven").run(alone, drive, [1e-5], temperature=300.0)


def _algebra() -> None:
    """The kernels of the algebra in a fixed order."""
    matrix = np.array([[2.0, 1.0], [1.0, 3.0], [0.0, 1.0]])
    algebra.product(matrix.T, matrix)
    algebra.forward(algebra.cholesky(matrix[:2].T @ matrix[:2]), matrix[:2])
    algebra.row_axes(matrix, 1e-12)
    algebra.least_squares(matrix.T.copy(), np.ones(3))


#: in the order in which they are handed out: of two workers, each compiles for 40 s on an AMD EPYC
TASKS: tuple[Callable[[], None], ...] = (
    _contact,
    lambda: _engine("bkl"),
    lambda: _engine("next-reaction"),
    lambda: _engine("rejection-free"),
    _algebra,
    _pulled,
)


def share(worker: int, workers: int) -> None:
    """Compile the share of this worker, into the cache on disk that all of them read."""
    for task in TASKS[worker::workers]:
        task()
