"""Segmented images as scenes: label images of any voxels, every label a cell (paper §4)."""
