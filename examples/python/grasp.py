"""A gripper's process: from every completion, how large the object is and where its centroid lies in the sensor's frame.

    python grasp.py [INSTANCE] [COUNT]

INSTANCE: of the daemon (default); COUNT: completions to print (without end).

Centroid: the mean of the voxels' centres, weighted with their probability of being filled; its uncertainty is what it would move if all
voxels' deviations went together, the worst case. Extent along each axis of the frame: of the voxels whose probability is at least one
half, between brackets if each had one deviation less, and one more. From every percept of a grid whose size and place were to be found,
as a depth camera's are: the box that the daemon found.
"""

import sys

import numpy as np

import beo_client as beo
import beo_messages as messages


def rotation_matrix(quaternion):
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def centres(header):
    """Centre of every voxel in the sensor's frame, voxels × 3, and the extent of one along its axes."""
    dims, size, rotation = np.array(header.dims), header.voxel_size_m, rotation_matrix(header.orientation)
    in_grid = (np.indices(dims).reshape(3, -1).T + 0.5 - dims / 2) * size
    return np.array(header.position_m) + in_grid @ rotation.T, np.abs(rotation).sum(axis=1) * size


def describe(completion):
    header = completion.header
    if header.frame != messages.CompletionFrame.GRID:
        return f"#{header.sequence} is completed in the object's frame: ask for the grid's"
    points, voxel = centres(header)
    p, s = completion.occupancy.ravel().astype(int), completion.deviation.ravel().astype(int)

    def extent(filled):
        return np.ptp(points[filled], axis=0) + voxel if filled.any() else np.zeros(3)

    if not (p >= 128).any():
        return f"#{header.sequence} nothing to grasp"
    centroid = p @ points / p.sum()
    moves = s @ np.abs(points - centroid) / p.sum()
    extents = zip(extent(p >= 128), extent(p - s >= 128), extent(p + s >= 128))
    x, y, z = centroid
    dx, dy, dz = moves
    return (
        f"#{header.sequence} in {beo.text(header.frame_id)}: centroid ({x:.3f}, {y:.3f}, {z:.3f}) +- ({dx:.3f}, {dy:.3f}, {dz:.3f}) m, "
        f"extent {' x '.join(f'{likely:.3f} [{least:.3f}, {most:.3f}]' for likely, least, most in extents)} m"
    )


def main(instance="default", count="inf"):
    subscriber = beo.within(10, lambda: beo.Subscriber(instance, completion=True))
    print("listening", file=sys.stderr, flush=True)
    done = 0
    while done < float(count):
        if not subscriber.wait(0.5):
            subscriber.maintain()
        while done < float(count) and (completion := subscriber.take_completion()) is not None:
            print(describe(completion), flush=True)
            done += 1
        while (percept := subscriber.take_percept()) is not None:
            if (box := beo.box(percept)) is not None:
                print(f"#{percept.sequence} {box}", flush=True)


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except (beo.NotRunning, beo.NoRoom) as error:
        sys.exit(f"grasp: {error}")
    except KeyboardInterrupt:
        pass
