"""Installed scenes of silica contacts."""
