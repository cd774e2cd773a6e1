"""Scenes of the C. elegans embryo, and the quality control of the paper."""
