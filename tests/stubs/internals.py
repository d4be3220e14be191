"""The one support module of tests that reaches for what is private: nothing public gives it as tests need it."""

from __future__ import annotations

from chemage.results.drawing import figures as figures_of  # as matplotlib's objects, which users get as files

__all__ = ["figures_of"]
