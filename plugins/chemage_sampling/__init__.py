"""Ageing from a random sample of the sites: ``sample``."""

from __future__ import annotations

from chemage import hookimpl


@hookimpl
def chemage_register() -> dict[str, dict[str, str]]:
    """The method of this package."""
    return {"ageing": {"sample": "chemage_sampling.sample:Sample"}}
