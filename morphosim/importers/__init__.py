"""Scenes from the files of others: the published MATLAB program, label images, lineage tables."""
