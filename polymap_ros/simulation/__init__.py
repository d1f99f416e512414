"""Simulated scenes, trajectories and waveforms, eq. (1)."""
