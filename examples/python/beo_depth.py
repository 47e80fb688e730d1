"""From a depth image with an instance mask to a partial voxel grid, in NumPy: the rules of libbeo (ipc/camera), for rectified images.
`segment_table`, for images without a mask, calls libbeo itself.

The camera frame is the optical one: x right, y down, z along the optical axis, metres; pixels count from the centre of the first. A grid's
frame has its origin at the grid's centre, axes along the indices, z up.
"""

import ctypes
import functools
import os
from dataclasses import dataclass

import numpy as np

import beo_messages as messages

EMPTY, FILLED, UNKNOWN = 0, 1, 255


@dataclass(frozen=True)
class Intrinsics:
    """Focal lengths and principal point, pixels. Lens distortion is yours to take out (cv2.undistortPoints, or rectified images)."""

    fx: float
    fy: float
    cx: float
    cy: float


@dataclass(frozen=True)
class Sensor:
    """Standard deviation of a reading: constant_m + quadratic_per_m · depth²; a voxel within `deviations` of it from the surface is filled."""

    constant_m: float = 0.001
    quadratic_per_m: float = 0.0019
    deviations: float = 2.0

    def deviation(self, depth):
        return self.constant_m + self.quadratic_per_m * depth * depth


@dataclass(frozen=True)
class Plane:
    """A point p is at the height normal · p + offset above it, metres; the normal is up, of length 1."""

    normal: np.ndarray
    offset: float

    def height(self, points):
        return points @ self.normal + self.offset


@dataclass(frozen=True)
class Grid:
    """Where a grid lies in the camera frame; columns of `axes` are its axes there."""

    dims: tuple
    voxel_size_m: float
    position_m: np.ndarray
    axes: np.ndarray


def _points(depth, camera, pixels):
    """What pixels (indices into the flat image) show, n × 3."""
    v, u = np.divmod(pixels, depth.shape[1])
    z = depth.ravel()[pixels].astype(float)
    return np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], axis=1)


def _readings(depth, of):
    """Flat indices of the pixels that are wanted and have a reading."""
    return np.flatnonzero((of & (depth > 0) & np.isfinite(depth)).ravel())


class _CameraIntrinsics(ctypes.Structure):
    """beo_intrinsics of beo.h."""

    _fields_ = [("width", ctypes.c_uint32), ("height", ctypes.c_uint32)]
    _fields_ += [(name, ctypes.c_double) for name in ("fx", "fy", "cx", "cy")] + [("distortion", ctypes.c_double * 5)]


class _DepthFrame(ctypes.Structure):
    """beo_depth_frame of beo.h."""

    _fields_ = [("size", ctypes.c_uint32), ("reserved", ctypes.c_uint32), ("intrinsics", _CameraIntrinsics)]
    _fields_ += [("depth_m", ctypes.c_void_p), ("depth_count", ctypes.c_size_t)]
    _fields_ += [("labels", ctypes.c_void_p), ("label_count", ctypes.c_size_t)]


class _CameraOptions(ctypes.Structure):
    """beo_camera_options of beo.h."""

    _fields_ = [("size", ctypes.c_uint32), ("support_label", ctypes.c_uint32), ("sensor", ctypes.c_double * 3), ("up", ctypes.c_double * 3)]
    _fields_ += [(name, ctypes.c_double) for name in ("share", "known_side_m", "known_side_deviation_m")]
    _fields_ += [("least_readings", ctypes.c_uint32), ("reserved", ctypes.c_uint32)]


@functools.cache
def _library():
    """libbeo, which has to be installed (`ipc/c/install`): where the loader finds it, or the file that BEO_LIBRARY names."""
    name = os.environ.get("BEO_LIBRARY", f"libbeo.so.{messages.ABI_VERSION}")
    try:
        library = ctypes.CDLL(name)
    except OSError as error:
        raise OSError(f"segment_table needs libbeo: install it by ipc/c/install, and set BEO_LIBRARY to the file ({error})") from error
    if library.beo_abi_version() != messages.ABI_VERSION:
        raise OSError(f"{name} is of another version than these files: {library.beo_abi_version()}, not {messages.ABI_VERSION}")
    library.beo_last_error.restype = ctypes.c_char_p
    return library


def segment_table(depth, camera, sensor=Sensor(), up=None):
    """Labels of what stands on the table of an image without a mask (0: none), and how many objects there are: 1 to that number.

    Nothing is kept between calls: an object may have another number in the next frame. `up` as for `fit_support`. ValueError if libbeo
    refuses an argument; OSError if it is not installed.
    """
    depth = np.ascontiguousarray(depth, dtype=np.float32)
    rows, columns = depth.shape
    labels = np.zeros(depth.shape, np.uint16)
    pinhole = _CameraIntrinsics(columns, rows, camera.fx, camera.fy, camera.cx, camera.cy)
    frame = _DepthFrame(ctypes.sizeof(_DepthFrame), 0, pinhole, depth.ctypes.data, depth.size, None, 0)
    noise = (ctypes.c_double * 3)(sensor.constant_m, sensor.quadratic_per_m, sensor.deviations)
    upwards = (ctypes.c_double * 3)(*((0, 0, 0) if up is None else up))
    options = _CameraOptions(ctypes.sizeof(_CameraOptions), 0, noise, upwards, 2 / 3, 0, 0, 40, 0)
    objects = ctypes.c_uint32()
    arguments = (ctypes.byref(frame), ctypes.byref(options), ctypes.c_void_p(labels.ctypes.data), ctypes.c_size_t(labels.size))
    if _library().beo_segment_table(*arguments, ctypes.byref(objects)) != 0:
        raise ValueError(_library().beo_last_error().decode())
    return labels, objects.value


def fit_support(depth, labels, camera, sensor=Sensor(), up=None, label=0):
    """The plane with the most readings among the pixels with this label, or None: RANSAC, then weighted least squares.

    `up`: what is up in the camera frame, if known: the normal is within 15° of it. Else the camera is upright and looks down on the plane.
    """
    pixels = _readings(depth, labels == label)
    if pixels.size < 60:
        return None
    points = _points(depth, camera, pixels[:: -(-pixels.size // 2000)])
    near = np.clip(3 * sensor.deviation(points[:, 2]), 0.004, 0.03)
    weights = np.maximum(sensor.deviation(points[:, 2]), 0.004 / 3) ** -2.0  # what is far away is less exact

    def allowed(normals):
        if up is not None:
            return normals @ (np.asarray(up) / np.linalg.norm(up)) >= np.cos(np.radians(15))
        return (np.abs(normals[..., 0]) <= 0.5) & (normals[..., 1] <= 0.26) & (normals[..., 2] <= 0.26)

    a, b, c = points[np.random.default_rng(0).integers(len(points), size=(3, 200))]
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals / np.maximum(lengths, 1e-12)[:, None]
    normals *= np.where((normals * a).sum(axis=1) > 0, -1, 1)[:, None]  # towards the camera
    offsets = -(normals * a).sum(axis=1)
    inliers = (np.abs(points @ normals.T + offsets) < near[:, None]).sum(axis=0)
    best = np.argmax(np.where(allowed(normals) & (lengths > 1e-6), inliers, -1))
    plane = Plane(normals[best], offsets[best])
    for _ in range(4):
        is_near = np.abs(plane.height(points)) < near
        inside, weight = points[is_near], weights[is_near]
        if len(inside) < 60:
            return None
        middle = np.average(inside, axis=0, weights=weight)
        normal = np.linalg.eigh(((inside - middle) * weight[:, None]).T @ (inside - middle))[1][:, 0]
        normal = -normal if normal @ middle > 0 else normal
        plane = Plane(normal, -normal @ middle)
    share = np.mean(np.abs(plane.height(points)) < near)
    return plane if share >= 0.15 and allowed(plane.normal) else None


def _has_neighbours(depth, labels, sensor):
    """Whether two of a pixel's four neighbours belong to the same object and are about as far away."""
    z = np.pad(np.where((depth > 0) & np.isfinite(depth), depth, np.nan).astype(float), 1, constant_values=np.nan)
    label = np.pad(labels, 1)
    rows, columns = depth.shape

    def beside(image, down, right):
        return image[1 + down : 1 + down + rows, 1 + right : 1 + right + columns]

    here = beside(z, 0, 0)
    near = np.maximum(0.01, 6 * sensor.deviation(here))
    alike = np.zeros(depth.shape, int)
    for there in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        alike += (np.abs(beside(z, *there) - here) < near) & (beside(label, *there) == labels)
    return alike >= 2


def _is_unseen_below(depth, labels, camera, object_label, points, up, support):
    """Whether most of what is between readings and the plane below them has no reading: the sides of dark and glossy things."""
    points = points[:: -(-len(points) // 100)]
    heights = support.height(points) / max(support.normal @ up, 0.1)
    below = np.concatenate([points - np.outer(share * heights, up) for share in (0.25, 0.5, 0.75)])
    below = below[below[:, 2] > 0]
    u = camera.fx * below[:, 0] / below[:, 2] + camera.cx + 0.5
    v = camera.fy * below[:, 1] / below[:, 2] + camera.cy + 0.5
    inside = (u >= 0) & (v >= 0) & (u < depth.shape[1]) & (v < depth.shape[0])
    pixels = v[inside].astype(int) * depth.shape[1] + u[inside].astype(int)
    reading = depth.ravel()[pixels]
    is_read = (reading > 0) & np.isfinite(reading)
    unseen, seen = np.count_nonzero(~is_read), np.count_nonzero(is_read & (labels.ravel()[pixels] != object_label))
    return unseen >= 20 and unseen >= 0.6 * (unseen + seen)


def place_grid(depth, labels, camera, object_label, dims, support=None, up=None, sensor=Sensor(), share=2 / 3, known_side_m=None):
    """The grid about an object, or None if it has fewer than 40 readings.

    Upright, x away from the camera; its centre is that of the box about the readings without the outermost half percent on each side, which
    reaches down to the support plane if they end near it, or if what is below them has no readings. The box's longest side is `share` of the grid's shortest; or, if the object's
    longest side is known, that is 0.8 of it.
    """
    pixels = _readings(depth, labels == object_label)
    if pixels.size < 40:
        return None
    pixels = pixels[:: -(-pixels.size // 4000)]
    inner = pixels[_has_neighbours(depth, labels, sensor).ravel()[pixels]]
    points = _points(depth, camera, inner if inner.size >= 40 else pixels)
    up = support.normal if up is None else np.asarray(up) / np.linalg.norm(up)
    away = points.mean(axis=0)
    x = away / np.linalg.norm(away)
    x = x - up * (up @ x)
    if np.linalg.norm(x) <= 0.05:  # from straight above
        x = np.array([0.0, -1.0, 0.0]) + up * up[1]
    x /= np.linalg.norm(x)
    axes = np.column_stack([x, np.cross(up, x), up])
    along = np.sort(points @ axes, axis=0)
    left_out = int(0.005 * len(along))
    low, high = along[left_out], along[len(along) - 1 - left_out]
    if support is not None:
        foot = axes @ [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]]
        gap = support.height(foot) / max(support.normal @ up, 0.1)
        is_unseen = gap <= 0.35 and _is_unseen_below(depth, labels, camera, object_label, points, up, support)
        if gap <= max(0.02, 0.3 * (high[2] - low[2])) or is_unseen:
            low[2] = min(low[2] - gap, high[2])
    longest, side = (high - low).max(), min(dims)
    if not longest > 0:
        return None
    voxel = known_side_m / (0.8 * side) if known_side_m else longest / (share * side)
    return Grid(tuple(dims), voxel, axes @ ((low + high) / 2), axes)


def carve(depth, labels, camera, object_label, grid, voxels, support=None, sensor=Sensor()):
    """Writes all of `voxels`, [x][y][z]: in front of the surface empty; within the band of the object's filled; else unknown. What lies below
    the support plane is empty, unless the object is seen there."""
    x, y, z = ((np.arange(n) + 0.5 - n / 2) * grid.voxel_size_m for n in grid.dims)

    def across(direction, offset):
        """direction · (axes · in_grid + position) + offset, for every voxel."""
        a = direction @ grid.axes
        return (a[0] * x)[:, None, None] + (a[1] * y)[None, :, None] + (a[2] * z + (direction @ grid.position_m + offset))

    px, py, pz = (across(direction, 0.0) for direction in np.eye(3))
    ahead = pz > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = camera.fx * (px / pz) + camera.cx + 0.5, camera.fy * (py / pz) + camera.cy + 0.5
    rows, columns = depth.shape
    seen = ahead & (u >= 0) & (v >= 0) & (u < columns) & (v < rows)
    pixel = np.where(seen, v, 0).astype(np.intp) * columns + np.where(seen, u, 0).astype(np.intp)
    reading = depth.ravel()[pixel].astype(float)
    seen &= (reading > 0) & np.isfinite(reading)
    # The band is never thinner than the voxel along the optical axis.
    thinnest = 0.5 * grid.voxel_size_m * np.abs(grid.axes[2]).sum()
    band = np.maximum(sensor.deviations * sensor.deviation(reading), thinnest)
    behind = pz - reading
    filled = seen & (behind >= -band) & (behind <= band) & (labels.ravel()[pixel] == object_label)
    voxels[...] = UNKNOWN
    voxels[seen & (behind < -band)] = EMPTY
    if support is not None:
        voxels[across(support.normal, support.offset) < 0] = EMPTY
    voxels[filled] = FILLED


def quaternion(axes):
    """The unit quaternion x, y, z, w of a rotation matrix: the eigenvector of its largest eigenvalue (Bar-Itzhack)."""
    (a, b, c), (d, e, f), (g, h, i) = axes
    k = np.array([[a - e - i, 0, 0, 0], [b + d, e - a - i, 0, 0], [c + g, f + h, i - a - e, 0], [h - f, c - g, d - b, a + e + i]])
    return np.linalg.eigh(k)[1][:, -1]


def fill_header(header, grid, known_side_m=None, known_side_deviation_m=0.0):
    """What a header says of a carved grid, as beo_observation_header_of_grid in C: where it lies, in metres, and where the camera is; size,
    place and rotation about the vertical to be found."""
    header.dims[:] = grid.dims
    header.voxel_size_m = grid.voxel_size_m
    header.position_m[:] = grid.position_m
    header.orientation[:] = quaternion(grid.axes)
    header.view = messages.View.CAMERA
    header.sensor_position_m[:] = -grid.axes.T @ grid.position_m
    header.outside = messages.Outside.UNKNOWN
    header.scale_search = messages.ScaleSearch.SEARCH
    header.known_side_m = known_side_m or 0.0
    header.known_side_deviation_m = known_side_deviation_m
    header.unit = messages.Unit.METRES
    header.pose_search = messages.PoseSearch.REST
    header.tasks = messages.TASK_CLASS | messages.TASK_POSE | messages.TASK_COMPLETION
