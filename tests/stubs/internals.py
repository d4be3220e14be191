"""The one support module of tests that reaches for what is private: nothing public gives it as tests need it."""

from __future__ import annotations

from seen import figures as figures_of

from chemage.cli.app import _plain_warnings as plain_warnings
from chemage.foundation.units import in_one_unit
from chemage.scene.files import parse_toml

__all__ = ["figures_of", "in_one_unit", "parse_toml", "plain_warnings"]
