"""The eggshell of C. elegans (Supplementary Note 1.4)."""

import numpy as np

from morphosim.geometry.confinement import EllipsoidShell

EGGSHELL = EllipsoidShell(
    center=(30.0, 20.0, 15.0),
    semi_axes=(28.2846, 28.2846 * 0.665, 28.2846 * 0.455),
    cut=(np.inf, np.inf, 28.2846 * 0.361),
)
"""The program's eggshell; on its lattice the same voxels as its file Example_Eggshell.mat."""
