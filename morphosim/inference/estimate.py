"""Least squares of patches' offsets: what is minimised, how sure it is, and what is not told."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from morphosim.inference.offsets import Patches, rigid_motions
from morphosim.inference.unknowns import SPREAD, Unknowns

Floats = NDArray[np.float64]
NOMINAL = 0.05
"""Offset, µm, of a patch that weighs as much as what is taken for granted of an unknown."""
REACH = 4.0
"""Length over which what a model leaves over is alike, µm."""
FIRM = 10.0
"""Weight, µm, of what is held."""
TOLD = 0.5
"""An unknown is told by images if it is surer than this share of what is taken for granted."""


@dataclass(frozen=True)
class Misfit:
    """What is minimised: weighted offsets of all patches, and what is taken for granted.

    Attributes
    ----------
    patches : of each frame that is compared
    unknowns : Unknowns
    open_space : bool
        Whether cells as a whole may move: in open space they do, as attraction is no energy and
        has no counterforce, and nothing in an image tells how fast.
    """

    patches: tuple[Patches, ...]
    unknowns: Unknowns
    open_space: bool

    @cached_property
    def weight(self) -> Floats:
        """(K,) what the offset of each patch counts by."""
        return Patches.joined(self.patches).weight

    @cached_property
    def _motions(self) -> Floats:
        """(K, f) orthonormal weighted offsets that do not count."""
        if not self.open_space:
            return np.zeros((len(self.weight), 0))
        motions = block_diag(*(rigid_motions(patches) for patches in self.patches))
        return np.linalg.qr(motions * self.weight[:, None])[0]

    def weighted(self, offsets: Floats) -> Floats:
        """Offsets (K,), or slopes of them (K, n), by weight and without motions."""
        scaled = (offsets.T * self.weight).T
        return np.asarray(scaled - self._motions @ (self._motions.T @ scaled))

    @cached_property
    def granted(self) -> Floats:
        """(n + 1, n) rows of what is taken for granted of each unknown, and of what is held."""
        count = len(self.unknowns.each)
        return np.vstack([np.eye(count) * NOMINAL / SPREAD, FIRM * self.unknowns.held])

    def rows(self, offsets: Floats, vector: Floats) -> Floats:
        """What is squared and summed up."""
        off = self.granted @ (vector - self.unknowns.start)
        return np.concatenate([self.weighted(offsets), off])

    def slopes(self, slopes: Floats) -> Floats:
        """Derivative of `rows`, by that of offsets (K, n)."""
        return np.vstack([self.weighted(slopes), self.granted])

    def gain(self, slopes: Floats) -> Floats:
        """(n, K) change of the estimate by weighted offsets."""
        all_rows = self.slopes(slopes)
        return np.asarray(-np.linalg.solve(all_rows.T @ all_rows, self.weighted(slopes).T))

    def covariance(self, offsets: Floats, slopes: Floats) -> tuple[Floats, tuple[float, float]]:
        """(n, n) covariance of the estimate, and the noise of patches that it comes of, µm.

        What is left over at the estimate is taken as two parts: one that is independent from patch
        to patch, as of voxels, and one that is alike over `REACH`, as where cells are not at rest
        or the model is not quite right. Their sizes are such that what is left over has its
        squares, and its products of near patches, on average.
        """
        rows = self.slopes(slopes)
        a = self.weighted(slopes)
        inverse = np.linalg.inv(rows.T @ rows)
        left = self.weighted(offsets)
        left = left - a @ (inverse @ (a.T @ left))
        alike = self._alike()
        one, two = (k - a @ (inverse @ (a.T @ k)) for k in (np.eye(len(left)), alike))
        sums = np.array([left @ left, left @ alike @ left])
        traces = np.array(
            [[np.sum(one * one), np.sum(one * two.T)], [np.sum(one * two.T), np.sum(two * two.T)]]
        )
        white, smooth = _not_negative(traces, sums)
        gain = self.gain(slopes)
        granted = inverse * NOMINAL**2
        told = white * gain @ gain.T + smooth * gain @ alike @ gain.T
        return told + granted @ granted, (float(np.sqrt(white)), float(np.sqrt(smooth)))

    def _alike(self) -> Floats:
        """(K, K) covariance of weighted offsets of a smooth motion of 1 µm."""
        out = block_diag(*(_alike(patches) for patches in self.patches))
        return np.asarray(self.weight[:, None] * out * self.weight)


def _alike(patches: Patches) -> Floats:
    """(K, K) covariance of the offsets of a frame's patches in a smooth motion of 1 µm."""
    apart = np.linalg.norm(patches.centre[:, None] - patches.centre, axis=-1)
    cosine = patches.normal @ patches.normal.T
    return np.asarray(cosine * np.exp(-0.5 * (apart / REACH) ** 2))


def _not_negative(traces: Floats, sums: Floats) -> tuple[float, float]:
    """Variances of which neither is negative."""
    from scipy.optimize import nnls

    scale = np.sqrt(np.diag(traces))
    found, _ = nnls(traces / np.outer(scale, scale), sums / scale)
    return float(found[0] / scale[0]), float(found[1] / scale[1])
