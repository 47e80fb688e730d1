"""A zenoh client of its own: reads percepts by their published offsets, and prints what it read as one line of JSON.

    python reader.py ENDPOINT INSTANCE COUNT SECONDS
"""

import json
import struct
import sys
import threading
import time

import zenoh

endpoint, instance, count, seconds = sys.argv[1], sys.argv[2], int(sys.argv[3]), float(sys.argv[4])
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([endpoint]))
config.insert_json5("scouting/multicast/enabled", "false")
percepts, done = [], threading.Event()


def percept(sample):
    raw = sample.payload.to_bytes()
    producer, obj, sequence = struct.unpack_from("<QQQ", raw, 24)
    (class_index,) = struct.unpack_from("<I", raw, 248)
    posterior = struct.unpack_from("<64f", raw, 288)
    percepts.append({"bytes": len(raw), "producer": str(producer), "object": obj, "sequence": sequence, "class": class_index, "p": max(posterior)})
    if len(percepts) >= count:
        done.set()


def ask(session, key):
    """The first answer to a query, asked again until there is one: a status is there from the daemon's next heartbeat on."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for reply in session.get(f"beo/{instance}/{key}", timeout=10.0):
            if reply.ok:
                return reply.ok.payload.to_bytes()
        time.sleep(0.05)
    sys.exit(f"nobody answers for the {key}")


with zenoh.open(config) as session:
    subscriber = session.declare_subscriber(f"beo/{instance}/percept", percept)
    # The clock of the daemon's machine: this is the same machine.
    begun = time.monotonic_ns()
    (clock,) = struct.unpack("<Q", ask(session, "clock"))
    ended = time.monotonic_ns()
    status = ask(session, "status")
    (count_of_classes,) = struct.unpack_from("<I", status, 180)
    names = [status[196 + 32 * n : 228 + 32 * n].rstrip(b"\0").decode() for n in range(count_of_classes)]
    print("ready", flush=True)
    done.wait(seconds)
print(json.dumps({"percepts": percepts, "clock_is_between": begun <= clock <= ended, "classes": names}), flush=True)
