"""The evidence solver: likelihoods of power and waveform, and the search for the polygon that explains the echoes."""
