"""A robot's process: prints class, pose and latency of what the daemon perceives.

    python listen.py [INSTANCE] [COUNT]

INSTANCE: of the daemon (default); COUNT: percepts to print (without end).
"""

import math
import sys

import beo_client as beo
import beo_messages as messages


def describe(percept, subscriber):
    latency_us = (beo.monotonic_ns() - percept.capture_ns) / 1e3
    if percept.status != messages.PerceptStatus.OK:
        return f"#{percept.sequence} refused: {beo.text(percept.explanation)}"
    line = f"#{percept.sequence} {subscriber.class_name(percept)} {100 * percept.posterior[percept.class_index]:.1f} %, "
    if percept.hypothesis_count > 0:
        rotation = ", ".join(f"{value:.3f}" for value in percept.hypotheses[0].rotation_object_to_grid)
        line += f"rotation ({rotation}), spread {math.degrees(percept.rotation_spread_rad):.1f} deg, "
    if (box := beo.box(percept)) is not None:
        line += f"{box}, "
    return line + f"{latency_us:.0f} us"


def main(instance="default", count="inf"):
    subscriber = beo.within(10, lambda: beo.Subscriber(instance))
    print("listening", file=sys.stderr, flush=True)
    heard = told = 0
    while heard < float(count):
        if not subscriber.wait(0.5):
            subscriber.maintain()
            if not subscriber.daemon_runs():
                print("waiting for the daemon", file=sys.stderr, flush=True)
        while heard < float(count) and (percept := subscriber.take_percept()) is not None:
            print(describe(percept, subscriber), flush=True)
            heard += 1
        # More came than are kept for a reader.
        if subscriber.missed > told:
            print(f"missed {subscriber.missed - told} percepts", file=sys.stderr, flush=True)
            told = subscriber.missed


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except (beo.NotRunning, beo.NoRoom) as error:
        sys.exit(f"listen: {error}")
    except KeyboardInterrupt:
        pass
