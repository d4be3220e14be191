"""Executors of a sweep: this process, several processes, or a Dask cluster."""
