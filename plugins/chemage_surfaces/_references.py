"""The publications that the components of this package cite, as BibTeX entries."""

from __future__ import annotations

JOHNSON = """@book{johnson1985,
  author = {Johnson, K. L.},
  title = {Contact Mechanics},
  publisher = {Cambridge University Press},
  year = {1985},
  doi = {10.1017/CBO9781139171731},
}"""

JACOBS = """@article{jacobs2017,
  author = {Jacobs, T. D. B. and Junge, T. and Pastewka, L.},
  title = {Quantitative characterization of surface topography using spectral analysis},
  journal = {Surface Topography: Metrology and Properties},
  volume = {5},
  pages = {013001},
  year = {2017},
  doi = {10.1088/2051-672X/aa51f8},
}"""
