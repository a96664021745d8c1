"""Columns of a table of knots, the plain form of a pose spline (without JAX, which takes long to import)."""

POSITION_COLUMNS, ATTITUDE_COLUMNS = 13, 14
"""Numbers of a knot: time, position or quaternion, and three derivatives."""
