"""Back from measured ageing to the density of barriers, and forward again to conditions that were not measured."""
