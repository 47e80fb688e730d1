"""Reading and writing the channels of the beo perception daemon with the official iceoryx2 package: nothing of beo is installed.

Needs `iceoryx2==0.10.0` (exactly the daemon's version) and NumPy. Arrays are views of shared memory, without a copy: each keeps its
sample alive, and a subscriber can hold two samples of a channel at a time. Copy what you want to keep (`array.copy()`).
"""

import ctypes
import os
import secrets
import time

import iceoryx2 as iox2
import numpy as np

import beo_messages as messages


def monotonic_ns():
    """The clock of all stamps."""
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC)


def text(field):
    """A text field of a message: UTF-8, padded with NUL."""
    return bytes(field).split(b"\0", 1)[0].decode(errors="replace")


def set_text(field, value):
    """Sets a text field of a message; what does not fit is cut off."""
    size = len(field)
    field[:] = value.encode()[:size].ljust(size, b"\0")


def box(percept):
    """Where the object's box is and how big, as text, if the daemon was asked to find out: in the sensor's frame, sides along the object's
    axes. Else None."""
    if percept.status != messages.PerceptStatus.OK or not percept.object_extent_m[0] > 0:
        return None

    def listed(values, separator=", "):
        return separator.join(f"{value:.3f}" for value in values)

    return (
        f"box at ({listed(percept.object_position_m)}) +- ({listed(percept.object_position_deviation_m)}) m, "
        f"sides {listed(percept.object_extent_m, ' x ')} +- ({listed(percept.object_extent_deviation_m)}) m"
    )


class NotRunning(RuntimeError):
    """No daemon serves the instance (yet): try again."""


class NoRoom(RuntimeError):
    """Shared memory is full: what iceoryx2 makes there would be a bus error when it is first written."""


# Shared memory of a process that joins an instance, beside its publishers.
_MEMBER_BYTES = 64 * 1024


def _require_room(needed):
    statistics = os.statvfs("/dev/shm")
    free = statistics.f_bavail * statistics.f_frsize
    if free < needed:
        raise NoRoom(f"not enough shared memory: {needed} bytes are needed and {free} are free in /dev/shm: free some, or enlarge it")


def within(timeout_s, make):
    """What `make()` gives, called again until a daemon is there or the time is up."""
    end = time.monotonic() + timeout_s
    while True:
        try:
            return make()
        except NotRunning:
            if time.monotonic() >= end:
                raise
        time.sleep(0.02)


class _Peer:
    """Joins the channels of one instance."""

    def __init__(self, instance):
        self.instance = instance
        _require_room(_MEMBER_BYTES)
        # An explicit configuration: the default one depends on the working directory. No signal handlers: Ctrl-C stays Python's.
        builder = iox2.NodeBuilder.new().config(iox2.config.default()).signal_handling_mode(iox2.SignalHandlingMode.Disabled)
        self.node = builder.create(iox2.ServiceType.Ipc)

    def _name(self, channel):
        return iox2.ServiceName.new(f"beo/{self.instance}/{channel}")

    def _service(self, channel, payload, header=None):
        builder = self.node.service_builder(self._name(channel)).publish_subscribe(payload)
        if header is not None:
            builder = builder.user_header(header)
        service = self._open(builder)
        layout = [value.to_string() for key, value in _attributes(service) if key == "beo.layout"]
        if layout != [messages.LAYOUTS[channel]]:
            raise RuntimeError(f"`{channel}` has the layout {layout}, beo_messages.py has {messages.LAYOUTS[channel]}: use the daemon's version")
        return service

    def _event(self, channel):
        return self._open(self.node.service_builder(self._name(channel)).event())

    def _open(self, builder):
        try:
            return builder.open()
        except (iox2.PublishSubscribeOpenError, iox2.EventOpenError) as error:
            if "IncompatibleTypes" in str(error):
                ours = messages.ABI_VERSION
                raise RuntimeError(f"the daemon of `{self.instance}` speaks another version of the messages than {ours}: use its own") from error
            if any(word in str(error) for word in ("DoesNotExist", "IsMarkedForDestruction", "HangsInCreation")):
                raise NotRunning(f"no daemon serves the instance `{self.instance}`: start `beo serve --instance {self.instance}`") from error
            raise

    def _require_daemon(self, percept_service):
        if percept_service.dynamic_config.number_of_publishers == 0:
            raise NotRunning(f"no daemon serves the instance `{self.instance}`: start `beo serve --instance {self.instance}`")


class Completion:
    """A completed grid: `header`, and `occupancy` and `deviation` as uint8 arrays [x][y][z] in shared memory, each value × 255."""

    def __init__(self, sample):
        self.header = messages.CompletionHeader.from_buffer_copy(sample.user_header().contents)
        payload = _view(sample.payload(), sample)
        self.occupancy, self.deviation = payload.reshape(2, *self.header.dims)


class Subscriber(_Peer):
    """Reads percepts, completions and the status of a daemon."""

    def __init__(self, instance="default", completion=False):
        super().__init__(instance)
        percepts = self._percept_service = self._service("percept", messages.Percept)
        self._require_daemon(percepts)
        self.listener = self._event("perceived").listener_builder().create()
        self.percepts = percepts.subscriber_builder().create()
        self.statuses = self._service("status", messages.Status).subscriber_builder().create()
        self.completions = None
        if completion:
            service = self._service("completion", iox2.Slice[ctypes.c_uint8], messages.CompletionHeader)
            self.completions = service.subscriber_builder().create()
        self.last_status = None
        # Percepts that were published between those that were taken, and lost here.
        self.missed, self._last = 0, None

    def wait(self, timeout_s):
        """Waits until the daemon has sent something: True if it has. Then take everything."""
        end = time.monotonic() + timeout_s
        while True:
            # In short pieces: Python handles a signal, such as Ctrl-C, once it is back in Python.
            left = max(0.0, end - time.monotonic())
            try:
                if self.listener.timed_wait(iox2.Duration.from_secs_f64(max(1e-6, min(left, 0.05)))):
                    return True
            except iox2.ListenerWaitError as error:
                if "InterruptSignal" not in str(error):
                    raise
            if left <= 0.05:
                return False

    def take_percept(self):
        """A copy of the oldest percept not yet taken, or None."""
        sample = self.percepts.receive()
        if sample is None:
            return None
        percept = messages.Percept.from_buffer_copy(sample.payload().contents)
        self._count_missed(percept.daemon_id, percept.answer_number)
        return percept

    def _count_missed(self, daemon, number):
        """Percepts of a daemon are numbered from 1 on: gaps are percepts that came faster than they were taken."""
        if self._last is None or self._last[0] != daemon or number > self._last[1]:
            if self._last is not None:
                self.missed += number - 1 - (self._last[1] if self._last[0] == daemon else 0)
            self._last = (daemon, number)

    def take_completion(self):
        """The oldest completion not yet taken, in place, or None."""
        sample = self.completions.receive()
        return sample and Completion(sample)

    def status(self):
        """A copy of the newest status, or None before the first, which comes within about a second."""
        while (sample := self.statuses.receive()) is not None:
            self.last_status = messages.Status.from_buffer_copy(sample.payload().contents)
        return self.last_status

    def class_name(self, percept):
        """The name of a percept's class."""
        while (status := self.status()) is None:
            self.wait(0.05)
        return text(status.class_names[percept.class_index]) if status.model_id == percept.model_id else "?"

    def daemon_runs(self):
        """Whether a daemon is there. One that was killed counts until someone has cleaned up after it: see `maintain`."""
        return self._percept_service.dynamic_config.number_of_publishers > 0

    def maintain(self):
        """Cleans up after a daemon that was killed; to be called when nothing has come for some seconds."""
        self.node.try_cleanup_dead_nodes()


class Loan:
    """Memory for one grid: `voxels` is a uint8 array [x][y][z] in shared memory, to be written in place; then `send()`."""

    def __init__(self, producer, sample):
        self._producer, self._sample = producer, sample
        self.header = sample.user_header().contents
        # The whole header at once: what is not set would be what the memory held before.
        ctypes.memmove(ctypes.byref(self.header), ctypes.byref(producer.header), ctypes.sizeof(self.header))
        self.header.capture_ns = monotonic_ns()
        self.voxels = _view(sample.payload(), sample).reshape(*producer.header.dims)

    def send(self):
        """Sends it, wakes the daemon, and gives its number. Never waits. Views of the voxels end here."""
        producer = self._producer
        producer.sent += 1
        self.header.sequence = sequence = producer.sent
        self.header.written_ns = monotonic_ns()
        sample, self._sample, self.header, self.voxels = self._sample, None, None, None
        sample.assume_init().send()
        producer.notifier.notify()
        return sequence


class Producer(_Peer):
    """Writes observations of one size. Every loan starts with a copy of `header`, which can be changed at any time."""

    def __init__(self, instance, dims):
        super().__init__(instance)
        self._require_daemon(self._service("percept", messages.Percept))
        service = self._service("observation", iox2.Slice[ctypes.c_uint8], messages.ObservationHeader)
        self.voxel_count = int(np.prod(dims))
        settings = service.static_config
        waiting = settings.max_subscribers * (settings.subscriber_max_buffer_size + settings.subscriber_max_borrowed_samples)
        # Two loans, and what iceoryx2 has beside each payload.
        _require_room(_MEMBER_BYTES + (waiting + settings.history_size + 2) * (self.voxel_count + 512))
        builder = service.publisher_builder().initial_max_slice_len(self.voxel_count).max_loaned_samples(2)
        self.publisher = builder.allocation_strategy(iox2.AllocationStrategy.Static).create()
        self.notifier = self._event("observed").notifier_builder().create()
        self.sent = 0
        self.header = messages.ObservationHeader(
            abi_version=messages.ABI_VERSION,
            producer_id=secrets.randbits(64) or 1,
            orientation=(0.0, 0.0, 0.0, 1.0),
            voxel_size_m=1.0,
            dims=tuple(dims),
            tasks=messages.TASK_CLASS | messages.TASK_COMPLETION,
            rotation_prior=(0.0, 0.0, 0.0, 1.0),
        )

    def loan(self):
        """Memory for one grid. Write every voxel: 0 empty, 1 filled, 255 unknown."""
        return Loan(self, self.publisher.loan_slice_uninit(self.voxel_count))


def _attributes(service):
    attributes = service.attributes
    return [(attribute.key.to_string(), attribute.value) for attribute in attributes.values]


def _view(payload, sample):
    array = (ctypes.c_uint8 * payload.len()).from_address(payload.as_ptr())
    # The NumPy array keeps `array` alive, and `array` the sample.
    array._sample = sample
    return np.frombuffer(array, dtype=np.uint8)
