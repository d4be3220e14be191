"""Calibration of the density of barriers of ``md-silica`` to the published ageing rates."""
