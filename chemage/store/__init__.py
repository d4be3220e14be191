"""The store: results in one HDF5 file each, written whole or not at all."""
