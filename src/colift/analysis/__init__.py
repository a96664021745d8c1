"""Analysis of scenarios and flights: stability, gain tuning, preflight checks and metrics."""
