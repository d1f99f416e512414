"""The files that replay and the save service write."""
