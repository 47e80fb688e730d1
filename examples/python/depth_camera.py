"""A depth camera's driver: frame in, table, where the object's grid lies, carving, commit; thirty times a second.

    python depth_camera.py [INSTANCE] [COUNT] [SIDE] [SEGMENTATION]

INSTANCE: of the daemon (default); COUNT: grids to send (90); SIDE: voxels along each axis, as the model has (30).
SEGMENTATION: mask, the camera comes with labels (default); table, it does not, and what stands on the table is the object.

For your own camera, replace `CAMERA` and `next_frame`: the made-up one looks down on a box that turns on a table.
"""

import sys
import time

import numpy as np

import beo_client as beo
import beo_depth

# From your camera's calibration, of rectified images.
CAMERA = beo_depth.Intrinsics(fx=277.0, fy=277.0, cx=160.3, cy=119.1)
# The object's label in the mask. For several objects, do the second half of `main`'s loop for each label.
OBJECT = 1

# The made-up camera's pixels: 320 × 240 directions.
V, U = np.mgrid[:240, :320]
RAYS = np.stack([(U - CAMERA.cx) / CAMERA.fx, (V - CAMERA.cy) / CAMERA.fy, np.ones(U.shape)], axis=-1)


def next_frame(number, start, has_labels=True):
    """Waits for the next frame: depth in metres (0: no reading), labels (0: no object; None: there is no
    segmentation), and when it was taken (CLOCK_MONOTONIC).

    REPLACE THIS: here, a box of 7 × 10 × 14 cm on a table is made up, in steps of a millimetre.
    """
    time.sleep(max(0.0, start + number / 30 - time.monotonic()))
    # The camera is 0.4 m above the table and looks down by 0.55 rad; the box stands 0.55 m before it.
    sin, cos, turned = np.sin(0.55), np.cos(0.55), 0.3 + 0.02 * number
    up, ahead, right = np.array([0, -cos, -sin]), np.array([0, -sin, cos]), np.array([1.0, 0, 0])
    axes = np.array([right * np.cos(turned) + ahead * np.sin(turned), ahead * np.cos(turned) - right * np.sin(turned), up])
    half, centre = np.array([0.035, 0.05, 0.07]), ahead * 0.55 - up * 0.33
    captured_ns = beo.monotonic_ns()
    along = RAYS @ axes.T
    middle, width = axes @ centre / along, half / np.abs(along)
    enter, leave = np.maximum((middle - width).max(axis=-1), 0), np.minimum((middle + width).min(axis=-1), 10)
    is_box = enter < leave
    table = -0.4 / (RAYS @ up)
    depth = np.where(is_box, enter, np.where((table > 0) & (table < 5), table, 0))
    labels = np.where(is_box, OBJECT, 0).astype(np.uint16) if has_labels else None
    return (0.001 * np.floor(1000 * depth + 0.5)).astype(np.float32), labels, captured_ns


def main(instance="default", count=90, side=30, segmentation="mask"):
    if segmentation not in ("mask", "table"):
        sys.exit(f"depth_camera: SEGMENTATION is mask or table, not {segmentation}")
    dims = (int(side),) * 3
    producer = beo.within(10, lambda: beo.Producer(instance, dims))
    beo.set_text(producer.header.frame_id, "camera")
    producer.header.object_id = OBJECT
    start, number, sent, table = time.monotonic(), 0, 0, None
    while sent < int(count):
        depth, labels, captured_ns = next_frame(number, start, segmentation == "mask")
        number += 1
        if labels is None:
            labels, _ = beo_depth.segment_table(depth, CAMERA)
        # Where the table is hidden, it is where it was. If you know what is up, give `up=`.
        table = beo_depth.fit_support(depth, labels, CAMERA) or table
        if table is None:
            continue
        grid = beo_depth.place_grid(depth, labels, CAMERA, OBJECT, dims, table)
        if grid is None:
            continue  # Hardly seen: left out of this frame.
        beo_depth.fill_header(producer.header, grid)
        loan = producer.loan()
        loan.header.capture_ns = captured_ns
        beo_depth.carve(depth, labels, CAMERA, OBJECT, grid, loan.voxels, table)
        print(f"sent observation {loan.send()}", flush=True)
        sent += 1


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except (beo.NotRunning, beo.NoRoom) as error:
        sys.exit(f"depth_camera: {error}")
    except KeyboardInterrupt:
        pass
