"""What every room rests on: errors, units, records, components, random numbers, threads, files."""
