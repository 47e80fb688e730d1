"""What the peers have in common: reading a model and queries, timing, and writing answers for `beo bench query` to compare.

A peer is a function `prepare(model)` that returns `answer(view)`, which returns (posterior, occupancy, deviation or None).
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path

try:
    import numpy as np
    from safetensors import safe_open
    from safetensors.numpy import load_file
except ImportError as error:
    print(f"{error.name} is not installed (pip install numpy safetensors)", file=sys.stderr)
    sys.exit(77)

EMPTY, FILLED, UNKNOWN = 0, 1, 255


def softmax(x):
    e = np.exp(x - x.max())
    return e / e.sum()


def symmetric(triangles):
    """Symmetric matrices of their packed lower triangles, one per row."""
    size = int((2 * triangles.shape[1]) ** 0.5)
    matrices = np.zeros((len(triangles), size, size))
    rows, columns = np.tril_indices(size)
    matrices[:, rows, columns] = triangles
    matrices[:, columns, rows] = triangles
    return matrices


class Model:
    """The tensors of a model file, see models/README.md."""

    def __init__(self, path):
        tensors = load_file(path)
        with safe_open(path, "numpy") as file:
            self.metadata = json.loads(file.metadata()["beo"])["metadata"]
        self.dims = tuple(self.metadata["dims"])
        self.calibration = self.metadata["calibration"]
        self.noise = self.metadata["noise_variance"] * self.calibration["noise_inflation"]
        self.basis = tensors["basis"].astype(np.float32)
        self.means = tensors["class_mean"].astype(float)
        self.covariances = symmetric(tensors["class_covariance"])
        ends = np.cumsum([c["basis_size"] for c in self.metadata["classes"]])[:-1]
        self.directions = np.split(tensors["class_directions"], ends)
        self.variances = np.split(tensors["class_variances"], ends)
        self.hull_means = tensors["hull_top_mean"].astype(float)
        self.hull_scales = symmetric(tensors["hull_top_covariance"])


def main(prepare):
    parser = argparse.ArgumentParser(description="Answer queries one at a time, and print times and answers as JSON.")
    parser.add_argument("model", type=Path)
    parser.add_argument("queries", type=Path, help=".npy, uint8 (n, x, y, z): 0 empty, 1 filled, 255 unknown")
    parser.add_argument("out", type=Path, help="folder for occupancy.npy and deviation.npy, float32 (n, voxels)")
    options = parser.parse_args()
    views = np.load(options.queries)
    answer = prepare(Model(options.model))
    answer(views[0])
    nanoseconds, posteriors, occupancies, deviations = [], [], [], []
    for view in views:
        start = time.perf_counter_ns()
        posterior, occupancy, deviation = answer(view)
        nanoseconds.append(time.perf_counter_ns() - start)
        posteriors.append(posterior.tolist())
        occupancies.append(occupancy)
        if deviation is not None:
            deviations.append(deviation)
    np.save(options.out / "occupancy.npy", np.array(occupancies, dtype=np.float32))
    if deviations:
        np.save(options.out / "deviation.npy", np.array(deviations, dtype=np.float32))
    threads = int(os.environ.get("OPENBLAS_NUM_THREADS", 0)) or os.cpu_count()
    print(json.dumps({"numpy": np.__version__, "threads": threads, "ns": nanoseconds, "posteriors": posteriors}))
