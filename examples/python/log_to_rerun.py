"""Shows query, completion and pose of every object in the Rerun viewer, or records them.

    python log_to_rerun.py [INSTANCE] [COUNT] [FILE.rrd]

INSTANCE: of the daemon (default); COUNT: percepts to show (without end); FILE.rrd: record into this file instead of opening the viewer.
Needs `rerun-sdk`. It takes the one place that a daemon has for a recorder of observations.
"""

import ctypes
import sys

import iceoryx2 as iox2
import numpy as np
import rerun as rr

import beo_client as beo
import beo_messages as messages

GREY, BLUE, ORANGE = (150, 150, 150), (50, 110, 230), (240, 140, 40)


class Recorder(beo.Subscriber):
    """Reads the observations too."""

    def __init__(self, instance):
        super().__init__(instance, completion=True)
        service = self._service("observation", iox2.Slice[ctypes.c_uint8], messages.ObservationHeader)
        self.observations = service.subscriber_builder().create()

    def take_observation(self):
        """Header and voxels [x][y][z] of the oldest observation not yet taken, copied, or None."""
        if (sample := self.observations.receive()) is None:
            return None
        header = messages.ObservationHeader.from_buffer_copy(sample.user_header().contents)
        voxels = np.array(sample.payload().as_memory_view(), dtype=np.uint8)
        # What a producer says of its own payload need not be true.
        return (header, voxels.reshape(header.dims)) if voxels.size == np.prod(header.dims, dtype=np.uint64) else None


def centres(where, size):
    """Centres of the voxels that are set, in the grid's frame."""
    return (np.argwhere(where) + 0.5 - np.array(where.shape) / 2) * size


def place(path, message):
    """Puts the grid of a message where it lies in the sensor's frame."""
    rr.log(path, rr.Transform3D(translation=list(message.position_m), quaternion=rr.Quaternion(xyzw=list(message.orientation))))


def log_query(header, voxels):
    size = header.voxel_size_m
    place("sensor/query", header)
    rr.log("sensor/query/seen", rr.Points3D(centres(voxels == 1, size), radii=size / 2, colors=BLUE))
    rr.log("sensor/query/hidden", rr.Points3D(centres(voxels == 255, size), radii=size / 8, colors=GREY))


def log_completion(completion):
    header, filled = completion.header, completion.occupancy >= 128
    place("sensor/completion", header)
    # The less sure, the more transparent.
    alpha = 255 - completion.deviation[filled]
    colors = np.column_stack([np.tile(ORANGE, (alpha.size, 1)), alpha]).astype(np.uint8)
    rr.log("sensor/completion/filled", rr.Points3D(centres(filled, header.voxel_size_m), radii=header.voxel_size_m / 2, colors=colors))


def log_pose(percept, class_name):
    """The object's axes in the grid, for every hypothesis, as long as it is probable."""
    place("sensor/pose", percept)
    for index in range(messages.Percept.hypotheses.size // ctypes.sizeof(messages.Hypothesis)):
        path = f"sensor/pose/{index}"
        if index >= percept.hypothesis_count:
            rr.log(path, rr.Clear(recursive=True))
            continue
        hypothesis = percept.hypotheses[index]
        length = hypothesis.probability * percept.voxel_size_m * max(percept.dims) / 2
        rr.log(path, rr.Transform3D(quaternion=rr.Quaternion(xyzw=list(hypothesis.rotation_object_to_grid))))
        rr.log(f"{path}/axes", rr.Arrows3D(vectors=np.eye(3) * length, colors=[(255, 0, 0), (0, 255, 0), (0, 0, 255)]))
    rr.log("class", rr.TextLog(f"{class_name} {100 * percept.posterior[percept.class_index]:.1f} %"))


def log_box(percept):
    """The object's box, if its size was found: its centre in the sensor's frame, its sides along the object's axes."""
    if not percept.object_extent_m[0] > 0:
        return rr.log("sensor/box", rr.Clear(recursive=True))
    rr.log("sensor/box", rr.Transform3D(translation=list(percept.object_position_m), quaternion=rr.Quaternion(xyzw=list(percept.orientation))))
    turned = rr.Quaternion(xyzw=list(percept.hypotheses[0].rotation_object_to_grid)) if percept.hypothesis_count else rr.Quaternion(xyzw=[0, 0, 0, 1])
    rr.log("sensor/box/object", rr.Boxes3D(half_sizes=[[side / 2 for side in percept.object_extent_m]], quaternions=[turned], colors=[ORANGE]))


def main(instance="default", count="inf", file=None):
    recorder = beo.within(10, lambda: Recorder(instance))
    rr.init("beo", spawn=file is None)
    if file is not None:
        rr.save(file)
    print("listening", file=sys.stderr, flush=True)
    shown = 0
    while shown < float(count):
        if not recorder.wait(0.5):
            recorder.maintain()
        while (observation := recorder.take_observation()) is not None:
            rr.set_time("sequence", sequence=observation[0].sequence)
            log_query(*observation)
        while (completion := recorder.take_completion()) is not None:
            rr.set_time("sequence", sequence=completion.header.sequence)
            log_completion(completion)
        while shown < float(count) and (percept := recorder.take_percept()) is not None:
            if percept.status == messages.PerceptStatus.OK:
                rr.set_time("sequence", sequence=percept.sequence)
                log_pose(percept, recorder.class_name(percept))
                log_box(percept)
            shown += 1
    print(f"showed {shown} percepts")


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except (beo.NotRunning, beo.NoRoom) as error:
        sys.exit(f"log_to_rerun: {error}")
    except KeyboardInterrupt:
        pass
