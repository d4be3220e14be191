"""Scaling of friction by contact area, studied with tips and rough contacts."""
