"""The data file of ``md-silica``: ``md_silica_barriers.csv``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from chemage_studies.density.families import Family

HEADER = """\
# Intrinsic energy barriers to forming a siloxane bridge between two hydroxylated silica surfaces.
#
# Columns: member (0: the best density; 1 to {count}: densities that fit equally well); energy in eV; probability
# density in 1/eV, joined by straight lines, zero outside.
#
# Provenance. Li, Pastewka & Szlufarska, Phys. Rev. E 98, 023001 (2018), draw the barriers from a distribution found
# by molecular dynamics (Liu & Szlufarska, Phys. Rev. Lett. 109, 186102 (2012)) that spans 0.8 to 1.4 eV. The published
# distribution is not tabulated. These densities are NOT their data: they are a stand-in on the same span, calibrated
# to the six ageing rates beta that the paper reports for rms slopes 0.05, 0.1 and 0.2 at 20 uN and 300 K, with an
# activation volume of 6.4 cubic angstrom (0.89, 0.45, 0.20) and without (0.98, 0.49, 0.24). `chemage study
# density` calibrates the three parameters of their family and writes this table;
# docs/barrier_density.md has the residuals and the limits. Versions before 0.2.0 had a symmetric triangle with its
# peak at 1.1 eV.
#
# To use barriers of your own, give the kind "tabulated" a table or samples.
"""


def table(family: Family, members: Sequence[np.ndarray]) -> str:
    """Write the table of densities with these parameters, the best one first."""
    lines = [HEADER.format(count=len(members) - 1) + "member,energy,density"]
    for number, parameters in enumerate(members):
        energies, weights = (np.array(column, dtype=float) for column in family.nodes(*parameters))
        density = weights / (0.5 * np.diff(energies) @ (weights[1:] + weights[:-1]))
        lines += [f"{number},{energy:.6g},{value:.6g}" for energy, value in zip(energies, density, strict=True)]
    return "\n".join(lines) + "\n"
