"""Experiments: drawn scenes, metrics, figures, speed."""
