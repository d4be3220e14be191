"""Executors: where a sweep computes (this process, several processes, a Dask cluster)."""
