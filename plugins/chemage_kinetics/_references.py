"""The publications that the components of this package cite, as BibTeX entries."""

from __future__ import annotations

GIBSON = """@article{gibson2000,
  author = {Gibson, M. A. and Bruck, J.},
  title = {Efficient exact stochastic simulation of chemical systems with many species and many channels},
  journal = {The Journal of Physical Chemistry A},
  volume = {104},
  pages = {1876--1889},
  year = {2000},
  doi = {10.1021/jp993732q},
}"""

GILLESPIE = """@article{gillespie1976,
  author = {Gillespie, D. T.},
  title = {A general method for numerically simulating the stochastic time evolution of coupled chemical reactions},
  journal = {Journal of Computational Physics},
  volume = {22},
  pages = {403--434},
  year = {1976},
  doi = {10.1016/0021-9991(76)90041-3},
}"""

BORTZ = """@article{bortz1975,
  author = {Bortz, A. B. and Kalos, M. H. and Lebowitz, J. L.},
  title = {A new algorithm for {Monte Carlo} simulation of {Ising} spin systems},
  journal = {Journal of Computational Physics},
  volume = {17},
  pages = {10--18},
  year = {1975},
  doi = {10.1016/0021-9991(75)90060-1},
}"""

COX = """@book{cox1962,
  author = {Cox, D. R.},
  title = {Renewal Theory},
  publisher = {Methuen},
  year = {1962},
}"""
