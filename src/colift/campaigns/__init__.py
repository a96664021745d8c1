"""Campaigns: many flights of a scenario with varied settings, their store and their statistics.

spec         specification of a campaign, read from a YAML file
sampling     samples and flights of a specification
flights      simulation of a batch of flights, one row per flight
store        folder of the rows
engines      processes, Dask clusters and SLURM jobs that simulate batches
driver       simulation of all flights whose rows are missing
statistics   paired comparison of the cases
"""
