"""Reaction lattices: the sites, the chemistry that makes them, its roles, and the stage that builds a lattice."""
