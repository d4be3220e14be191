"""Tests for the components of a plugin: the requirements of each role, as checks of an instance.

.. code-block:: python

    from chemage.testing import parametrize_with_checks

    @parametrize_with_checks([Weibull(scale="1.1 eV", shape=8)])
    def test_meets_its_role(component, check):
        check(component)

or, without pytest's parametrisation, ``check_barriers(Weibull(...))``. A check that a component cannot pass is declared
with the reason: ``expected_failures={"restart_is_exact": "random numbers are drawn in sequence"}``.

The fixture ``isolated_registry`` is a registry without plugins that is in use during a test. A ``conftest.py`` imports
it with ``pytest_plugins = ["chemage.testing"]``; as a pytest entry point it would import chemage in every test session
on the machine.
"""

from chemage.testing.changes import check_observable, check_rupture
from chemage.testing.checks import (
    Check,
    CheckFailed,
    ChecksFailed,
    check_component,
    checks_for,
    isolated_registry,
    parametrize_with_checks,
)
from chemage.testing.contacts import check_contact_solver, rough_surface
from chemage.testing.engines import check_engine
from chemage.testing.every_component import check_material
from chemage.testing.lattices import check_barriers, check_interaction
from chemage.testing.pulling import check_pulling
from chemage.testing.replicas import check_ageing_method
from chemage.testing.surfaces import check_reader, check_surface_maker

__all__ = [
    "Check",
    "CheckFailed",
    "ChecksFailed",
    "check_ageing_method",
    "check_barriers",
    "check_component",
    "check_contact_solver",
    "check_engine",
    "check_interaction",
    "check_material",
    "check_observable",
    "check_pulling",
    "check_reader",
    "check_rupture",
    "check_surface_maker",
    "checks_for",
    "isolated_registry",
    "parametrize_with_checks",
    "rough_surface",
]
