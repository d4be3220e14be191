"""Contacts: the solution, the role that solves one, its measures and theories, and the stage that solves one."""
