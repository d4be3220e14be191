"""The publications that the components of this package cite, as BibTeX entries."""

from __future__ import annotations

HANSEN = """@article{hansen1943,
  author = {Hansen, M. H. and Hurwitz, W. N.},
  title = {On the theory of sampling from finite populations},
  journal = {The Annals of Mathematical Statistics},
  volume = {14},
  pages = {333--362},
  year = {1943},
  doi = {10.1214/aoms/1177731356},
}"""
