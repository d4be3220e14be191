"""Kinetics: the history of one replica, the role of an engine, and the stage that runs one."""
