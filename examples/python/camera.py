"""A camera's process: writes a partial grid in place into shared memory, thirty times a second.

    python camera.py [INSTANCE] [COUNT] [SIDE]

INSTANCE: of the daemon (default); COUNT: grids to send (90); SIDE: voxels along each axis, as the model has (30). The object is a made-up
table, seen from above: known voxels are 0 (empty) or 1 (filled), hidden ones 255 (unknown).
"""

import sys
import time

import beo_client as beo
import beo_messages as messages


def write_table_top(voxels):
    side = voxels.shape[0]
    under_the_top = slice(side // 10, side - side // 10), slice(side // 4, side - side // 4)
    top = side * 7 // 10
    voxels[:] = 0
    voxels[*under_the_top, :top] = 255
    voxels[*under_the_top, top] = 1


def main(instance="default", count=90, side=30):
    producer = beo.within(10, lambda: beo.Producer(instance, (int(side),) * 3))
    # What the grid is and where it lies. The grid stands 0.8 m before the sensor, turned by a quarter about z.
    header = producer.header
    header.view = messages.View.TOP_DOWN
    header.voxel_size_m = 1.2 / int(side)
    header.position_m[:] = 0.8, 0.0, 0.4
    header.orientation[:] = 0.0, 0.0, 0.5**0.5, 0.5**0.5
    beo.set_text(header.frame_id, "camera")

    due = time.monotonic()
    for _ in range(int(count)):
        loan = producer.loan()
        write_table_top(loan.voxels)
        print(f"sent observation {loan.send()}", flush=True)
        due += 1 / 30
        time.sleep(max(0.0, due - time.monotonic()))


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except (beo.NotRunning, beo.NoRoom) as error:
        sys.exit(f"camera: {error}")
    except KeyboardInterrupt:
        pass
