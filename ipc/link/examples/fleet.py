"""A fleet on one machine: robots that publish percepts of real size through one zenoh router, and a reader of all of them.

    pip install eclipse-zenoh
    python fleet.py --robots 1,5,10,25,50 --objects 3

Router, robots and reader are processes of their own. Each robot has its own zenoh session, as each `beo-link near` has, and at its frame rate
sends one percept for each object (with --completions its completion before it), with the keys and settings of `beo-link`: percepts wait where
the way is full, completions are dropped. What a robot could not send before its next frame is due is counted as left out, as a daemon's
queue would lose it. docs/fleet.md has what came out.
"""

import argparse
import json
import os
import socket
import struct
import subprocess
import sys
import threading
import time

PERCEPT, COMPLETION = 1280, 288 + 2 * 30**3
# Offsets of the message `Percept`: abi_version, producer_id, answer_number, published_ns.
VERSION_AT, PRODUCER_AT, NUMBER_AT, PUBLISHED_AT = 0, 24, 48, 128


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", default="1,5,10,25,50", help="numbers of robots, one run for each")
    parser.add_argument("--objects", type=int, default=3, help="objects that each robot sees in each frame")
    parser.add_argument("--rate", type=float, default=30.0, help="frames a second; 0 for as many as go")
    parser.add_argument("--seconds", type=float, default=5.0, help="of each run")
    parser.add_argument("--completions", action="store_true", help="send a completion of 30 x 30 x 30 voxels before each percept")
    parser.add_argument("--drop-percepts", action="store_true", help="drop percepts too where the way is full")
    parser.add_argument("--slow-reader", type=float, metavar="MS", help="a second reader that takes so many milliseconds for each percept")
    parser.add_argument("--json", action="store_true", help="one JSON object a run")
    parser.add_argument("--role", help=argparse.SUPPRESS)
    return parser.parse_args()


class Process:
    """This program in one of its roles. It says a line when it is ready, and at its end what it found."""

    def __init__(self, role, **task):
        command = [sys.executable, os.path.abspath(__file__), "--role", json.dumps({"role": role, **task})]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        if self.line() != "ready":
            raise SystemExit(f"the {role} is not ready")

    def say(self, word):
        self.process.stdin.write(word + "\n")
        self.process.stdin.flush()

    def line(self):
        return self.process.stdout.readline().strip()

    def end(self):
        """What it found; its input ends, and so does it."""
        self.process.stdin.close()
        found = self.line()
        self.process.wait(20)
        return json.loads(found or "null")

    def cpu_s(self):
        """CPU time of all its threads so far."""
        with open(f"/proc/{self.process.pid}/stat") as stat:
            fields = stat.read().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def run(options, robots):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    started = []

    def start(role, **task):
        started.append(Process(role, endpoint=endpoint, **task))
        return started[-1]

    try:
        router, reader = start("router"), start("reader", slow_ms=0, completions=options.completions)
        slow = start("reader", slow_ms=options.slow_reader, completions=False) if options.slow_reader else None
        fleet = start(
            "robots",
            robots=robots,
            objects=options.objects,
            rate=options.rate,
            seconds=options.seconds,
            completions=options.completions,
            drops=options.drop_percepts,
        )
        # Subscriptions have reached everybody.
        time.sleep(0.5)
        measured = [router, fleet, reader]
        before, begun = [process.cpu_s() for process in measured], time.monotonic()
        fleet.say("go")
        sent = json.loads(fleet.line())
        elapsed = time.monotonic() - begun
        time.sleep(1.0)
        cpu = [(process.cpu_s() - was) / elapsed for process, was in zip(measured, before)]
        read, slow_read = reader.end(), slow.end() if slow else None
        fleet.end()
    finally:
        for process in started:
            process.process.kill()
            process.process.wait()
    share = lambda part, of: 100.0 * part / max(of, 1)  # noqa: E731
    line = {
        "robots": robots,
        "percepts_per_s": round(sent["percepts"] / elapsed, 1),
        "left_out_percent": round(share(sent["left_out"], sent["percepts"] + sent["left_out"]), 2),
        "lost_percent": round(share(sent["percepts"] - read["percepts"], sent["percepts"]), 2),
        "p50_ms": read["p50_ms"],
        "p99_ms": read["p99_ms"],
        "most_ms": read["most_ms"],
        "router_cpu": round(cpu[0], 3),
        "robots_cpu": round(cpu[1], 3),
        "reader_cpu": round(cpu[2], 3),
    }
    if options.completions:
        line["completions_per_s"] = round(sent["completions"] / elapsed, 1)
        line["completions_dropped_percent"] = round(share(sent["completions"] - read["completions"], sent["completions"]), 2)
    if slow_read:
        line["slow_lost_percent"] = round(share(sent["percepts"] - slow_read["percepts"], sent["percepts"]), 2)
        line["slow_p50_ms"], line["slow_p99_ms"] = slow_read["p50_ms"], slow_read["p99_ms"]
    print(json.dumps(line) if options.json else ", ".join(f"{name} {value}" for name, value in line.items()), flush=True)


def open_session(endpoint, mode):
    """A session at this endpoint and nowhere else."""
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    config.insert_json5("listen/endpoints", json.dumps([endpoint] if mode == "router" else []))
    config.insert_json5("connect/endpoints", json.dumps([] if mode == "router" else [endpoint]))
    if mode != "router":
        # As in `beo-link`: messages go out one by one.
        config.insert_json5("transport/link/tx/queue/batching/enabled", "false")
    return zenoh.open(config)


def ready():
    print("ready", flush=True)


def router(task):
    with open_session(task["endpoint"], "router"):
        ready()
        sys.stdin.read()
    print("null", flush=True)


def robots(task):
    import zenoh

    sessions = [open_session(task["endpoint"], "client") for _ in range(task["robots"])]
    ready()
    sys.stdin.readline()
    sent, lock = {"percepts": 0, "completions": 0, "left_out": 0}, threading.Lock()
    begun = time.monotonic()

    def robot(number):
        put = zenoh.CongestionControl
        publisher = lambda channel, control: sessions[number].declare_publisher(  # noqa: E731
            f"beo/robot-{number}/{channel}", congestion_control=control, express=True
        )
        percepts, completions = publisher("percept", put.DROP if task["drops"] else put.BLOCK), publisher("completion", put.DROP)
        percept, completion = bytearray(PERCEPT), bytes([128]) * COMPLETION
        struct.pack_into("<I", percept, VERSION_AT, 2)
        struct.pack_into("<Q", percept, PRODUCER_AT, number + 1)
        period = 1.0 / task["rate"] if task["rate"] > 0 else 0.0
        # Cameras are not in step with each other.
        begin = begun + period * number / len(sessions)
        counts, frame = dict.fromkeys(sent, 0), 0
        while True:
            due = begin + period * frame
            if max(due, time.monotonic()) >= begin + task["seconds"]:
                break
            time.sleep(max(0.0, due - time.monotonic()))
            for place in range(task["objects"]):
                if period and time.monotonic() > due + period:
                    # The next frame is due: a daemon publishes what is newer.
                    counts["left_out"] += task["objects"] - place
                    break
                if task["completions"]:
                    completions.put(completion)
                    counts["completions"] += 1
                counts["percepts"] += 1
                struct.pack_into("<Q", percept, NUMBER_AT, counts["percepts"])
                struct.pack_into("<Q", percept, PUBLISHED_AT, time.monotonic_ns())
                percepts.put(bytes(percept))
            frame += 1
        with lock:
            for name, count in counts.items():
                sent[name] += count

    threads = [threading.Thread(target=robot, args=[number]) for number in range(len(sessions))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    print(json.dumps(sent), flush=True)
    sys.stdin.read()
    for session in sessions:
        session.close()
    print("null", flush=True)


def reader(task):
    latencies, completions = [], 0

    def percept(sample):
        now = time.monotonic_ns()
        raw = sample.payload.to_bytes()
        if len(raw) == PERCEPT:
            latencies.append(now - struct.unpack_from("<Q", raw, PUBLISHED_AT)[0])
        if task["slow_ms"]:
            time.sleep(task["slow_ms"] / 1e3)

    def completion(sample):
        nonlocal completions
        completions += len(sample.payload) == COMPLETION

    with open_session(task["endpoint"], "client") as session:
        subscribers = [session.declare_subscriber("beo/*/percept", percept)]
        if task["completions"]:
            subscribers.append(session.declare_subscriber("beo/*/completion", completion))
        ready()
        sys.stdin.read()
        count, found = len(latencies), sorted(latencies)
    at = lambda share: round(found[min(int(count * share), count - 1)] / 1e6, 3) if count else None  # noqa: E731
    print(json.dumps({"percepts": count, "completions": completions, "p50_ms": at(0.5), "p99_ms": at(0.99), "most_ms": at(1.0)}), flush=True)
    # A slow reader's session still has messages to give out, which nobody waits for.
    os._exit(0)


if __name__ == "__main__":
    options = arguments()
    if options.role:
        task = json.loads(options.role)
        {"router": router, "robots": robots, "reader": reader}[task["role"]](task)
    else:
        for count in options.robots.split(","):
            run(options, int(count))
