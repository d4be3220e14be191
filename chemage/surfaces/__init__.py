"""Surfaces: the object, the role that makes one, reading from files, roughness, and the stage that makes one."""
