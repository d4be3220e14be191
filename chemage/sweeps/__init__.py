"""Sweeps: one scene, many points, computed into a folder that a later call resumes.

Stages are shared by content hash: a contact is solved once for all points that rest on it, and a point whose file is in
the folder is never computed again.
"""
