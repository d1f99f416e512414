"""The published solver, eqs. (5)-(10)."""
