"""Sweeps: one scene at many points, computed into a folder, from which a later call resumes.

Points share stages by content hash: a contact is solved once for all points that use it, and a point whose file is in
the folder is skipped.
"""
