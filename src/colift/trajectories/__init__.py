"""Reference trajectories of the payload.

====================  ==================================================================
``base``              setpoint, protocol of a trajectory, exact derivatives of a pose
``lissajous``         sinusoidal position and attitude
``knots``             columns of a table of knots
``pose_spline``       polynomials in position and rotation legs in attitude
``rotation_legs``     rotation legs through attitudes on SO(3), and their rates
``minimum_snap``      pose spline through waypoints
``smoothing_spline``  pose spline of a table of poses
``departure``         smooth departure from another trajectory
====================  ==================================================================
"""
