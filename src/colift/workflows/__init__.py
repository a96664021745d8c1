"""Complete tasks on a scenario: study, certification, falsification and evaluation on held-out trajectories."""
