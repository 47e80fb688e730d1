#!/usr/bin/env python3
"""Recomputes what `beo perceive` answers, in float64 from the equations, and compares.

    check_scores.py MODEL BEO DIR SPLIT [--queries 50] [--seed 0]

MODEL is a model file, BEO the program, DIR/<class>/SPLIT/*.binvox the shapes at the model's resolution. Nothing here is
shared with the program: the file is read with `safetensors.numpy`, shapes with an own reader, and every matrix is dense.

o    a complete object, d voxels            w    the known voxels of a query, V their selection
W'   basis, d x a                           h    visual hull: 1 where a voxel is filled or unknown
B_s  W' directions_s^T, d x k_s             mu_s W' mean_s

hull      z = W'^T h; log t_nu(z; m_s, S_s) = -1/2 log|S_s| - (nu + a)/2 log(1 + (z - m_s)^T S_s^-1 (z - m_s) / nu)
evidence  log N(w; V mu_s, V B_s L_s B_s^T V^T + s2 I), by the determinant lemma and Woodbury's identity
mean      -||w - V mu_s||^2
paper     o' of 1/2 ||V W' o' - w||^2 + lambda ||o'||_1, then log N(o'; mean_s, covariance_s)
posterior softmax of (weights of the blend) . scores + offsets
yaw       the hull's score plus -(|h|^2 - |z|^2) / 2, at its best whole degree, against the program's search
Constants common to all classes (of nu, a and 2 pi) are left out of hull and paper scores.

Exit code: 0 they agree, 1 they do not, 2 wrong usage, 77 NumPy or safetensors is missing.
"""

import argparse
import json
import math
import subprocess
import sys
import zlib
from pathlib import Path

try:
    import numpy as np
    from safetensors.numpy import load_file
except ImportError as error:
    print(f"skipped: {error.name} is not installed (pip install numpy safetensors)")
    sys.exit(77)

TOLERANCE = 1e-3  # of posteriors; of scores relative to max(1, |score|)
VOXELS = 2  # of completions
YAW_QUERIES = 20
HOPELESS = 0.01
FEWEST_FILLED = 16
UNKNOWN, EMPTY, FILLED = 255, 0, 1
RUNS = {
    "auto": ["--method", "auto"],
    "hull": ["--method", "hull"],
    "evidence": ["--method", "evidence"],
    "mean": ["--method", "mean"],
    "paper": ["--method", "paper", "--projection", "lasso"],
    "paper, ridge": ["--method", "paper", "--projection", "ridge"],
}


# The files


def read_header(path):
    """The table of tensors, and the program's description as text."""
    with open(path, "rb") as file:
        length = int.from_bytes(file.read(8), "little")
        header = json.loads(file.read(length))
    return header, header.pop("__metadata__")["beo"]


def check_sums(path):
    """Names of tensors (or `header`) that do not match their CRC-32."""
    header, text = read_header(path)
    description = json.loads(text)
    data = Path(path).read_bytes()
    start = 8 + int.from_bytes(data[:8], "little")
    wrong = []
    for name, entry in header.items():
        first, last = entry["data_offsets"]
        if zlib.crc32(data[start + first : start + last]) != description["checksums"][name]:
            wrong.append(name)
    # The sum of the header covers [metadata, checksums, table], metadata and checksums as they stand in the text.
    table = {n: [e["dtype"], e["shape"], e["data_offsets"][1] - e["data_offsets"][0]] for n, e in sorted(header.items())}
    cut = text.index(',"checksums":{')
    metadata = text[len('{"metadata":') : cut]
    sums = text[cut + len(',"checksums":') : text.index("}", cut) + 1]
    covered = f"[{metadata},{sums},{json.dumps(table, separators=(',', ':'))}]"
    if zlib.crc32(covered.encode()) != description["checksum"]:
        wrong.append("header")
    return wrong


def read_binvox(path):
    """A boolean grid [x][y][z]. On disk y runs fastest, then z, then x."""
    text, _, runs = path.read_bytes().partition(b"\ndata\n")
    dims = next(line.split()[1:] for line in text.splitlines() if line.startswith(b"dim"))
    x, z, y = (int(n) for n in dims)
    runs = np.frombuffer(runs, dtype=np.uint8).reshape(-1, 2)
    voxels = np.repeat(runs[:, 0], runs[:, 1]).astype(bool)
    return voxels.reshape(x, z, y).transpose(0, 2, 1)


def top_view(solid):
    """Seen from +z: unknown below the first filled voxel of each column, otherwise what is there."""
    from_above = solid[:, :, ::-1]
    hits = np.cumsum(from_above, axis=2)
    below = (hits > 0) & ~((hits == 1) & from_above)
    view = np.where(below, UNKNOWN, from_above.astype(np.uint8))
    return view[:, :, ::-1].astype(np.uint8)


def depths(view):
    """For each unknown voxel the number of unknown voxels in a row from the top one down to it."""
    depth = np.zeros(view.shape, dtype=int)
    above = np.zeros(view.shape[:2], dtype=int)
    for k in reversed(range(view.shape[2])):
        above = np.where(view[:, :, k] == UNKNOWN, above + 1, 0)
        depth[:, :, k] = above
    return depth


def choose(folder, split, classes, count, seed):
    """About `count` shapes, as many of each class as there are, drawn by `seed`."""
    rng = np.random.default_rng(seed)
    piles = []
    for name in classes:
        files = sorted((folder / name / split).glob("*.binvox"))
        piles.append([files[i] for i in rng.permutation(len(files))])
    chosen = []
    while len(chosen) < count and any(piles):
        for pile in piles:
            while pile and len(chosen) < count:
                path = pile.pop()
                if read_binvox(path).sum() >= FEWEST_FILLED:
                    chosen.append(path)
                    break
    return chosen


# The equations


class Gaussian:
    """What quadratic forms and determinants of a symmetric positive definite matrix need."""

    def __init__(self, mean, covariance):
        self.mean = mean.astype(float)
        factor = np.linalg.cholesky(covariance.astype(float))
        self.inverse_factor = np.linalg.inv(factor)
        self.log_determinant = 2 * np.log(np.diag(factor)).sum()

    def distance2(self, z):
        return ((self.inverse_factor @ (z - self.mean)) ** 2).sum()

    def log_density(self, z):
        return -0.5 * (self.log_determinant + self.distance2(z))

    def log_student(self, z, nu):
        return -0.5 * self.log_determinant - 0.5 * (nu + len(z)) * math.log1p(self.distance2(z) / nu)


def softmax(x):
    e = np.exp(x - x.max())
    return e / e.sum()


def logit(p):
    p = np.clip(p, 0.02, 0.98)
    return np.log(p / (1 - p))


def lasso(A, b, penalty, tolerance=5e-3, sweeps=100):
    """Cyclic coordinate descent from zero, until no coefficient moves by more than `tolerance` of the largest.

    Returns one solution; or two neighbouring sweeps', where the test for the end is so close (0.1 %) that single precision
    decides it.
    """
    x, Ax = np.zeros(len(b)), np.zeros(len(b))
    solutions = []
    for _ in range(sweeps):
        before = x.copy()
        for j in range(len(b)):
            if A[j, j] <= 1e-9:
                continue
            partial = b[j] - Ax[j] + A[j, j] * x[j]
            new = math.copysign(max(abs(partial) - penalty, 0.0), partial) / A[j, j]
            Ax += A[:, j] * (new - x[j])
            x[j] = new
        largest = np.abs(x).max()
        moved = np.abs(x - before).max() / largest if largest > 0 else 0.0
        if moved <= 1.001 * tolerance:
            solutions.append(x.copy())
        if moved <= 0.999 * tolerance:
            break
    return solutions or [x]


def symmetric(triangles):
    """Symmetric matrices of their packed lower triangles, one per row."""
    size = int((2 * triangles.shape[1]) ** 0.5)
    matrices = np.zeros((len(triangles), size, size), triangles.dtype)
    rows, columns = np.tril_indices(size)
    matrices[:, rows, columns] = triangles
    matrices[:, columns, rows] = triangles
    return matrices


class Model:
    def __init__(self, path):
        tensors = load_file(path)
        self.metadata = json.loads(read_header(path)[1])["metadata"]
        self.calibration = self.metadata["calibration"]
        self.names = [c["name"] for c in self.metadata["classes"]]
        self.basis = tensors["basis"].astype(float)
        self.noise = self.metadata["noise_variance"] * self.calibration["noise_inflation"]
        self.means = self.basis @ tensors["class_mean"].astype(float).T
        ends = np.cumsum([c["basis_size"] for c in self.metadata["classes"]])
        directions = np.split(tensors["class_directions"].astype(float), ends[:-1])
        self.bases = [self.basis @ rows.T for rows in directions]
        self.variances = np.split(tensors["class_variances"], ends[:-1])
        self.hulls = [Gaussian(m, c) for m, c in zip(tensors["hull_top_mean"], symmetric(tensors["hull_top_covariance"]))]
        self.complete = [Gaussian(m, c) for m, c in zip(tensors["class_mean"], symmetric(tensors["class_covariance"]))]
        self.skewness = np.abs(self.basis.T @ self.basis - np.eye(self.basis.shape[1])).max()

    def conditional(self, s, known, w):
        """Log evidence of class s, and posterior mean of its coefficients."""
        B, variances, s2 = self.bases[s][known], self.variances[s], self.noise
        residual = w - self.means[known, s]
        A = B.T @ B
        precision = np.diag(1 / variances) + A / s2
        g = B.T @ residual / s2
        factor = np.linalg.cholesky(precision)
        half = np.linalg.solve(factor, g)
        # |S| for S = V B L B^T V^T + s2 I is s2^d' |L| |L^-1 + A / s2|
        log_det = len(w) * math.log(s2) + np.log(variances).sum() + 2 * np.log(np.diag(factor)).sum()
        quadratic = residual @ residual / s2 - half @ half
        evidence = -0.5 * (len(w) * math.log(2 * math.pi) + log_det + quadratic)
        return evidence, np.linalg.solve(factor.T, half)

    def answers(self, view):
        """By run, the acceptable (raw scores, posterior, filled voxels): one, or two where `lasso` gives two."""
        flat = view.reshape(-1)
        known, unknown = np.flatnonzero(flat != UNKNOWN), np.flatnonzero(flat == UNKNOWN)
        w = (flat[known] == FILLED).astype(float)
        m = len(self.names)

        z = self.basis.T @ (flat != EMPTY).astype(float)
        hull = np.array([g.log_student(z, self.calibration["degrees_of_freedom"]) for g in self.hulls])
        evidence, coefficients = zip(*(self.conditional(s, known, w) for s in range(m)))
        evidence = np.array(evidence)
        distance = -((w[:, None] - self.means[known]) ** 2).sum(axis=0)

        def filled(p):
            return int(w.sum()) + int((p >= 0.5).sum())

        depth = depths(view).reshape(-1)[unknown]

        def by_evidence(posterior):
            """Calibrated probability of the unknown voxels: classes above 5 %, at least one, at most three."""
            order = np.argsort(-posterior)
            order = order[: min(max((posterior > 0.05).sum(), 1), 3)]
            shares = posterior[order] / posterior[order].sum()
            mean, class_mean = np.zeros(len(unknown)), np.zeros(len(unknown))
            for share, s in zip(shares, order):
                predicted = self.means[unknown, s] + self.bases[s][unknown] @ coefficients[s]
                mean += share * np.clip(predicted, 0, 1)
                class_mean += share * self.means[unknown, s]
            c = self.calibration["completion"]
            t = c["constant"] + c["mean"] * logit(mean) + c["class_mean"] * logit(class_mean)
            t += c["log_depth"] * np.log(np.maximum(depth, 1)) + c["surface"] * (depth == 1)
            return 1 / (1 + np.exp(-t))

        def blended(name):
            blend = self.calibration[name]
            said = evidence
            if name == "auto":
                # Classes that the hull leaves less than 1 % of the best one's posterior count with the best evidence of the others.
                by_hull = blended("hull")
                likely = by_hull >= HOPELESS * by_hull.max()
                said = np.where(likely, evidence, evidence[likely].max())
            total = blend["hull"] * hull + blend["evidence"] * said + blend["distance"] * distance
            return softmax(total + np.array(blend["offsets"]))

        out = {}
        for name, raw in (("auto", hull), ("hull", hull), ("evidence", evidence)):
            posterior = blended(name)
            out[name] = [(raw, posterior, filled(by_evidence(posterior)))]
        posterior = blended("mean")
        out["mean"] = [(distance, posterior, filled(self.means[unknown, posterior.argmax()]))]

        rows = self.basis[known]
        A, b = rows.T @ rows, rows.T @ w
        ridge = np.linalg.solve(A + 1e-3 * np.eye(len(b)), b)
        for name, solutions in (("paper", lasso(A, b, 1e-5)), ("paper, ridge", [ridge])):
            out[name] = []
            for projected in solutions:
                scores = np.array([g.log_density(projected) for g in self.complete])
                out[name].append((scores, softmax(scores), filled(self.basis[unknown] @ projected)))
        return out


# The comparison


def ask(program, model, files, arguments):
    """The program's answers, in the order of `files`."""
    command = [program, "perceive", *files, "--model", model, "--json", *arguments]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(arguments)}: the program failed: {done.stderr.strip()}")
    answers = [json.loads(line) for line in done.stdout.splitlines()]
    if [a["file"] for a in answers] != [str(f) for f in files]:
        sys.exit("the program answered other files than it was asked")
    return answers


def differences(answer, expected, names):
    """Of one answer: (posterior, score or None, class, filled voxels)."""
    raw, posterior, filled = expected
    theirs = np.array([answer["posterior"][c] for c in names])
    score = None
    if "log_score" in answer:
        scores = np.array([answer["log_score"][c] for c in names])
        score = (np.abs(scores - raw) / np.maximum(1, np.abs(raw))).max()
    other = int(answer["class"] != names[posterior.argmax()])
    return np.abs(theirs - posterior).max(), score, other, abs(answer["completion"]["filled"] - filled)


def turned(solid, degrees):
    """Counter-clockwise about +z through the grid's centre, nearest neighbour; what enters is empty."""
    n = np.array(solid.shape[:2])
    x, y = np.meshgrid(*(np.arange(k) - (k - 1) / 2 for k in n), indexing="ij")
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    i, j = np.rint(c * x + s * y + (n[0] - 1) / 2).astype(int), np.rint(c * y - s * x + (n[1] - 1) / 2).astype(int)
    inside = (i >= 0) & (i < n[0]) & (j >= 0) & (j < n[1])
    out = solid[i.clip(0, n[0] - 1), j.clip(0, n[1] - 1)].copy()
    out[~inside] = False
    return out


def exhaustive_yaw(model, view):
    """Score of each class at every whole degree: log t_nu(z) - (|h|^2 - |z|^2) / 2, h the hull turned back."""
    hull = view != EMPTY
    hulls = np.stack([turned(hull, -r).reshape(-1) for r in range(360)]).astype(float)
    z = hulls @ model.basis
    outside = hulls.sum(axis=1) - (z**2).sum(axis=1)
    nu = model.calibration["degrees_of_freedom"]
    return np.array([[g.log_student(z[r], nu) for g in model.hulls] for r in range(360)]) - 0.5 * outside[:, None]


def check_yaw(model, path, program, files, queries):
    """The program's search against an exhaustive one. Gives the median shortfall of the best class's score in nats of the
    posterior, queries of another class, and the greatest angle between both, where only one pose is likely.

    The median, as neighbouring angles differ by some nats: which voxels are nearest changes with every turn."""
    weight, offsets = model.calibration["hull"]["hull"], np.array(model.calibration["hull"]["offsets"])
    shortfalls, others, apart = [], 0, 0.0
    for n, file in enumerate(files[:queries]):
        degrees = 17.0 * n % 360
        answer = ask(program, path, [file], ["--pose", "yaw", "--turn", str(degrees)])[0]
        scores = exhaustive_yaw(model, top_view(turned(read_binvox(file), degrees)))
        best = scores.max(axis=0)
        s = int((weight * best + offsets).argmax())
        others += answer["class"] != model.names[s]
        shortfalls.append(weight * (best[s] - answer["log_score"][model.names[s]]))
        first = answer["hypotheses"][0]
        if first["probability"] > 0.9:
            yaw = np.degrees(2 * np.arctan2(first["rotation"][2], first["rotation"][3]))
            apart = max(apart, abs((yaw - scores[:, model.names.index(first["class"])].argmax() + 180) % 360 - 180))
    return np.median(shortfalls), others, apart


def main():
    parser = argparse.ArgumentParser(description="Compare `beo perceive` with NumPy, computed from the equations.")
    parser.add_argument("model", type=Path)
    parser.add_argument("beo", type=Path)
    parser.add_argument("dir", type=Path)
    parser.add_argument("split")
    parser.add_argument("--queries", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    program = options.beo.resolve()

    wrong = check_sums(options.model)
    model = Model(options.model)
    files = choose(options.dir, options.split, model.names, options.queries, options.seed)
    if not files:
        sys.exit(f"no .binvox file in {options.dir}/<class>/{options.split}")
    views = [top_view(read_binvox(path)) for path in files]
    if list(views[0].shape) != model.metadata["dims"]:
        sys.exit(f"{files[0]} is a grid of {views[0].shape}, the model answers {model.metadata['dims']}")
    mine = [model.answers(view) for view in views]

    print(f"{len(model.names)} classes, rank {model.basis.shape[1]}, {len(files)} queries")
    print(f"checksums: {'wrong in ' + ', '.join(wrong) if wrong else 'as stated'}")
    print(f"basis: largest entry of |W'^T W' - I| {model.skewness:.1e}")
    print(f"\n{'method':14}{'posterior':>12}{'score':>12}{'class':>8}{'filled':>8}   largest differences; class: queries")
    failed = bool(wrong) or model.skewness > 1e-3
    for name, arguments in RUNS.items():
        found = []
        for answer, expected in zip(ask(program, options.model, files, arguments), (m[name] for m in mine)):
            candidates = [differences(answer, one, model.names) for one in expected]
            found.append(min(candidates, key=lambda d: (d[1] or 0, d[3], d[0])))
        posterior = np.max([d[0] for d in found])
        score = np.max([d[1] for d in found]) if all(d[1] is not None for d in found) else None
        classes, voxels = sum(d[2] for d in found), max(d[3] for d in found)
        # `not <=` rather than `>`: what is not a number does not agree.
        bad = not posterior <= TOLERANCE or score is not None and not score <= TOLERANCE or classes > 0 or voxels > VOXELS
        failed |= bad
        shown = "-" if score is None else f"{score:.1e}"
        print(f"{name:14}{posterior:12.1e}{shown:>12}{classes:8}{voxels:8}{'   <- differs' if bad else ''}")
    if model.hulls:
        shortfall, others, apart = check_yaw(model, options.model, program, files, YAW_QUERIES)
        bad = shortfall > 0.1 or others > 1 or apart > 5
        failed |= bad
        count = min(YAW_QUERIES, len(files))
        print(f"yaw, {count} queries, against every whole degree: score lower by {shortfall:.2f} nats (median), other class in {others},")
        print(f"    sure answers at most {apart:.1f} degrees away{'   <- differs' if bad else ''}")
    close = sum(len(m["paper"]) > 1 for m in mine)
    print(f"\nIn {close} queries the lasso's test for its end is a tie in single precision; either sweep was accepted there.")
    print("they differ" if failed else "they agree")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
