"""Numba kernels of MorphoSim: flat functions on arrays that the caller owns.

Installed as `morphosim.kernels`. Nothing here allocates inside the time step, knows about
objects of the package, or imports anything but NumPy, Numba and math.
"""
