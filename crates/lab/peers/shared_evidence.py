#!/usr/bin/env python3
"""Classification and completion by the evidence in the shared basis, in NumPy: the plain way.

For each class the known voxels are w ~ N(V W' m_s, V W' S_s W'^T V^T + s2 I). With A = W'^T V^T V W' and b = W'^T V^T w,

    log p(w | s) = -1/2 [n log(2 pi s2) + log|S| + log|P| + (w.w - 2 b.m + m^T A m) / s2 - g^T P^-1 g]
    P = S^-1 + A / s2,  g = (b - A m) / s2,  posterior mean of the coefficients: m + P^-1 g

A is the matrix of all voxels less that of the unknown ones, which are fewer; b sums the few filled ones. Sums over voxels and
factorisations are in single precision, sums of logarithms in double. The completion is that of the most probable class, clamped,
without a deviation (which costs as much again).
"""

import peer  # first: it says what is missing

import numpy as np

BLOCK = 64


def forward(factors, right):
    """Solves L y = right for a stack of lower triangular matrices (m, a, a) and vectors (m, a), by blocks: NumPy has no such solver."""
    y = right.copy()
    for i in range(0, y.shape[1], BLOCK):
        block = slice(i, i + BLOCK)
        if i:
            y[:, block] -= (factors[:, block, :i] @ y[:, :i, None])[..., 0]
        y[:, block] = np.linalg.solve(factors[:, block, block], y[:, block, None])[..., 0]
    return y


def backward(factor, right):
    """Solves L^T x = right for one matrix."""
    x = right.copy()
    for i in reversed(range(0, len(x), BLOCK)):
        block, after = slice(i, i + BLOCK), slice(i + BLOCK, None)
        x[block] -= factor[after, block].T @ x[after]
        x[block] = np.linalg.solve(factor[block, block].T, x[block])
    return x


def prepare(model):
    basis, noise = model.basis, np.float32(model.noise)
    means = model.means.astype(np.float32)
    whole = basis.T @ basis
    inverses = np.linalg.inv(model.covariances).astype(np.float32)
    log_dets = np.linalg.slogdet(model.covariances)[1]

    def answer(view):
        flat = view.reshape(-1)
        filled, unknown = np.flatnonzero(flat == peer.FILLED), np.flatnonzero(flat == peer.UNKNOWN)
        rows = basis[unknown]
        A = whole - rows.T @ rows
        b = basis[filled].sum(axis=0)
        Am = means @ A
        factors = np.linalg.cholesky(inverses + A / noise)
        half = forward(factors, (b - Am) / noise)
        log_det = 2 * np.log(np.diagonal(factors, axis1=1, axis2=2).astype(float)).sum(axis=1) + log_dets
        residual = len(filled) - 2.0 * (means @ b) + (means * Am).sum(axis=1)
        evidence = -0.5 * (log_det + residual / noise - (half.astype(float) ** 2).sum(axis=1))
        posterior = peer.softmax(evidence)
        s = posterior.argmax()
        coefficients = means[s] + backward(factors[s], half[s])
        occupancy = np.zeros(len(flat), dtype=np.float32)
        occupancy[filled] = 1
        occupancy[unknown] = np.clip(rows @ coefficients, 0, 1)
        return posterior, occupancy, None

    return answer


if __name__ == "__main__":
    peer.main(prepare)
