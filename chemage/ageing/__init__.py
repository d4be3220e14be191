"""Ageing: replicas and their friction, the fit of β, checkpoints, observables, measured curves."""
