"""Onboard software: state estimation, online learning and control.

The onboard software receives measurements and returns commands. It has no access to the true state or the true forces,
so this package does not import `colift.simulation`.

Modules:
    interfaces: protocols of the exchangeable parts of the controller.
    controller: leader-follower controller, composed of these parts.

Packages:
    estimation: states, contact forces and labels from measurements.
    learning: residual models and their online updates.
    control: tracking, force allocation, attitude and posture control of the agents.
"""
