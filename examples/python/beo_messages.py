"""The messages of the beo perception daemon as ctypes structures, exactly as they lie in shared memory.

Generated from the Rust sources: do not edit. What the fields mean is said in ipc/src/messages.rs and in ipc/include/beo.h.
"""

import ctypes
import enum

ABI_VERSION = 2
NO_CLASS = 4294967295
NO_RESTING_POSE = 4294967295
NOT_COMPUTED = -1.0
CUT_BORDER, CUT_OCCLUDER = 1, 2
TASK_CLASS, TASK_POSE, TASK_COMPLETION = 1, 2, 4


class PerceptStatus(enum.IntEnum):
    OK = 0
    BAD_DIMS = 1
    DIMS_NOT_OF_MODEL = 2
    BAD_VOXEL = 3
    BAD_HEADER = 4
    UNKNOWN_VERSION = 5
    POSE_SEARCH_NOT_SUPPORTED = 6
    INTERNAL = 7
    STOPPING = 8
    EXPIRED = 9
    NOTHING_SEEN = 10


class PoseSearch(enum.IntEnum):
    KNOWN = 0
    YAW = 1
    FULL = 2
    REST = 3


class CompletionFrame(enum.IntEnum):
    GRID = 0
    OBJECT = 1


class Outside(enum.IntEnum):
    EMPTY = 0
    UNKNOWN = 1


class View(enum.IntEnum):
    UNSPECIFIED = 0
    TOP_DOWN = 1
    CAMERA = 2


class ScaleSearch(enum.IntEnum):
    KNOWN = 0
    SEARCH = 1


class Unit(enum.IntEnum):
    UNKNOWN = 0
    METRES = 1


class Method(enum.IntEnum):
    NONE = 0
    AUTO = 1
    MEAN = 2
    PAPER = 3
    EVIDENCE = 4
    HULL = 5


class DaemonState(enum.IntEnum):
    SERVING = 0
    RELOADING = 1
    STOPPING = 2
    FAILING = 3


class ObservationHeader(ctypes.Structure):
    _fields_ = [
        ("abi_version", ctypes.c_uint32),
        ("pose_search", ctypes.c_uint32),
        ("producer_id", ctypes.c_uint64),
        ("object_id", ctypes.c_uint64),
        ("sequence", ctypes.c_uint64),
        ("capture_ns", ctypes.c_uint64),
        ("sensor_stamp_ns", ctypes.c_uint64),
        ("written_ns", ctypes.c_uint64),
        ("deadline_ns", ctypes.c_uint64),
        ("position_m", ctypes.c_double * 3),
        ("orientation", ctypes.c_double * 4),
        ("voxel_size_m", ctypes.c_float),
        ("dims", ctypes.c_uint32 * 3),
        ("tasks", ctypes.c_uint32),
        ("completion_frame", ctypes.c_uint32),
        ("outside", ctypes.c_uint32),
        ("view", ctypes.c_uint32),
        ("frame_id", ctypes.c_uint8 * 32),
        ("continued_object_id", ctypes.c_uint64),
        ("continues", ctypes.c_uint32),
        ("rotation_prior_concentration", ctypes.c_float),
        ("rotation_prior", ctypes.c_float * 4),
        ("sensor_position_m", ctypes.c_float * 3),
        ("scale_search", ctypes.c_uint32),
        ("known_side_m", ctypes.c_float),
        ("known_side_deviation_m", ctypes.c_float),
        ("unit", ctypes.c_uint32),
        ("cut", ctypes.c_uint32),
        ("share_support", ctypes.c_float),
        ("share_edge", ctypes.c_float),
        ("share_far", ctypes.c_float),
        ("surface_deviation_m", ctypes.c_float),
        ("reserved", ctypes.c_uint8 * 56),
    ]

    @staticmethod
    def type_name():
        return "beo.v2.ObservationHeader"


assert ctypes.sizeof(ObservationHeader) == 320
assert ObservationHeader.abi_version.offset == 0 and ObservationHeader.abi_version.size == 4
assert ObservationHeader.pose_search.offset == 4 and ObservationHeader.pose_search.size == 4
assert ObservationHeader.producer_id.offset == 8 and ObservationHeader.producer_id.size == 8
assert ObservationHeader.object_id.offset == 16 and ObservationHeader.object_id.size == 8
assert ObservationHeader.sequence.offset == 24 and ObservationHeader.sequence.size == 8
assert ObservationHeader.capture_ns.offset == 32 and ObservationHeader.capture_ns.size == 8
assert ObservationHeader.sensor_stamp_ns.offset == 40 and ObservationHeader.sensor_stamp_ns.size == 8
assert ObservationHeader.written_ns.offset == 48 and ObservationHeader.written_ns.size == 8
assert ObservationHeader.deadline_ns.offset == 56 and ObservationHeader.deadline_ns.size == 8
assert ObservationHeader.position_m.offset == 64 and ObservationHeader.position_m.size == 24
assert ObservationHeader.orientation.offset == 88 and ObservationHeader.orientation.size == 32
assert ObservationHeader.voxel_size_m.offset == 120 and ObservationHeader.voxel_size_m.size == 4
assert ObservationHeader.dims.offset == 124 and ObservationHeader.dims.size == 12
assert ObservationHeader.tasks.offset == 136 and ObservationHeader.tasks.size == 4
assert ObservationHeader.completion_frame.offset == 140 and ObservationHeader.completion_frame.size == 4
assert ObservationHeader.outside.offset == 144 and ObservationHeader.outside.size == 4
assert ObservationHeader.view.offset == 148 and ObservationHeader.view.size == 4
assert ObservationHeader.frame_id.offset == 152 and ObservationHeader.frame_id.size == 32
assert ObservationHeader.continued_object_id.offset == 184 and ObservationHeader.continued_object_id.size == 8
assert ObservationHeader.continues.offset == 192 and ObservationHeader.continues.size == 4
assert ObservationHeader.rotation_prior_concentration.offset == 196 and ObservationHeader.rotation_prior_concentration.size == 4
assert ObservationHeader.rotation_prior.offset == 200 and ObservationHeader.rotation_prior.size == 16
assert ObservationHeader.sensor_position_m.offset == 216 and ObservationHeader.sensor_position_m.size == 12
assert ObservationHeader.scale_search.offset == 228 and ObservationHeader.scale_search.size == 4
assert ObservationHeader.known_side_m.offset == 232 and ObservationHeader.known_side_m.size == 4
assert ObservationHeader.known_side_deviation_m.offset == 236 and ObservationHeader.known_side_deviation_m.size == 4
assert ObservationHeader.unit.offset == 240 and ObservationHeader.unit.size == 4
assert ObservationHeader.cut.offset == 244 and ObservationHeader.cut.size == 4
assert ObservationHeader.share_support.offset == 248 and ObservationHeader.share_support.size == 4
assert ObservationHeader.share_edge.offset == 252 and ObservationHeader.share_edge.size == 4
assert ObservationHeader.share_far.offset == 256 and ObservationHeader.share_far.size == 4
assert ObservationHeader.surface_deviation_m.offset == 260 and ObservationHeader.surface_deviation_m.size == 4
assert ObservationHeader.reserved.offset == 264 and ObservationHeader.reserved.size == 56


class Hypothesis(ctypes.Structure):
    _fields_ = [
        ("rotation_object_to_grid", ctypes.c_float * 4),
        ("class_index", ctypes.c_uint32),
        ("probability", ctypes.c_float),
    ]

    @staticmethod
    def type_name():
        return "beo.v2.Hypothesis"


assert ctypes.sizeof(Hypothesis) == 24
assert Hypothesis.rotation_object_to_grid.offset == 0 and Hypothesis.rotation_object_to_grid.size == 16
assert Hypothesis.class_index.offset == 16 and Hypothesis.class_index.size == 4
assert Hypothesis.probability.offset == 20 and Hypothesis.probability.size == 4


class Percept(ctypes.Structure):
    _fields_ = [
        ("abi_version", ctypes.c_uint32),
        ("status", ctypes.c_uint32),
        ("daemon_id", ctypes.c_uint64),
        ("model_id", ctypes.c_uint64),
        ("producer_id", ctypes.c_uint64),
        ("object_id", ctypes.c_uint64),
        ("sequence", ctypes.c_uint64),
        ("answer_number", ctypes.c_uint64),
        ("detail", ctypes.c_uint64),
        ("capture_ns", ctypes.c_uint64),
        ("sensor_stamp_ns", ctypes.c_uint64),
        ("written_ns", ctypes.c_uint64),
        ("received_ns", ctypes.c_uint64),
        ("projected_ns", ctypes.c_uint64),
        ("classified_ns", ctypes.c_uint64),
        ("posed_ns", ctypes.c_uint64),
        ("completed_ns", ctypes.c_uint64),
        ("published_ns", ctypes.c_uint64),
        ("position_m", ctypes.c_double * 3),
        ("orientation", ctypes.c_double * 4),
        ("voxel_size_m", ctypes.c_float),
        ("dims", ctypes.c_uint32 * 3),
        ("frame_id", ctypes.c_uint8 * 32),
        ("method", ctypes.c_uint32),
        ("class_count", ctypes.c_uint32),
        ("class_index", ctypes.c_uint32),
        ("hypothesis_count", ctypes.c_uint32),
        ("rotation_spread_rad", ctypes.c_float),
        ("tasks", ctypes.c_uint32),
        ("none_probability", ctypes.c_float),
        ("fit", ctypes.c_float),
        ("resting_pose", ctypes.c_uint32),
        ("filtered", ctypes.c_uint32),
        ("cut", ctypes.c_uint32),
        ("unit", ctypes.c_uint32),
        ("posterior", ctypes.c_float * 64),
        ("log_score", ctypes.c_float * 64),
        ("hypotheses", Hypothesis * 8),
        ("explanation", ctypes.c_uint8 * 128),
        ("object_position_m", ctypes.c_double * 3),
        ("object_position_deviation_m", ctypes.c_float * 3),
        ("object_extent_m", ctypes.c_float * 3),
        ("object_extent_deviation_m", ctypes.c_float * 3),
        ("reserved", ctypes.c_uint8 * 100),
    ]

    @staticmethod
    def type_name():
        return "beo.v2.Percept"


assert ctypes.sizeof(Percept) == 1280
assert Percept.abi_version.offset == 0 and Percept.abi_version.size == 4
assert Percept.status.offset == 4 and Percept.status.size == 4
assert Percept.daemon_id.offset == 8 and Percept.daemon_id.size == 8
assert Percept.model_id.offset == 16 and Percept.model_id.size == 8
assert Percept.producer_id.offset == 24 and Percept.producer_id.size == 8
assert Percept.object_id.offset == 32 and Percept.object_id.size == 8
assert Percept.sequence.offset == 40 and Percept.sequence.size == 8
assert Percept.answer_number.offset == 48 and Percept.answer_number.size == 8
assert Percept.detail.offset == 56 and Percept.detail.size == 8
assert Percept.capture_ns.offset == 64 and Percept.capture_ns.size == 8
assert Percept.sensor_stamp_ns.offset == 72 and Percept.sensor_stamp_ns.size == 8
assert Percept.written_ns.offset == 80 and Percept.written_ns.size == 8
assert Percept.received_ns.offset == 88 and Percept.received_ns.size == 8
assert Percept.projected_ns.offset == 96 and Percept.projected_ns.size == 8
assert Percept.classified_ns.offset == 104 and Percept.classified_ns.size == 8
assert Percept.posed_ns.offset == 112 and Percept.posed_ns.size == 8
assert Percept.completed_ns.offset == 120 and Percept.completed_ns.size == 8
assert Percept.published_ns.offset == 128 and Percept.published_ns.size == 8
assert Percept.position_m.offset == 136 and Percept.position_m.size == 24
assert Percept.orientation.offset == 160 and Percept.orientation.size == 32
assert Percept.voxel_size_m.offset == 192 and Percept.voxel_size_m.size == 4
assert Percept.dims.offset == 196 and Percept.dims.size == 12
assert Percept.frame_id.offset == 208 and Percept.frame_id.size == 32
assert Percept.method.offset == 240 and Percept.method.size == 4
assert Percept.class_count.offset == 244 and Percept.class_count.size == 4
assert Percept.class_index.offset == 248 and Percept.class_index.size == 4
assert Percept.hypothesis_count.offset == 252 and Percept.hypothesis_count.size == 4
assert Percept.rotation_spread_rad.offset == 256 and Percept.rotation_spread_rad.size == 4
assert Percept.tasks.offset == 260 and Percept.tasks.size == 4
assert Percept.none_probability.offset == 264 and Percept.none_probability.size == 4
assert Percept.fit.offset == 268 and Percept.fit.size == 4
assert Percept.resting_pose.offset == 272 and Percept.resting_pose.size == 4
assert Percept.filtered.offset == 276 and Percept.filtered.size == 4
assert Percept.cut.offset == 280 and Percept.cut.size == 4
assert Percept.unit.offset == 284 and Percept.unit.size == 4
assert Percept.posterior.offset == 288 and Percept.posterior.size == 256
assert Percept.log_score.offset == 544 and Percept.log_score.size == 256
assert Percept.hypotheses.offset == 800 and Percept.hypotheses.size == 192
assert Percept.explanation.offset == 992 and Percept.explanation.size == 128
assert Percept.object_position_m.offset == 1120 and Percept.object_position_m.size == 24
assert Percept.object_position_deviation_m.offset == 1144 and Percept.object_position_deviation_m.size == 12
assert Percept.object_extent_m.offset == 1156 and Percept.object_extent_m.size == 12
assert Percept.object_extent_deviation_m.offset == 1168 and Percept.object_extent_deviation_m.size == 12
assert Percept.reserved.offset == 1180 and Percept.reserved.size == 100


class CompletionHeader(ctypes.Structure):
    _fields_ = [
        ("abi_version", ctypes.c_uint32),
        ("frame", ctypes.c_uint32),
        ("daemon_id", ctypes.c_uint64),
        ("model_id", ctypes.c_uint64),
        ("producer_id", ctypes.c_uint64),
        ("object_id", ctypes.c_uint64),
        ("sequence", ctypes.c_uint64),
        ("capture_ns", ctypes.c_uint64),
        ("sensor_stamp_ns", ctypes.c_uint64),
        ("published_ns", ctypes.c_uint64),
        ("position_m", ctypes.c_double * 3),
        ("orientation", ctypes.c_double * 4),
        ("voxel_size_m", ctypes.c_float),
        ("dims", ctypes.c_uint32 * 3),
        ("frame_id", ctypes.c_uint8 * 32),
        ("rotation_object_to_grid", ctypes.c_float * 4),
        ("class_index", ctypes.c_uint32),
        ("method", ctypes.c_uint32),
        ("none_probability", ctypes.c_float),
        ("cut", ctypes.c_uint32),
        ("unit", ctypes.c_uint32),
        ("reserved", ctypes.c_uint8 * 76),
    ]

    @staticmethod
    def type_name():
        return "beo.v2.CompletionHeader"


assert ctypes.sizeof(CompletionHeader) == 288
assert CompletionHeader.abi_version.offset == 0 and CompletionHeader.abi_version.size == 4
assert CompletionHeader.frame.offset == 4 and CompletionHeader.frame.size == 4
assert CompletionHeader.daemon_id.offset == 8 and CompletionHeader.daemon_id.size == 8
assert CompletionHeader.model_id.offset == 16 and CompletionHeader.model_id.size == 8
assert CompletionHeader.producer_id.offset == 24 and CompletionHeader.producer_id.size == 8
assert CompletionHeader.object_id.offset == 32 and CompletionHeader.object_id.size == 8
assert CompletionHeader.sequence.offset == 40 and CompletionHeader.sequence.size == 8
assert CompletionHeader.capture_ns.offset == 48 and CompletionHeader.capture_ns.size == 8
assert CompletionHeader.sensor_stamp_ns.offset == 56 and CompletionHeader.sensor_stamp_ns.size == 8
assert CompletionHeader.published_ns.offset == 64 and CompletionHeader.published_ns.size == 8
assert CompletionHeader.position_m.offset == 72 and CompletionHeader.position_m.size == 24
assert CompletionHeader.orientation.offset == 96 and CompletionHeader.orientation.size == 32
assert CompletionHeader.voxel_size_m.offset == 128 and CompletionHeader.voxel_size_m.size == 4
assert CompletionHeader.dims.offset == 132 and CompletionHeader.dims.size == 12
assert CompletionHeader.frame_id.offset == 144 and CompletionHeader.frame_id.size == 32
assert CompletionHeader.rotation_object_to_grid.offset == 176 and CompletionHeader.rotation_object_to_grid.size == 16
assert CompletionHeader.class_index.offset == 192 and CompletionHeader.class_index.size == 4
assert CompletionHeader.method.offset == 196 and CompletionHeader.method.size == 4
assert CompletionHeader.none_probability.offset == 200 and CompletionHeader.none_probability.size == 4
assert CompletionHeader.cut.offset == 204 and CompletionHeader.cut.size == 4
assert CompletionHeader.unit.offset == 208 and CompletionHeader.unit.size == 4
assert CompletionHeader.reserved.offset == 212 and CompletionHeader.reserved.size == 76


class Status(ctypes.Structure):
    _fields_ = [
        ("abi_version", ctypes.c_uint32),
        ("pid", ctypes.c_uint32),
        ("daemon_id", ctypes.c_uint64),
        ("model_id", ctypes.c_uint64),
        ("started_ns", ctypes.c_uint64),
        ("heartbeat_ns", ctypes.c_uint64),
        ("heartbeat_interval_ns", ctypes.c_uint64),
        ("answer_number", ctypes.c_uint64),
        ("received", ctypes.c_uint64),
        ("answered", ctypes.c_uint64),
        ("dropped", ctypes.c_uint64),
        ("refused", ctypes.c_uint64),
        ("failed", ctypes.c_uint64),
        ("nothing_seen", ctypes.c_uint64),
        ("answered_none", ctypes.c_uint64),
        ("overflowed", ctypes.c_uint64),
        ("latency_count", ctypes.c_uint64),
        ("latency_p50_ns", ctypes.c_uint64),
        ("latency_p90_ns", ctypes.c_uint64),
        ("latency_p99_ns", ctypes.c_uint64),
        ("latency_p999_ns", ctypes.c_uint64),
        ("latency_max_ns", ctypes.c_uint64),
        ("dims", ctypes.c_uint32 * 3),
        ("class_count", ctypes.c_uint32),
        ("state", ctypes.c_uint32),
        ("reloads", ctypes.c_uint32),
        ("reloads_refused", ctypes.c_uint32),
        ("class_names", (ctypes.c_uint8 * 32) * 64),
        ("model_name", ctypes.c_uint8 * 64),
        ("reserved", ctypes.c_uint8 * 60),
    ]

    @staticmethod
    def type_name():
        return "beo.v2.Status"


assert ctypes.sizeof(Status) == 2368
assert Status.abi_version.offset == 0 and Status.abi_version.size == 4
assert Status.pid.offset == 4 and Status.pid.size == 4
assert Status.daemon_id.offset == 8 and Status.daemon_id.size == 8
assert Status.model_id.offset == 16 and Status.model_id.size == 8
assert Status.started_ns.offset == 24 and Status.started_ns.size == 8
assert Status.heartbeat_ns.offset == 32 and Status.heartbeat_ns.size == 8
assert Status.heartbeat_interval_ns.offset == 40 and Status.heartbeat_interval_ns.size == 8
assert Status.answer_number.offset == 48 and Status.answer_number.size == 8
assert Status.received.offset == 56 and Status.received.size == 8
assert Status.answered.offset == 64 and Status.answered.size == 8
assert Status.dropped.offset == 72 and Status.dropped.size == 8
assert Status.refused.offset == 80 and Status.refused.size == 8
assert Status.failed.offset == 88 and Status.failed.size == 8
assert Status.nothing_seen.offset == 96 and Status.nothing_seen.size == 8
assert Status.answered_none.offset == 104 and Status.answered_none.size == 8
assert Status.overflowed.offset == 112 and Status.overflowed.size == 8
assert Status.latency_count.offset == 120 and Status.latency_count.size == 8
assert Status.latency_p50_ns.offset == 128 and Status.latency_p50_ns.size == 8
assert Status.latency_p90_ns.offset == 136 and Status.latency_p90_ns.size == 8
assert Status.latency_p99_ns.offset == 144 and Status.latency_p99_ns.size == 8
assert Status.latency_p999_ns.offset == 152 and Status.latency_p999_ns.size == 8
assert Status.latency_max_ns.offset == 160 and Status.latency_max_ns.size == 8
assert Status.dims.offset == 168 and Status.dims.size == 12
assert Status.class_count.offset == 180 and Status.class_count.size == 4
assert Status.state.offset == 184 and Status.state.size == 4
assert Status.reloads.offset == 188 and Status.reloads.size == 4
assert Status.reloads_refused.offset == 192 and Status.reloads_refused.size == 4
assert Status.class_names.offset == 196 and Status.class_names.size == 2048
assert Status.model_name.offset == 2244 and Status.model_name.size == 64
assert Status.reserved.offset == 2308 and Status.reserved.size == 60


# What the attribute `beo.layout` of each service must say.
LAYOUTS = {
    "observation": "74fdf0008c04dc9d",
    "percept": "b6206edce7007b4d",
    "completion": "67df1109af4ea55e",
    "status": "fa9d4a7a2012470a",
}
