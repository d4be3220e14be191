"""Reproduction of the figures and tables of the paper, and comparison with the published numbers."""
