"""Campaigns: many runs of a scenario, sampled over its keys and seeds, here or on a dask cluster."""
