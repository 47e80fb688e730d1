#!/usr/bin/env python3
"""What `beo` computes in known pose by its method `auto`, in NumPy: the same sums saved beforehand, the same classes left out.

hull        z = W'^T h by prefix sums of W' along columns; log t density of z for each class
evidence    of the classes that the hull leaves at least 1 % of the best one's posterior, in their own bases: Gram matrix of
            [B_s, mu_s, 1] over all voxels, less that over the unknown ones (stacks over tiles of columns are summed beforehand)
posterior   softmax of the weighted scores
completion  of the classes above 5 %, three at most: posterior mean and variance of each unknown voxel, calibrated
"""

import peer  # first: it says what is missing

import numpy as np

HOPELESS = 1e-2
LEAST_SHARE, MOST_PARTS = 0.05, 3
CLIP = 0.02
TILES = 10


def logit(p):
    p = np.clip(p, CLIP, 1 - CLIP)
    return np.log(p / (1 - p))


class Hulls:
    """Densities of visual hulls."""

    def __init__(self, model):
        self.dims = model.dims
        x, y, z = model.dims
        self.sums = np.cumsum(model.basis.reshape(x * y, z, -1), axis=1, dtype=np.float32).reshape(x * y * z, -1)
        factors = np.linalg.cholesky(model.hull_scales)
        self.whitening = np.ascontiguousarray(np.linalg.inv(factors), dtype=np.float32)
        self.log_volumes = -np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
        self.means = model.hull_means.astype(np.float32)
        self.nu = model.calibration["degrees_of_freedom"]

    def scores(self, hull):
        columns = hull.reshape(-1, self.dims[2])
        last, below = columns.copy(), np.zeros_like(columns)
        last[:, :-1] &= ~columns[:, 1:]
        below[:, :-1] = ~columns[:, :-1] & columns[:, 1:]
        z = self.sums[np.flatnonzero(last)].sum(axis=0) - self.sums[np.flatnonzero(below)].sum(axis=0)
        white = (self.whitening @ (z - self.means)[:, :, None])[..., 0].astype(float)
        distance2 = (white * white).sum(axis=1)
        return self.log_volumes - 0.5 * (self.nu + len(z)) * np.log1p(distance2 / self.nu)


class Tiles:
    """How a grid is cut into tiles of columns, and each tile into levels."""

    def __init__(self, dims):
        self.dims = dims
        self.edge = [-(-side // TILES) for side in dims]
        self.counts = [-(-dims[0] // self.edge[0]), -(-dims[1] // self.edge[1]), dims[2] // self.edge[2]]
        tile = lambda axis: np.arange(dims[axis]) // self.edge[axis]
        self.of_column = tile(0)[:, None] * self.counts[1] + tile(1)[None, :]
        self.starts = [np.arange(0, dims[axis], self.edge[axis]) for axis in (0, 1)]

    def grams(self, rows):
        """[tile, level]: sums of row^T row over the tile's columns, up to and including that level."""
        width = rows.shape[1]
        grid = rows.reshape(*self.dims, width)
        out = np.zeros((self.counts[0] * self.counts[1], self.counts[2], width, width), dtype=np.float32)
        for x in range(self.counts[0]):
            for y in range(self.counts[1]):
                tile = grid[x * self.edge[0] : (x + 1) * self.edge[0], y * self.edge[1] : (y + 1) * self.edge[1]]
                tile = tile[:, :, : self.counts[2] * self.edge[2]].transpose(2, 0, 1, 3).astype(float)
                levels = tile.reshape(self.counts[2], -1, width)
                out[x * self.counts[1] + y] = np.cumsum(levels.transpose(0, 2, 1) @ levels, axis=0)
        return out.reshape(len(out), self.counts[2], -1)

    def divide(self, unknown):
        """Tiles whose columns are all unknown from the bottom and up to which level; the other unknown voxels."""
        z = self.dims[2]
        stacks = np.where(unknown.all(axis=2), z, unknown.argmin(axis=2))
        common = np.minimum.reduceat(np.minimum.reduceat(stacks, self.starts[0], axis=0), self.starts[1], axis=1).reshape(-1)
        levels = np.minimum(common // self.edge[2], self.counts[2])
        taken = levels[self.of_column] * self.edge[2]
        rest = unknown & (np.arange(z) >= taken[:, :, None])
        tiles = np.flatnonzero(levels)
        return tiles, levels[tiles] - 1, np.flatnonzero(rest)


class Class:
    """A class in its own basis."""

    def __init__(self, basis, mean, directions, variances, tiles):
        self.size = len(variances)
        self.rows = np.ones((len(basis), self.size + 2), dtype=np.float32)
        self.rows[:, : self.size] = basis @ directions.T
        self.rows[:, self.size] = basis @ mean.astype(np.float32)
        self.whole = (self.rows.T @ self.rows).astype(float)
        self.tiles = tiles.grams(self.rows)
        self.scales = np.sqrt(variances)

    def condition(self, filled, division, noise):
        """Log evidence, posterior mean of the coefficients, and L^-1 Lambda^1/2."""
        k = self.size
        tiles, levels, rest = division
        rows = self.rows[rest]
        gram = self.whole - (rows.T @ rows + self.tiles[tiles, levels].sum(axis=0).reshape(k + 2, k + 2))
        sums = self.rows[filled].sum(axis=0, dtype=float)
        residual = sums[k + 1] - 2 * sums[k] + gram[k, k]
        factor = np.linalg.cholesky(np.eye(k) + self.scales[:, None] * gram[:k, :k] * self.scales / noise)
        inverse = np.linalg.inv(factor)
        half = inverse @ (self.scales * (sums[:k] - gram[:k, k]) / noise)
        log_det = 2 * np.log(np.diag(factor)).sum()
        evidence = -0.5 * (gram[k + 1, k + 1] * np.log(2 * np.pi * noise) + log_det + residual / noise - half @ half)
        return evidence, self.scales * (inverse.T @ half), inverse * self.scales


def prepare(model):
    c, m = model.calibration, len(model.means)
    hulls, tiles = Hulls(model), Tiles(model.dims)
    parts = zip(model.means, model.directions, model.variances)
    classes = [Class(model.basis, *part, tiles) for part in parts]
    levels = np.arange(model.dims[2])

    def blended(blend, hull, evidence):
        total = blend["hull"] * hull + np.array(blend["offsets"])
        return peer.softmax(total + (blend["evidence"] * evidence if evidence is not None else 0))

    def answer(view):
        filled_here, unknown_here = view == peer.FILLED, view == peer.UNKNOWN
        filled, unknown = np.flatnonzero(filled_here), np.flatnonzero(unknown_here)
        division = tiles.divide(unknown_here)

        hull = hulls.scores(filled_here | unknown_here)
        by_hull = blended(c["hull"], hull, None)
        conditioned = {s: classes[s].condition(filled, division, model.noise) for s in np.flatnonzero(by_hull >= HOPELESS * by_hull.max())}
        best = max(evidence for evidence, _, _ in conditioned.values())
        posterior = blended(c["auto"], hull, np.array([conditioned[s][0] if s in conditioned else best for s in range(m)]))

        order = np.argsort(-posterior)
        order = order[: min(max((posterior > LEAST_SHARE).sum(), 1), MOST_PARTS)]
        shares = posterior[order] / posterior[order].sum()
        mean, second, class_mean = (np.zeros(len(unknown), dtype=np.float32) for _ in range(3))
        for share, s in zip(shares.astype(np.float32), order):
            one = classes[s]
            _, coefficients, spread = conditioned.get(s) or one.condition(filled, division, model.noise)
            rows = one.rows[unknown]
            own = rows[:, : one.size]
            predicted = np.clip(rows[:, one.size] + own @ coefficients.astype(np.float32), 0, 1)
            whitened = own @ spread.T.astype(np.float32)
            mean += share * predicted
            second += share * (np.einsum("ij,ij->i", whitened, whitened) + predicted * predicted)
            class_mean += share * rows[:, one.size]
        # Of an unknown voxel the number of them from the top of its run down to it.
        above = np.minimum.accumulate(np.where(unknown_here, len(levels), levels)[:, :, ::-1], axis=2)[:, :, ::-1]
        depth = (above - levels)[unknown_here]
        k = c["completion"]
        x = k["constant"] + k["mean"] * logit(mean) + k["class_mean"] * logit(class_mean)
        x += (k["log_depth"] * np.log(depth) + k["surface"] * (depth == 1)).astype(np.float32)
        p = 1 / (1 + np.exp(-x))
        clipped = np.clip(mean, CLIP, 1 - CLIP)
        slope = abs(k["mean"]) * p * (1 - p) / (clipped * (1 - clipped))
        occupancy, deviation = (np.zeros(view.size, dtype=np.float32) for _ in range(2))
        occupancy[filled] = 1
        occupancy[unknown] = p
        deviation[unknown] = np.minimum(slope * np.sqrt(np.maximum(second - mean * mean, 0)), 0.5)
        return posterior, occupancy, deviation

    return answer


if __name__ == "__main__":
    peer.main(prepare)
