"""A ROS 2 graph's other side, by rclpy itself: publishes a depth image again and again, and prints what comes back as one line of JSON.

    python ros_peer.py FOLDER

FOLDER is as for peer.py, and so are the stamps. The domain is $ROS_DOMAIN_ID. Detections are not read here: vision_msgs is in no package for
Python; markers and clouds, which are published right after them, are.
"""

import array
import json
import struct
import sys
import time
from pathlib import Path

import rclpy
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from visualization_msgs.msg import MarkerArray

FOLDER = Path(sys.argv[1])
CAMERA = json.loads((FOLDER / "camera.json").read_text())

rclpy.init()
node = rclpy.create_node("peer")
# As cameras publish.
sensor = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST)
images, infos = node.create_publisher(Image, "/made_up/image", sensor), node.create_publisher(CameraInfo, "/depth/camera_info", sensor)
found = {"clouds": [], "markers": [], "latency_ms": []}
sent = {}


def plain(header):
    return {"sec": header.stamp.sec, "nanosec": header.stamp.nanosec, "frame_id": header.frame_id}


def on_markers(message):
    placed = [marker for marker in message.markers if marker.action == 0]
    if placed and placed[0].header.stamp.sec in sent:
        found["latency_ms"].append((time.monotonic() - sent[placed[0].header.stamp.sec]) * 1e3)
    found["markers"].append([[m.ns, m.id, m.type, m.action, m.text, len(m.points), m.header.frame_id] for m in message.markers])


def on_cloud(message):
    points = list(struct.iter_unpack("<fffffI", bytes(message.data)))
    names = [field.name for field in message.fields]
    found["clouds"].append(
        {"header": plain(message.header), "fields": names, "width": message.width, "first": points[:1], "count": len(points)}
    )


node.create_subscription(MarkerArray, "/beo/markers", on_markers, 10)
node.create_subscription(PointCloud2, "/beo/completed_points", on_cloud, 10)
image = Image(height=CAMERA["height"], width=CAMERA["width"], encoding="32FC1", step=4 * CAMERA["width"])
image.data = array.array("B", (FOLDER / "depth").read_bytes())
info = CameraInfo(height=CAMERA["height"], width=CAMERA["width"], distortion_model="plumb_bob", d=[0.0] * 5, k=CAMERA["k"])
image.header.frame_id = info.header.frame_id = CAMERA["frame_id"]
number, deadline = 0, time.monotonic() + CAMERA["seconds"]
while (len(found["latency_ms"]) < CAMERA["count"] or not found["clouds"]) and time.monotonic() < deadline:
    number += 1
    for message in (info, image):
        message.header.stamp.sec, message.header.stamp.nanosec = 1000 + number, 500
    infos.publish(info)
    sent[1000 + number] = time.monotonic()
    images.publish(image)
    pause = time.monotonic() + CAMERA["pause"]
    while time.monotonic() < pause:
        rclpy.spin_once(node, timeout_sec=0.002)
found["sent"] = number
found["nodes"] = sorted(node.get_node_names())
found["topics"] = {name: kinds for name, kinds in node.get_topic_names_and_types()}
node.destroy_node()
rclpy.shutdown()
print(json.dumps(found), flush=True)
