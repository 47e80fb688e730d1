"""A ROS 2 graph's other side, by CycloneDDS: publishes a depth image again and again, and prints what comes back as one line of JSON.

    python peer.py DOMAIN FOLDER

FOLDER holds `depth` (32-bit floats, metres) and `camera.json` (width, height, k, frame_id, encoding, count). The stamps count images: image
n is of second 1000 + n.
"""

import json
import struct
import sys
import time
from pathlib import Path

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

import ros_types as ros

DOMAIN, FOLDER = int(sys.argv[1]), Path(sys.argv[2])
CAMERA = json.loads((FOLDER / "camera.json").read_text())
WIDTH, HEIGHT, FRAME = CAMERA["width"], CAMERA["height"], CAMERA["frame_id"]
DEPTH = (FOLDER / "depth").read_bytes()
if CAMERA["encoding"] == "16UC1":
    metres = struct.unpack(f"<{WIDTH * HEIGHT}f", DEPTH)
    DEPTH = struct.pack(f"<{WIDTH * HEIGHT}H", *(min(65535, round(1000 * z)) for z in metres))
STEP = len(DEPTH) // HEIGHT

participant = DomainParticipant(DOMAIN)
RELIABLE = Policy.Reliability.Reliable(duration(seconds=1))


def writer(name, kind):
    qos = Qos(RELIABLE, Policy.Durability.Volatile, Policy.History.KeepLast(5))
    return DataWriter(participant, Topic(participant, "rt" + name, kind, qos=qos), qos=qos)


def reader(name, kind, durability=Policy.Durability.Volatile):
    qos = Qos(RELIABLE, durability, Policy.History.KeepLast(50))
    return DataReader(participant, Topic(participant, "rt" + name, kind, qos=qos), qos=qos)


images, infos = writer("/made_up/image", ros.Image), writer("/depth/camera_info", ros.CameraInfo)
detections = reader("/beo/detections", ros.Detection3DArray)
clouds = reader("/beo/completed_points", ros.PointCloud2)
markers = reader("/beo/markers", ros.MarkerArray)
labels = reader("/beo/label_info", ros.LabelInfo, Policy.Durability.TransientLocal)
diagnostics = reader("/diagnostics", ros.DiagnosticArray)
transforms = reader("/tf", ros.TFMessage)

found = {"detections": [], "clouds": [], "markers": [], "classes": [], "diagnostics": [], "frames": [], "latency_ms": []}
sent = {}


def header(number):
    return ros.Header(stamp=ros.Time(sec=1000 + number, nanosec=500), frame_id=FRAME)


def plain(head):
    return {"sec": head.stamp.sec, "nanosec": head.stamp.nanosec, "frame_id": head.frame_id}


def pose(found_pose):
    p, q = found_pose.position, found_pose.orientation
    return {"position": [p.x, p.y, p.z], "orientation": [q.x, q.y, q.z, q.w]}


def take():
    for array in detections.take(50):
        if array.header.stamp.sec in sent:
            found["latency_ms"].append((time.monotonic() - sent[array.header.stamp.sec]) * 1e3)
        found["detections"].append(
            {
                "header": plain(array.header),
                "objects": [
                    {
                        "id": one.id,
                        "header": plain(one.header),
                        "box": pose(one.bbox.center) | {"size": [one.bbox.size.x, one.bbox.size.y, one.bbox.size.z]},
                        "results": [
                            {"class": r.hypothesis.class_id, "score": r.hypothesis.score, "covariance": list(r.pose.covariance)} | pose(r.pose.pose)
                            for r in one.results
                        ],
                    }
                    for one in array.detections
                ],
            }
        )
    for cloud in clouds.take(50):
        raw = bytes(cloud.data)
        points = list(struct.iter_unpack("<fffffI", raw))
        fields = [f.name for f in cloud.fields]
        found["clouds"].append({"header": plain(cloud.header), "fields": fields, "width": cloud.width, "first": points[:1], "count": len(points)})
    for array in markers.take(50):
        found["markers"].append([[m.ns, m.id, m.type, m.action, m.text, len(m.points), m.header.frame_id] for m in array.markers])
    for info in labels.take(50):
        found["classes"] = [one.class_name for one in info.class_map]
    for array in diagnostics.take(50):
        found["diagnostics"].append([[s.level, s.name, s.message, {v.key: v.value for v in s.values}] for s in array.status])
    for array in transforms.take(50):
        found["frames"] += [[t.header.frame_id, t.child_frame_id] for t in array.transforms]


data, number, deadline = list(DEPTH), 0, time.monotonic() + CAMERA["seconds"]
k = CAMERA["k"]
p = [k[0], 0.0, k[2], 0.0, 0.0, k[4], k[5], 0.0, 0.0, 0.0, 1.0, 0.0]
identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
whole = ros.RegionOfInterest(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
done = lambda: len(found["detections"]) >= CAMERA["count"] and found["diagnostics"] and found["classes"] and found["clouds"]
while not done() and time.monotonic() < deadline:
    number += 1
    infos.write(
        ros.CameraInfo(
            header=header(number), height=HEIGHT, width=WIDTH, distortion_model="plumb_bob", d=[0.0] * 5, k=k, r=identity, p=p,
            binning_x=0, binning_y=0, roi=whole,
        )
    )
    image = ros.Image(
        header=header(number), height=HEIGHT, width=WIDTH, encoding=CAMERA["encoding"], is_bigendian=0, step=STEP, data=data
    )
    # Counted from before the image is put into the wire's form.
    sent[1000 + number] = time.monotonic()
    images.write(image)
    found.setdefault("write_ms", []).append((time.monotonic() - sent[1000 + number]) * 1e3)
    pause = time.monotonic() + CAMERA["pause"]
    while time.monotonic() < pause:
        take()
        time.sleep(0.0005)
found["sent"] = number
print(json.dumps(found), flush=True)
