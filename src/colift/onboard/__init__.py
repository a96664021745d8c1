"""Onboard software: controller, state estimation and online learning.

Nothing in this package imports ``colift.simulation``. Measurements are its only input from the simulated world.

==================  ==================================================================
``interfaces``      protocols of the controller and of its parts, `ControlContext`
``controller``      leader-follower controller, composed of the parts
``control``         payload tracking, force allocation, agent control
``estimation``      state estimation and labels
``learning``        residual models, data recording, online updates
==================  ==================================================================
"""
