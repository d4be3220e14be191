"""The publications that the components of this package cite, as BibTeX entries."""

from __future__ import annotations

HERTZ = """@article{hertz1881,
  author = {Hertz, H.},
  title = {{\\"U}ber die Ber{\\"u}hrung fester elastischer K{\\"o}rper},
  journal = {Journal f{\\"u}r die reine und angewandte Mathematik},
  volume = {92},
  pages = {156--171},
  year = {1881},
  doi = {10.1515/crll.1882.92.156},
}"""

JOHNSON = """@book{johnson1985,
  author = {Johnson, K. L.},
  title = {Contact Mechanics},
  publisher = {Cambridge University Press},
  year = {1985},
  doi = {10.1017/CBO9781139171731},
}"""

PERSSON = """@article{persson2001,
  author = {Persson, B. N. J.},
  title = {Theory of rubber friction and contact mechanics},
  journal = {The Journal of Chemical Physics},
  volume = {115},
  pages = {3840--3861},
  year = {2001},
  doi = {10.1063/1.1388626},
}"""

PERSSON_ENERGY = """@article{persson2008,
  author = {Persson, B. N. J.},
  title = {On the elastic energy and stress correlation in the contact between elastic solids with randomly rough surfaces},
  journal = {Journal of Physics: Condensed Matter},
  volume = {20},
  pages = {312001},
  year = {2008},
  doi = {10.1088/0953-8984/20/31/312001},
}"""  # noqa: E501

MANNERS = """@article{manners2006,
  author = {Manners, W. and Greenwood, J. A.},
  title = {Some observations on {Persson's} diffusion theory of elastic contact},
  journal = {Wear},
  volume = {261},
  pages = {600--610},
  year = {2006},
  doi = {10.1016/j.wear.2006.01.007},
}"""

POLONSKY = """@article{polonsky1999,
  author = {Polonsky, I. A. and Keer, L. M.},
  title = {A numerical method for solving rough contact problems based on the multi-level multi-summation and conjugate gradient techniques},
  journal = {Wear},
  volume = {231},
  pages = {206--219},
  year = {1999},
  doi = {10.1016/S0043-1648(99)00113-1},
}"""  # noqa: E501

BUGNICOURT = """@article{bugnicourt2018,
  author = {Bugnicourt, R. and Sainsot, P. and Dureisseix, D. and Gauthier, C. and Lubrecht, A. A.},
  title = {{FFT}-based methods for solving a rough adhesive contact: description and convergence study},
  journal = {Tribology Letters},
  volume = {66},
  pages = {29},
  year = {2018},
  doi = {10.1007/s11249-017-0980-z},
}"""

VOLLEBREGT = """@article{vollebregt2014,
  author = {Vollebregt, E. A. H.},
  title = {The bound-constrained conjugate gradient method for non-negative matrices},
  journal = {Journal of Optimization Theory and Applications},
  volume = {162},
  pages = {931--953},
  year = {2014},
  doi = {10.1007/s10957-013-0499-x},
}"""
