"""Mathematics independent of robots.

==============  ==================================================================
``so3``         rotations and attitude errors
``linalg``      small matrix products and symmetric positive definite systems
``filters``     first- and second-order low-pass filters
``pytree``      decorator for immutable PyTrees
``vmap``        vectorization over agents that code generation can intercept
==============  ==================================================================
"""
