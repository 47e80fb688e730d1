"""The package `beo` against the program `beo`, and by itself. BEO names the program."""

import contextlib
import io
import json
import os
import pathlib
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import beo

ROOT = pathlib.Path(__file__).resolve().parents[2]
HOUSEHOLD = ROOT / "models" / "household.safetensors"
PROGRAM = os.environ.get("BEO")
needs_program = pytest.mark.skipif(not PROGRAM, reason="BEO does not name the program beo")
INSTANCE = f"python-{os.getpid()}"


@pytest.fixture(scope="module")
def model():
    return beo.Model.load(HOUSEHOLD)


def mug(seed=7):
    return beo.view_from_above(beo.household_shape("mug", seed=seed))


def program(*arguments):
    run = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
    return run.stdout


def table_with_a_can(height=240, width=320, focal=300.0):
    """Depth (metres) of a cylinder of 7 cm by 11 cm on a table, seen from 35 degrees above at 0.8 m, the pixels of the cylinder, and
    what is up in the camera's frame: each ray cut with plane, mantle and lid, and a millimetre of noise, which every sensor has at least."""
    angle = np.radians(35.0)
    up = np.array([0.0, -np.cos(angle), -np.sin(angle)])
    away = np.array([0.0, -np.sin(angle), np.cos(angle)])
    foot = np.array([0.0, 0.0, 0.8])
    v, u = np.mgrid[0:height, 0:width]
    rays = np.stack([(u - (width - 1) / 2) / focal, (v - (height - 1) / 2) / focal, np.ones_like(u, float)], axis=-1)
    along = lambda axis: rays @ axis  # noqa: E731
    side = np.array([1.0, 0.0, 0.0])
    radius, tall = 0.035, 0.11
    table = (foot @ up) / along(up)
    a = along(side) ** 2 + along(away) ** 2
    b = along(side) * (foot @ side) + along(away) * (foot @ away)
    root = b**2 - a * ((foot @ side) ** 2 + (foot @ away) ** 2 - radius**2)
    with np.errstate(invalid="ignore"):
        mantle = (b - np.sqrt(root)) / a
    height_at = lambda z: z * along(up) - foot @ up  # noqa: E731
    mantle = np.where((root > 0) & (height_at(mantle) > 0) & (height_at(mantle) < tall), mantle, np.inf)
    lid = (foot @ up + tall) / along(up)
    on_lid = (lid * along(side) - foot @ side) ** 2 + (lid * along(away) - foot @ away) ** 2 < radius**2
    lid = np.where(on_lid & (lid > 0), lid, np.inf)
    can = np.minimum(mantle, lid)
    noise = 0.001 * np.random.default_rng(1).standard_normal((height, width))
    return (np.minimum(can, table) + noise).astype(np.float32), can < table, up


INTRINSICS = (300.0, 300.0, 159.5, 119.5)


def test_three_lines_from_install_to_the_first_percept():
    model = beo.Model.load(HOUSEHOLD)
    print(model.perceive(beo.view_from_above(beo.household_shape("mug", seed=7)), pose="yaw"))
    assert model.classes == ["bottle", "bowl", "box", "can", "cutlery_box", "mug", "plate"] and model.dims == (30, 30, 30)


@needs_program
@pytest.mark.parametrize("pose", ["known", "yaw", "full"])
def test_the_package_answers_as_the_program_does(model, tmp_path, pose):
    path = tmp_path / "mug.npy"
    np.save(path, mug())
    line = json.loads(program("perceive", path, "--model", HOUSEHOLD, "--view", "none", "--pose", pose, "--json"))
    percept = model.perceive(mug(), pose=pose)
    assert percept.class_name == line["class"]
    assert percept.probabilities == pytest.approx(line["posterior"])
    assert percept.log_scores == pytest.approx(line["log_score"])
    assert percept.none_probability == pytest.approx(line["none_probability"])
    assert percept.fit == pytest.approx(line["fit"])
    assert percept.rotation_spread_rad == pytest.approx(line["rotation_spread_rad"])
    assert len(percept.hypotheses) == len(line["hypotheses"]) > 0
    for ours, theirs in zip(percept.hypotheses, line["hypotheses"]):
        assert (ours.class_name, ours.probability) == (theirs["class"], pytest.approx(theirs["probability"]))
        assert ours.rotation == pytest.approx(theirs["rotation"])
    assert int((percept.occupancy >= 0.5).sum()) == line["completion"]["filled"]


def test_a_class_explains_its_own_shapes_and_not_scattered_voxels(model):
    seen = mug()
    own = model.perceive(seen)
    scattered = np.zeros_like(seen)
    scattered.flat[np.random.default_rng(3).choice(scattered.size, int((seen == 1).sum()), replace=False)] = 1
    strange = model.perceive(scattered)
    assert own.fit > 0.8 > 0.3 > strange.fit >= 0


@needs_program
def test_a_made_up_shape_written_and_read_is_the_same(tmp_path):
    program("generate", "household", "--out", tmp_path, "--count", 4, "--resolution", 30)
    files = sorted((tmp_path / "mug" / "train").iterdir())
    shape = beo.read_shape(files[0])
    assert shape.shape == (30, 30, 30) and shape.dtype == np.uint8 and set(np.unique(shape)) == {0, 1}


def test_arrays_go_in_and_out_whatever_their_layout(model):
    grid = mug()
    percept = model.perceive(grid, view="top")
    assert percept.occupancy.shape == percept.deviation.shape == (30, 30, 30)
    assert percept.occupancy.dtype == percept.deviation.dtype == np.float32
    # What was seen stays as it was seen, and is certain.
    seen = grid != 255
    assert (percept.occupancy[seen] == grid[seen]).all() and (percept.deviation[seen] == 0).all()
    assert (percept.deviation[~seen] > 0).any()
    turned = np.asfortranarray(grid)
    apart = np.zeros((30, 30, 60), np.uint8)[:, :, ::2]
    apart[...] = grid
    for other in (turned, apart, grid[::-1][::-1]):
        assert model.perceive(other, view="top").probabilities == percept.probabilities
    whole = beo.household_shape("mug", seed=7).astype(bool)
    assert (model.perceive(whole).occupancy == whole).all()
    assert model.perceive(grid, completion=False).occupancy is None


def test_the_rotation_turns_objects_into_the_grid(model):
    shape = beo.household_shape("mug", seed=7)
    # A quarter turn counter-clockwise about +z.
    turned = np.rot90(shape, axes=(0, 1))
    percept = model.perceive(beo.view_from_above(turned), pose="yaw", view="top")
    x, y, z, w = percept.rotation
    assert np.degrees(2 * np.arctan2(z, w)) % 360 == pytest.approx(90, abs=6) and (x, y) == pytest.approx((0, 0), abs=1e-9)
    assert percept.class_name == "mug" and percept.scale == 1 and percept.translation_voxels == pytest.approx([0, 0, 0])


def test_nothing_seen_is_an_answer(model):
    percept = model.perceive(np.full((30, 30, 30), 255, np.uint8))
    assert percept.class_name is None and percept.hypotheses == [] and percept.occupancy is None
    assert sum(percept.probabilities.values()) == pytest.approx(1)


@pytest.mark.parametrize(
    "change, error, words",
    [
        (dict(grid=np.zeros((30, 30, 30))), TypeError, "float64: use uint8"),
        (dict(grid=[[[0]]]), TypeError, "use a NumPy array"),
        (dict(grid=np.zeros((30, 30), np.uint8)), ValueError, "three axes"),
        (dict(grid=np.zeros((4, 4, 4), np.uint8)), ValueError, "every side must be from 8 to 256"),
        (dict(grid=np.zeros((16, 16, 16), np.uint8)), ValueError, "the model was trained for 30"),
        (dict(grid=np.full((30, 30, 30), 7, np.uint8)), ValueError, r"voxel \(0, 0, 0\) holds 7"),
        (dict(grid=np.full((30, 30, 30), 7, np.uint8).view(bool)), ValueError, "holds 7"),
        (dict(pose="any"), ValueError, 'use "known", "yaw", "full" or "rest"'),
        (dict(pose="rest"), ValueError, "say where it is by `camera`"),
        (dict(pose="yaw", yaw_span_deg=0.0), ValueError, "above 0"),
        (dict(view="side"), ValueError, 'use "top"'),
        (dict(view="top", camera=(0, 0, 90)), ValueError, "contradict"),
        (dict(camera=(0, 0, float("nan"))), ValueError, "finite"),
        (dict(size="search"), ValueError, "camera"),
        (dict(pose="full", size="search", camera=(90, 0, 40)), ValueError, "any rotation"),
        (dict(voxel_size_m=-1.0), ValueError, "positive"),
        (dict(frame="world"), ValueError, 'use "grid" or "object"'),
    ],
)
def test_what_cannot_be_asked_is_refused_in_words(model, change, error, words):
    arguments = {"grid": mug(), **change}
    with pytest.raises(error, match=words):
        model.perceive(arguments.pop("grid"), **arguments)


def test_files_that_are_no_models_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="missing.safetensors"):
        beo.Model.load(tmp_path / "missing.safetensors")
    wrong = tmp_path / "wrong.safetensors"
    wrong.write_bytes(b"no model")
    with pytest.raises(ValueError, match="not a usable model"):
        beo.Model.load(wrong)
    with pytest.raises(FileNotFoundError):
        beo.read_shape(tmp_path / "missing.off")
    (tmp_path / "wrong.off").write_text("OFF\nnonsense")
    with pytest.raises(ValueError, match="wrong.off"):
        beo.read_shape(tmp_path / "wrong.off")
    with pytest.raises(ValueError, match="mug, plate"):
        beo.household_shape("chair")


def learned(count=6):
    dims = (16, 16, 16)
    return {name: np.stack([beo.household_shape(name, seed, dims) for seed in range(count)]) for name in ("bottle", "mug")}


def test_a_model_is_learned_saved_and_loaded(tmp_path):
    steps = []
    model = beo.Model.train(learned(), poses=False, progress=lambda *step: steps.append(step))
    assert model.classes == ["bottle", "mug"] and model.dims == (16, 16, 16) and not model.has_cameras
    assert 0.5 <= model.held_out_accuracy <= 1 and len(steps) >= 3 and all(0 <= done < total for _, done, total in steps)
    path = tmp_path / "own.safetensors"
    model.save(path)
    grid = beo.view_from_above(beo.household_shape("bottle", 99, (16, 16, 16)))
    ours, theirs = model.perceive(grid), beo.Model.load(path).perceive(grid)
    assert ours.class_name == "bottle"
    assert ours.probabilities == pytest.approx(theirs.probabilities, abs=1e-3)
    # Lists of grids are the same shapes.
    again = beo.Model.train({name: [grid.astype(bool) for grid in grids] for name, grids in learned().items()}, poses=False)
    assert again.perceive(grid).probabilities == ours.probabilities
    with pytest.raises(ValueError, match="known poses alone"):
        model.perceive(grid, pose="yaw")
    with pytest.raises(OSError):
        model.save(tmp_path / "nowhere" / "own.safetensors")


@pytest.mark.parametrize(
    "change, error, words",
    [
        (lambda shapes: {}, ValueError, "give 1 to 64"),
        (lambda shapes: {**shapes, "bowl": shapes["mug"][:3]}, ValueError, "at least 4 are needed"),
        (lambda shapes: {**shapes, "m" * 32: shapes["mug"]}, ValueError, "1 to 31"),
        (lambda shapes: {**shapes, "bowl": shapes["mug"].astype(float)}, TypeError, "use uint8 or bool"),
        (lambda shapes: {**shapes, "bowl": shapes["mug"][0]}, ValueError, r"give \(n, x, y, z\)"),
        (lambda shapes: {**shapes, "bowl": shapes["mug"] * 255}, ValueError, "holds 255: a complete shape"),
        (lambda shapes: {**shapes, "bowl": shapes["mug"] * 0}, ValueError, "at least 16"),
        (lambda shapes: {**shapes, "bowl": shapes["mug"][:, :8]}, ValueError, "one resolution"),
        (lambda shapes: {7: shapes["mug"]}, TypeError, "str"),
    ],
)
def test_shapes_that_cannot_be_learned_are_refused_in_words(change, error, words):
    with pytest.raises(error, match=words):
        beo.Model.train(change(learned()), poses=False)


def test_shapes_that_are_there_twice_are_learned_once():
    shapes = learned()
    shapes["mug"] = np.concatenate([shapes["mug"], shapes["mug"][:2]])
    with pytest.warns(UserWarning, match="left out, 2 in number"):
        beo.Model.train(shapes, poses=False)


def test_progress_may_end_a_training():
    def enough(step, done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        beo.Model.train(learned(), poses=False, progress=enough)


def test_several_threads_ask_one_model_without_the_lock(model):
    answers = [None] * 8

    def ask(place):
        answers[place] = [model.perceive(mug(seed), pose="full", completion=False).class_name for seed in range(6)]

    threads = [threading.Thread(target=ask, args=[place]) for place in range(8)]
    for thread in threads:
        thread.start()
    # While they compute, this thread is not kept waiting.
    ticks = 0
    while any(thread.is_alive() for thread in threads):
        time.sleep(0.002)
        ticks += 1
    for thread in threads:
        thread.join()
    assert ticks >= 10
    assert all(answer == answers[0] for answer in answers) and answers[0].count("mug") >= 5


def test_a_depth_image_is_segmented_and_carved(model):
    depth, truth, up = table_with_a_can()
    labels = beo.segment(depth, INTRINSICS, up=up)
    assert labels.dtype == np.uint16 and labels.shape == depth.shape and set(np.unique(labels)) == {0, 1}
    assert ((labels == 1) & truth).sum() / ((labels == 1) | truth).sum() > 0.9
    # The same in millimetres, with a camera matrix, and in another layout.
    matrix = np.array([[300.0, 0.0, 159.5], [0.0, 300.0, 119.5], [0.0, 0.0, 1.0]])
    millimetres = np.asfortranarray(np.round(depth * 1000).astype(np.uint16))
    assert (beo.segment(millimetres, matrix, up=up) != labels).mean() < 0.01
    (grid,) = beo.carve(depth, INTRINSICS, labels, dims=model.dims, up=up)
    (other,) = beo.carve(depth, INTRINSICS, dims=model.dims, up=up)
    assert grid.label == other.label == 1 and (grid.voxels == other.voxels).all() and grid.cut == []
    assert grid.voxels.shape == (30, 30, 30) and set(np.unique(grid.voxels)) == {0, 1, 255}
    assert model.has_cameras
    percept = model.perceive(grid)
    assert percept.class_name == "can", percept.probabilities
    # Middle of the can: its foot, and half its height up.
    assert percept.position_m == pytest.approx(np.array([0, 0, 0.8]) + 0.055 * up, abs=0.012)
    assert sorted(percept.extent_m) == pytest.approx([0.07, 0.07, 0.11], rel=0.2)


@needs_program
def test_grids_are_those_of_the_program(model, tmp_path):
    depth, truth, up = table_with_a_can()
    frames, grids = tmp_path / "frames", tmp_path / "grids"
    frames.mkdir()
    np.save(frames / "a_depth.npy", depth)
    np.save(frames / "a_label.npy", truth.astype(np.uint8))
    (frames / "cam_K.txt").write_text("300 0 159.5\n0 300 119.5\n0 0 1\n")
    program("camera", frames, "--out", grids, "--gravity", ",".join(str(-v) for v in up))
    (path,) = grids.rglob("*.npy")
    (grid,) = beo.carve(depth, INTRINSICS, truth.astype(np.uint8), dims=model.dims, up=up)
    assert (np.load(path) == grid.voxels).all()


@pytest.mark.parametrize(
    "call, error, words",
    [
        (lambda depth: beo.segment(depth.astype(complex), INTRINSICS), TypeError, "float32 in metres"),
        (lambda depth: beo.segment(depth[0], INTRINSICS), ValueError, "two axes"),
        (lambda depth: beo.segment(depth, (300.0, 300.0)), ValueError, r"give \(fx, fy, cx, cy\)"),
        (lambda depth: beo.segment(depth, (0.0, 300.0, 1.0, 1.0)), ValueError, "focal lengths"),
        (lambda depth: beo.segment(depth, INTRINSICS, distortion=[1.0]), ValueError, "k1, k2"),
        (lambda depth: beo.segment(depth, INTRINSICS, up=(0, 0, 0)), ValueError, "direction"),
        (lambda depth: beo.segment(depth.astype(np.uint16), INTRINSICS, depth_scale=0.0), ValueError, "depth_scale"),
        (lambda depth: beo.carve(depth, INTRINSICS, np.zeros((2, 2), int)), ValueError, "2 x 2 pixels"),
        (lambda depth: beo.carve(depth, INTRINSICS, np.full(depth.shape, 70000)), ValueError, "70000: use 0 to 65535"),
        (lambda depth: beo.carve(depth, INTRINSICS, np.zeros(depth.shape)), TypeError, "use uint16"),
        (lambda depth: beo.carve(depth, INTRINSICS, dims=(4, 30, 30)), ValueError, "dims"),
    ],
)
def test_images_that_make_no_sense_are_refused_in_words(call, error, words):
    with pytest.raises(error, match=words):
        call(table_with_a_can()[0])


def test_objects_without_a_grid_are_named():
    depth, truth, up = table_with_a_can()
    labels = np.zeros(depth.shape, np.uint16)
    labels[100, 100:103] = 5
    with pytest.warns(UserWarning, match="object 5"):
        assert beo.carve(depth, INTRINSICS, labels, up=up) == []


@pytest.fixture
def daemon():
    serve = subprocess.Popen([PROGRAM, "serve", "--model", HOUSEHOLD, "--instance", INSTANCE], stderr=subprocess.DEVNULL)
    try:
        yield serve
    finally:
        serve.terminate()
        try:
            serve.wait(10)
        except subprocess.TimeoutExpired:
            serve.kill()
            serve.wait()


@needs_program
def test_a_daemon_answers_over_shared_memory_as_the_model_does(model, daemon):
    depth, truth, up = table_with_a_can()
    (carved,) = beo.carve(depth, INTRINSICS, truth.astype(np.uint16), dims=model.dims, up=up)
    with beo.Subscriber(INSTANCE, completion=True, timeout=60) as subscriber, beo.Observer(INSTANCE) as observer:
        assert observer.dims == model.dims and subscriber.is_connected
        for grid, asked in [(mug(), dict(pose="yaw", view="top")), (mug(3), dict(frame="object")), (carved, {})]:
            number = observer.observe(grid, object_id=9, **asked)
            percept = subscriber.take(timeout=20)
            ours = model.perceive(grid, **asked)
            assert (percept.status, percept.explanation) == ("ok", "")
            assert (percept.producer_id, percept.sequence, percept.object_id) == (observer.producer_id, number, 9)
            assert percept.class_name == ours.class_name
            assert percept.probabilities == pytest.approx(ours.probabilities, abs=1e-5)
            assert percept.hypotheses[0].rotation == pytest.approx(ours.hypotheses[0].rotation, abs=1e-5)
            assert np.abs(percept.occupancy - ours.occupancy).max() < 1 / 254
            assert np.abs(percept.deviation - ours.deviation).max() < 1 / 254
            assert percept.capture_ns <= percept.received_ns <= percept.published_ns <= percept.read_ns <= time.monotonic_ns()
        assert percept.is_metric and percept.frame_id == "camera"
        assert percept.object_position_m == pytest.approx(ours.position_m, abs=1e-5)
        assert percept.object_extent_m == pytest.approx(ours.extent_m, abs=1e-5)
        # What holds nothing is answered, by a percept that says so.
        observer.observe(np.full(model.dims, 255, np.uint8))
        nothing = subscriber.take(timeout=20)
        assert nothing.status == "nothing_seen" and nothing.class_name is None and "no voxel is filled" in nothing.explanation
        with pytest.raises(ValueError, match="the model is for"):
            observer.observe(np.zeros((16, 16, 16), np.uint8))
        assert subscriber.take(timeout=0.1) is None and subscriber.missed == 0
        # Iterating gives one after the other.
        sent = [observer.observe(mug(seed), object_id=seed) for seed in range(1, 4)]
        assert [percept.sequence for _, percept in zip(sent, subscriber)] == sent
    with pytest.raises(ValueError, match="closed"):
        observer.observe(mug())
    with pytest.raises(ValueError, match="closed"):
        subscriber.take(timeout=0.1)


@needs_program
def test_ctrl_c_ends_the_waiting(daemon):
    beo.Subscriber(INSTANCE, timeout=60).close()
    script = f"import beo\nwith beo.Subscriber({INSTANCE!r}) as s:\n    print('ready', flush=True)\n    for percept in s: pass"
    reader = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert reader.stdout.readline() == "ready\n"
        reader.send_signal(signal.SIGINT)
        _, error = reader.communicate(timeout=10)
    finally:
        reader.kill()
        reader.wait()
    assert "KeyboardInterrupt" in error and "panic" not in error


def test_where_no_daemon_runs_that_is_said():
    for open_role in (beo.Subscriber, beo.Observer):
        with pytest.raises(ConnectionError, match="start `beo serve --instance nobody-here`"):
            open_role("nobody-here", timeout=0.2)
        with pytest.raises(ValueError, match="instance name"):
            open_role("no/name")


def test_what_is_documented_is_there():
    for name in beo.__all__:
        assert name == "__version__" or getattr(beo, name).__doc__, name
    with contextlib.redirect_stdout(io.StringIO()) as text:
        help(beo.Model.perceive)
    assert "uint8: 0 empty, 1 filled, 255 unknown" in text.getvalue()
    assert repr(beo.Hypothesis) and (pathlib.Path(beo.__file__).parent / "py.typed").exists()
