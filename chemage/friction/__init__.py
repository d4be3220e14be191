"""Friction: from bonds to the force that breaks them, the role of a rupture law, and the stage that applies one."""
