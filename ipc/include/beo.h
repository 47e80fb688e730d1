/*
 * beo.h: talk to the beo perception daemon over shared memory. Link with libbeo.
 *
 * Generated from the Rust sources: do not edit.
 *
 * Every function that can fail returns a status: 0 done, above 0 try again, below 0 an error; beo_last_error() says more. Handles may be
 * used from any thread, one thread at a time. A NULL, closed, released or wrong handle, a NULL pointer and a wrong size give a status, not
 * a crash. What a function opens, takes or loans belongs to the caller until the function named there ends it. The library starts no
 * threads, installs no signal handlers and prints nothing.
 *
 * Grids are in C order [x][y][z], z fastest and up. Lengths are metres; quaternions are x, y, z, w; stamps are nanoseconds of
 * CLOCK_MONOTONIC, 0 where a stage did not run.
 */

#ifndef BEO_H
#define BEO_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

/** The version of this header and of the messages; compare with beo_abi_version(). */
#define BEO_ABI_VERSION 2

/** A class_index that says that there is none. */
#define BEO_NO_CLASS UINT32_MAX
/** A resting_pose that says that there is none: the rotation was not searched among resting poses. */
#define BEO_NO_RESTING_POSE UINT32_MAX
/** A none_probability or fit that says that it was not computed. What was computed is never negative and never NaN. */
#define BEO_NOT_COMPUTED (-1.0f)

/** Class posterior: a bit of `tasks`. It is computed in any case. */
#define BEO_TASK_CLASS 1
/** Pose hypotheses: a bit of `tasks`. */
#define BEO_TASK_POSE 2
/** Completed occupancy with its uncertainty: a bit of `tasks`. */
#define BEO_TASK_COMPLETION 4

/** The object goes on beyond the border of the image: a bit of `cut`. */
#define BEO_CUT_BORDER 1
/** Something nearer hides a part of the object: a bit of `cut`. */
#define BEO_CUT_OCCLUDER 2

/** Most classes of a model. */
#define BEO_MAX_CLASSES 64
/** Most pose hypotheses of a percept. */
#define BEO_MAX_HYPOTHESES 8
/** Bytes of a class or frame name: UTF-8, padded with NUL, not necessarily NUL-terminated: print with "%.32s". */
#define BEO_NAME_LEN 32
/** Bytes of the explanation of a refused observation, as names: print with "%.128s". */
#define BEO_EXPLANATION_LEN 128


/**
 * The outcome of a call. 0: done. Above 0: nothing is broken, try again (later, or after what the text says). Below 0: an error, of
 * which `beo_last_error` says more.
 */
enum beo_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /** Done. */
    BEO_STATUS_OK = 0,
    /** There is nothing to take. */
    BEO_STATUS_EMPTY = 1,
    /** The time was up before it happened. */
    BEO_STATUS_TIMEOUT = 2,
    /** No daemon serves the instance (yet, or any more). */
    BEO_STATUS_NOT_RUNNING = 3,
    /** A signal came while the call waited. */
    BEO_STATUS_INTERRUPTED = 4,
    /** Another thread is using this handle. */
    BEO_STATUS_BUSY = 5,
    /** All memory for observations is loaned or still held by readers. */
    BEO_STATUS_NO_FREE_CHUNK = 6,
    /** Two completions are held: release one. */
    BEO_STATUS_TOO_MANY_HELD = 7,
    /** The frame does not show enough: no plane that objects could stand on, or too few readings of the object. */
    BEO_STATUS_NOT_SEEN = 8,
    /** An argument is NULL or out of its range. */
    BEO_STATUS_INVALID_ARGUMENT = -1,
    /** The `size` field of a struct, or a length, is not what it must be. */
    BEO_STATUS_WRONG_SIZE = -2,
    /** The handle was closed or released before, is of another kind, or never existed. */
    BEO_STATUS_BAD_HANDLE = -3,
    /** The instance's name is not a name. */
    BEO_STATUS_BAD_INSTANCE = -4,
    /** The grid's dims are outside 8 to 256. */
    BEO_STATUS_BAD_DIMS = -5,
    /** The daemon was built with other message layouts or another version of iceoryx2. */
    BEO_STATUS_OTHER_VERSION = -6,
    /** Clients of a daemon with other settings still hold its services. */
    BEO_STATUS_OTHER_SETTINGS = -7,
    /** There is not enough free shared memory. */
    BEO_STATUS_NO_SHARED_MEMORY = -8,
    /** The shared memory belongs to another user. */
    BEO_STATUS_NO_ACCESS = -9,
    /** As many clients are connected as the daemon was configured for. */
    BEO_STATUS_FULL = -10,
    /** A message contradicts itself and was thrown away. */
    BEO_STATUS_BROKEN = -11,
    /** The system or iceoryx2 failed. */
    BEO_STATUS_FAILED = -12,
    /** A fault of this library. */
    BEO_STATUS_INTERNAL = -13,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum beo_status beo_status;
#else
typedef int32_t beo_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/** How an observation was answered: `beo_percept.status`. */
enum beo_percept_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /** Answered. */
    BEO_PERCEPT_STATUS_OK = 0,
    /** The header's dims are outside the limits, or their product is not the payload's length. `detail` is the payload's length. */
    BEO_PERCEPT_STATUS_BAD_DIMS = 1,
    /** The dims are not those that the model was trained for. `detail` is the model's x | y << 16 | z << 32. */
    BEO_PERCEPT_STATUS_DIMS_NOT_OF_MODEL = 2,
    /** A voxel is neither 0 (empty), 1 (filled) nor 255 (unknown). `detail` is the voxel's index in the payload. */
    BEO_PERCEPT_STATUS_BAD_VOXEL = 3,
    /** A value of the header is out of its range (see the explanation). `detail` is 0. */
    BEO_PERCEPT_STATUS_BAD_HEADER = 4,
    /**
     * The header's `abi_version` is not `BEO_ABI_VERSION`. `detail` is the version found. Producer, object, sequence and stamps are
     * what lies at their places of this version.
     */
    BEO_PERCEPT_STATUS_UNKNOWN_VERSION = 5,
    /** The daemon cannot do this pose search. `detail` is the `pose_search` asked for. */
    BEO_PERCEPT_STATUS_POSE_SEARCH_NOT_SUPPORTED = 6,
    /** The daemon failed on a valid observation; the explanation says why. */
    BEO_PERCEPT_STATUS_INTERNAL = 7,
    /** The daemon ends and had no time left for this observation. `detail` is 0. */
    BEO_PERCEPT_STATUS_STOPPING = 8,
    /** The observation's `deadline_ns` had passed before its turn came. `detail` is by how many nanoseconds. */
    BEO_PERCEPT_STATUS_EXPIRED = 9,
    /** The grid holds nothing of an object: no voxel is filled. There is no class, no pose and no completion. `detail` is 0. */
    BEO_PERCEPT_STATUS_NOTHING_SEEN = 10,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum beo_percept_status beo_percept_status;
#else
typedef uint32_t beo_percept_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/** The prior knowledge of the object's rotation: `beo_observation_header.pose_search`. */
enum beo_pose_search
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /** The grid is in the object's canonical orientation. */
    BEO_POSE_SEARCH_KNOWN = 0,
    /** The object is upright; its rotation about z is unknown. */
    BEO_POSE_SEARCH_YAW = 1,
    /** The rotation is unknown. */
    BEO_POSE_SEARCH_FULL = 2,
    /**
     * The object rests on a support plane below the grid (up is the grid's +z), in any of the poses in which its class can rest, turned
     * by any angle about the vertical. In models that have learned no resting poses every class stands upright: then it is `Self.Yaw`.
     */
    BEO_POSE_SEARCH_REST = 3,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum beo_pose_search beo_pose_search;
#else
typedef uint32_t beo_pose_search;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/** The frame of a completed grid: `beo_observation_header.completion_frame` and `beo_completion_header.frame`. */
enum beo_completion_frame
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /** The observation's grid. */
    BEO_COMPLETION_FRAME_GRID = 0,
    /** The canonical orientation of the training shapes. */
    BEO_COMPLETION_FRAME_OBJECT = 1,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum beo_completion_frame beo_completion_frame;
#else
typedef uint32_t beo_completion_frame;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * The assumption about voxels outside the grid: `beo_observation_header.outside`. It matters where a rotated object reaches over the
 * grid's edge.
 */
enum beo_outside
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /** The grid holds the whole object: outside is empty. */
    BEO_OUTSIDE_EMPTY = 0,
    /** Nothing is known of what is outside. */
    BEO_OUTSIDE_UNKNOWN = 1,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum beo_outside beo_outside;
#else
typedef uint32_t beo_outside;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/** Where the sensor looked from: `beo_observation_header.view`. */
enum beo_view
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /** Not said. */
    BEO_VIEW_UNSPECIFIED = 0,
    /** From above, along −z of the grid. */
    BEO_VIEW_TOP_DOWN = 1,
    /** A camera at `beo_observation_header.sensor_position_m`. */
    BEO_VIEW_CAMERA = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum beo_view beo_view;
#else
typedef uint32_t beo_view;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/** The prior knowledge of the object's size and of its place in the grid: `beo_observation_header.scale_search`. */
enum beo_scale_search
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /** The grid lies about the object as it does about the training shapes: the same centre, the same share for the longest side. */
    BEO_SCALE_SEARCH_KNOWN = 0,
    /** The grid was laid about what is visible of the object: size and place are found. */
    BEO_SCALE_SEARCH_SEARCH = 1,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum beo_scale_search beo_scale_search;
#else
typedef uint32_t beo_scale_search;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/** The unit of an observation's lengths: `beo_observation_header.unit`. */
enum beo_unit
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /** Not known: lengths count voxels, or are in a unit that the producer knows. Nothing is concluded from true sizes. */
    BEO_UNIT_UNKNOWN = 0,
    /** Metres. */
    BEO_UNIT_METRES = 1,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum beo_unit beo_unit;
#else
typedef uint32_t beo_unit;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/** How a percept was computed: `beo_percept.method`. */
enum beo_method
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /** Nothing was computed: the observation was refused. */
    BEO_METHOD_NONE = 0,
    /** The calibrated blend. */
    BEO_METHOD_AUTO = 1,
    /** The nearest class mean on the known voxels. */
    BEO_METHOD_MEAN = 2,
    /** As in the paper. */
    BEO_METHOD_PAPER = 3,
    /** The evidence of the class models. */
    BEO_METHOD_EVIDENCE = 4,
    /** The class density of the visual hull. */
    BEO_METHOD_HULL = 5,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum beo_method beo_method;
#else
typedef uint32_t beo_method;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/** The state of the daemon: `beo_daemon_status.state`. */
enum beo_daemon_state
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /** It answers. */
    BEO_DAEMON_STATE_SERVING = 0,
    /** It answers with the model it has, and checks another. */
    BEO_DAEMON_STATE_RELOADING = 1,
    /** It ends: what waits is answered as long as there is time. */
    BEO_DAEMON_STATE_STOPPING = 2,
    /** It failed on the last observation that it tried to answer (`beo_percept_status.Internal`). */
    BEO_DAEMON_STATE_FAILING = 3,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum beo_daemon_state beo_daemon_state;
#else
typedef uint32_t beo_daemon_state;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/** A completed grid in shared memory. From `beo_subscriber_take_completion` to `beo_completion_release`. */
typedef struct beo_completion beo_completion;

/** Memory for one observation. From `beo_producer_loan` to `beo_loan_commit` or `beo_loan_abandon`. */
typedef struct beo_loan beo_loan;

/** Writes observations of one size. From `beo_producer_open` to `beo_producer_close`. */
typedef struct beo_producer beo_producer;

/** Reads percepts, completions and the status of a daemon. From `beo_subscriber_open` to `beo_subscriber_close`. */
typedef struct beo_subscriber beo_subscriber;

/**
 * Travels with every observation, before its voxels (one byte each: 0 empty, 1 filled, 255 unknown; C order `[x][y][z]`).
 *
 * `producer_id`, `sequence`, `written_ns`, `dims` and the default of `capture_ns` are filled in by `beo_producer`.
 */
typedef struct beo_observation_header {
    /** `BEO_ABI_VERSION`. */
    uint32_t abi_version;
    /** The prior knowledge of the rotation: a number of `beo_pose_search`. */
    uint32_t pose_search;
    /** Who wrote this; unique among the producers of a machine. */
    uint64_t producer_id;
    /** The producer's own name for the object: observations of one object replace each other when the daemon is busy. */
    uint64_t object_id;
    /** Counted by the producer, from 1. */
    uint64_t sequence;
    /** When the sensor data was taken. */
    uint64_t capture_ns;
    /** The producer's own stamp, of any clock, passed through. */
    uint64_t sensor_stamp_ns;
    /** When the grid was written and sent; 0 if the producer does not say. */
    uint64_t written_ns;
    /** After this time the answer is of no use: an observation whose turn comes later is refused; 0 for no deadline. */
    uint64_t deadline_ns;
    /** The grid's centre in the frame `frame_id`, metres. */
    double position_m[3];
    /** Turns grid axes into axes of the frame `frame_id`: unit quaternion x, y, z, w; refused where its norm is not 1 within 0.001. */
    double orientation[4];
    /** Edge of a voxel in the unit that `unit` says; 1 where the scale is not known (lengths then count voxels). */
    float voxel_size_m;
    /** Voxels along x, y, z. */
    uint32_t dims[3];
    /** The tasks to compute: bits of `BEO_TASK_…`. */
    uint32_t tasks;
    /** In which frame the completion is wanted: a number of `beo_completion_frame`. */
    uint32_t completion_frame;
    /** The assumption about voxels outside the grid: a number of `beo_outside`. */
    uint32_t outside;
    /** Where the sensor looked from: a number of `beo_view`. */
    uint32_t view;
    /** Name of the sensor's or the world's frame, UTF-8, padded with NUL. */
    uint8_t frame_id[32];
    /**
     * The `object_id` of this producer's object whose last answer narrows the pose search; read if `continues` is 1 and there is
     * no rotation prior.
     */
    uint64_t continued_object_id;
    /** 1 if this observation continues the stream `continued_object_id`, 0 if not. */
    uint32_t continues;
    /** How sure the producer is of `rotation_prior`: κ of the density exp(κ cos θ), θ the angle from it; 0 for not at all. */
    float rotation_prior_concentration;
    /**
     * The rotation that the producer expects: turns object axes into grid axes, unit quaternion x, y, z, w; read if
     * `rotation_prior_concentration` is not 0.
     */
    float rotation_prior[4];
    /** Where the camera is, from the grid's centre along the grid's axes, metres; read if `view` is `beo_view.Camera`. */
    float sensor_position_m[3];
    /** The prior knowledge of the object's size and place: a number of `beo_scale_search`. */
    uint32_t scale_search;
    /**
     * The object's longest side, metres, where the producer knows it and `scale_search` is `beo_scale_search.Search`: only the place is
     * then found; 0 where it does not.
     */
    float known_side_m;
    /** Standard deviation of `known_side_m`, metres; 0: exact. */
    float known_side_deviation_m;
    /** The unit of `voxel_size_m` and of all other lengths: a number of `beo_unit`. True sizes count only where it is `beo_unit.Metres`. */
    uint32_t unit;
    /** The causes that cut the object off, so that it may go on where nothing is known: bits of `BEO_CUT_…`. */
    uint32_t cut;
    /**
     * Share of the readings in the object's mask that were left out because they are the support's, 0 to 1. No reading counts in two
     * shares.
     */
    float share_support;
    /** Share that was left out because it lies at an edge in depth, between two surfaces, 0 to 1. */
    float share_edge;
    /** Share that was left out because it does not hang together with the object, 0 to 1. */
    float share_far;
    /**
     * Standard deviation of the surface's position along the line of sight, after readings of the same surface were combined, metres; 0
     * where it is not said.
     */
    float surface_deviation_m;
    /** 0. */
    uint8_t reserved[56];
} beo_observation_header;

/** How to subscribe. Start from `BEO_SUBSCRIBER_OPTIONS_INIT`. */
typedef struct beo_subscriber_options {
    /** `sizeof(beo_subscriber_options)`. */
    uint32_t size;
    /** 1: completions too; 0: without them, and the big segment is never mapped. Default: 0. */
    uint32_t completion;
    /** How long opening waits for the daemon, milliseconds; negative: without end. Default: 0. */
    int32_t wait_ms;
    /** 0. */
    uint32_t reserved;
} beo_subscriber_options;

/** How the object may be turned. */
typedef struct beo_hypothesis {
    /** Turns object axes into grid axes: unit quaternion x, y, z, w. */
    float rotation_object_to_grid[4];
    /** The class that this pose belongs to. */
    uint32_t class_index;
    /** Posterior probability of this class and pose. */
    float probability;
} beo_hypothesis;

/** The answer to one observation: class posterior, pose hypotheses, place and size, timings, status. */
typedef struct beo_percept {
    /** `BEO_ABI_VERSION`. */
    uint32_t abi_version;
    /**
     * A number of `beo_percept_status`; unless it is 0 (ok), class, posterior and hypotheses are empty and
     * `object_extent_m` is 0.
     */
    uint32_t status;
    /** The run of the daemon that answered; changes when the daemon restarts. */
    uint64_t daemon_id;
    /** The model that answered. */
    uint64_t model_id;
    /** Who wrote the observation. */
    uint64_t producer_id;
    /** The producer's own name for the object. */
    uint64_t object_id;
    /** The observation's number, counted by its producer. */
    uint64_t sequence;
    /**
     * The daemon's number for this percept: it counts all that it sends in this run, to whomever they are of use, from 1. A reader that
     * finds a gap has missed as many percepts.
     */
    uint64_t answer_number;
    /** More about `status`: see `beo_percept_status`. */
    uint64_t detail;
    /** When the sensor data was taken. */
    uint64_t capture_ns;
    /** The producer's own stamp, passed through. */
    uint64_t sensor_stamp_ns;
    /** When the producer sent the observation; 0 if it does not say. */
    uint64_t written_ns;
    /** When the daemon took the observation. */
    uint64_t received_ns;
    /** When the known voxels were projected; in a search, when every rotation's score was there. */
    uint64_t projected_ns;
    /** When the class posterior was ready. */
    uint64_t classified_ns;
    /** When the pose hypotheses were ready. */
    uint64_t posed_ns;
    /** When the completion was ready. */
    uint64_t completed_ns;
    /** When this percept was sent. */
    uint64_t published_ns;
    /** The grid's centre in the frame `frame_id`, metres, as the observation had it. */
    double position_m[3];
    /** Turns grid axes into axes of the frame `frame_id`: unit quaternion x, y, z, w, as the observation had it, at length 1. */
    double orientation[4];
    /** Edge of a voxel in the unit that `unit` says, as the observation had it. */
    float voxel_size_m;
    /** Voxels along x, y, z. */
    uint32_t dims[3];
    /** Name of the sensor's or the world's frame, UTF-8, padded with NUL. */
    uint8_t frame_id[32];
    /** How it was computed: a number of `beo_method`. */
    uint32_t method;
    /** How many entries of `posterior` and `log_score` are used. */
    uint32_t class_count;
    /** The most probable class, an index into the status' class names; `BEO_NO_CLASS` if there is none. */
    uint32_t class_index;
    /** How many entries of `hypotheses` are used, most probable first. */
    uint32_t hypothesis_count;
    /** Spread of the rotation's posterior: expected angle to the first hypothesis, radians. */
    float rotation_spread_rad;
    /** The tasks that were computed: bits of `BEO_TASK_…`. */
    uint32_t tasks;
    /**
     * Probability that the object is of none of the model's classes, 0 to 1; `BEO_NOT_COMPUTED` where the model cannot say. `posterior` is
     * that of the classes given that it is of one of them.
     */
    float none_probability;
    /**
     * How well the object fits its class: the share of the seen surface, 0 to 1, that lies within a voxel of what the class makes of it. It is
     * small for most things of no class. `BEO_NOT_COMPUTED` where it was not computed.
     */
    float fit;
    /**
     * Which of the resting poses of `class_index` the first hypothesis has, a number of the model's list; `BEO_NO_RESTING_POSE` if they
     * were not searched.
     */
    uint32_t resting_pose;
    /** 1 if earlier observations of the object count in this answer, 0 if it is this observation's alone. */
    uint32_t filtered;
    /** The causes that cut the object off, as the observation had them: bits of `BEO_CUT_…`. */
    uint32_t cut;
    /** The unit of all lengths, as the observation had it: a number of `beo_unit`. */
    uint32_t unit;
    /** Probability of each class; unused entries are 0. */
    float posterior[64];
    /**
     * Log score of each class by the method, before priors and calibration, natural logarithm: only differences between the classes of
     * one percept have a meaning. Unused entries are 0.
     */
    float log_score[64];
    /** Pose hypotheses, most probable first; unused entries are 0. */
    struct beo_hypothesis hypotheses[8];
    /** Why the observation was refused, for people: UTF-8, padded with NUL. */
    uint8_t explanation[128];
    /**
     * The centre of the object's box (along the object's axes), in the frame `frame_id`, metres; where neither size nor place was
     * searched, the grid's centre.
     */
    double object_position_m[3];
    /** Its standard deviation along the grid's axes, metres; 0 where it was not searched. */
    float object_position_deviation_m[3];
    /** Lengths of the object's box along the object's axes, metres; 0 where they were not estimated. */
    float object_extent_m[3];
    /** Their standard deviation, metres. */
    float object_extent_deviation_m[3];
    /** 0. */
    uint8_t reserved[100];
} beo_percept;

/**
 * Travels with every completion. Its payload is `2 × voxels` bytes: first the occupancy probability of every voxel, then its standard
 * deviation, each value × 255.
 */
typedef struct beo_completion_header {
    /** `BEO_ABI_VERSION`. */
    uint32_t abi_version;
    /** The frame of the payload: a number of `beo_completion_frame`. */
    uint32_t frame;
    /** The run of the daemon that answered. */
    uint64_t daemon_id;
    /** The model that answered. */
    uint64_t model_id;
    /** Who wrote the observation. */
    uint64_t producer_id;
    /** The producer's own name for the object. */
    uint64_t object_id;
    /** The observation's number, counted by its producer. */
    uint64_t sequence;
    /** When the sensor data was taken. */
    uint64_t capture_ns;
    /** The producer's own stamp, passed through. */
    uint64_t sensor_stamp_ns;
    /** When this completion was sent. */
    uint64_t published_ns;
    /** The grid's centre in the frame `frame_id`, metres, as the observation had it. */
    double position_m[3];
    /** Turns grid axes into axes of the frame `frame_id`: unit quaternion x, y, z, w, as the observation had it, at length 1. */
    double orientation[4];
    /** Edge of a voxel, metres. */
    float voxel_size_m;
    /** Voxels of the payload along x, y, z. */
    uint32_t dims[3];
    /** Name of the sensor's or the world's frame, UTF-8, padded with NUL. */
    uint8_t frame_id[32];
    /** The pose that was completed: turns object axes into grid axes, unit quaternion x, y, z, w. */
    float rotation_object_to_grid[4];
    /** The most probable class. */
    uint32_t class_index;
    /** How it was computed: a number of `beo_method`. */
    uint32_t method;
    /**
     * Probability that the object is of none of the model's classes, as its percept says: what is predicted is then of little use.
     * `BEO_NOT_COMPUTED` where the model cannot say.
     */
    float none_probability;
    /** The causes that cut the object off, as the observation had them: bits of `BEO_CUT_…`. The part beyond is predicted. */
    uint32_t cut;
    /** The unit of all lengths, as the observation had it: a number of `beo_unit`. */
    uint32_t unit;
    /** 0. */
    uint8_t reserved[76];
} beo_completion_header;

/** A completed grid where it lies in shared memory; valid until its `beo_completion` is released. Start from `BEO_COMPLETION_VIEW_INIT`. */
typedef struct beo_completion_view {
    /** `sizeof(beo_completion_view)`. */
    uint32_t size;
    /** 0. */
    uint32_t reserved;
    /** Voxels of the grid, and bytes of each of the two arrays. */
    size_t voxel_count;
    /** Probability of being filled × 255, one byte per voxel, C order `[x][y][z]`. */
    const uint8_t *occupancy;
    /** Standard deviation of that probability × 255, one byte per voxel, in the same order. */
    const uint8_t *deviation;
    /** The observation that it answers, and where the grid lies: a copy. */
    struct beo_completion_header header;
} beo_completion_view;

/** The daemon's heartbeat: who it is, what model it serves, how it does. */
typedef struct beo_daemon_status {
    /** `BEO_ABI_VERSION`. */
    uint32_t abi_version;
    /** The daemon's process id. */
    uint32_t pid;
    /** The run of the daemon; changes when it restarts. */
    uint64_t daemon_id;
    /** The model that is served. */
    uint64_t model_id;
    /** When the daemon started. */
    uint64_t started_ns;
    /** When this was sent. */
    uint64_t heartbeat_ns;
    /** When to expect the next: this long after `heartbeat_ns`. */
    uint64_t heartbeat_interval_ns;
    /** `beo_percept.answer_number` of the last percept that the daemon sent; 0 before the first. */
    uint64_t answer_number;
    /** Observations that the daemon took; the sum of the next three and of those that still wait (`beo_daemon_status.waiting`). */
    uint64_t received;
    /** Observations that were answered with status ok. */
    uint64_t answered;
    /** Observations that a newer one of the same stream replaced, or for which there was no room. */
    uint64_t dropped;
    /** Observations that were answered with another status. */
    uint64_t refused;
    /** Of the refused, those that were the daemon's own failure (`beo_percept_status.Internal`). */
    uint64_t failed;
    /** Of the refused, those in which nothing of an object was seen (`beo_percept_status.NothingSeen`). */
    uint64_t nothing_seen;
    /**
     * Of the answered, those whose object is more probably of none of the model's classes than of one
     * (`beo_percept.none_probability` above one half).
     */
    uint64_t answered_none;
    /**
     * Observations that were lost before the daemon took them, because their producer's queue was full: gaps in the numbers of the
     * observations that it took. Not part of `received`. Those before the first and after the last that it took are not known.
     */
    uint64_t overflowed;
    /** Percepts sent in the last minute; the latencies are theirs. Those refused on arrival do not count. */
    uint64_t latency_count;
    /** Median time from taking an observation to sending its percept, in the last minute, to within 1 %; 0 if there was none. */
    uint64_t latency_p50_ns;
    /** 90th percentile of the same. */
    uint64_t latency_p90_ns;
    /** 99th percentile of the same. */
    uint64_t latency_p99_ns;
    /** 99.9th percentile of the same. */
    uint64_t latency_p999_ns;
    /** Longest of the same. */
    uint64_t latency_max_ns;
    /** The model's dims. */
    uint32_t dims[3];
    /** How many entries of `class_names` are used. */
    uint32_t class_count;
    /** The state of the daemon: a number of `beo_daemon_state`. */
    uint32_t state;
    /** How often another model took the place of the one before. */
    uint32_t reloads;
    /** How often that was asked for and refused: the model before goes on. */
    uint32_t reloads_refused;
    /** The names of the classes: UTF-8, padded with NUL. */
    uint8_t class_names[64][32];
    /** The model's name, for people: UTF-8, padded with NUL. */
    uint8_t model_name[64];
    /** 0. */
    uint8_t reserved[60];
} beo_daemon_status;

/** How to open a producer. Start from `BEO_PRODUCER_OPTIONS_INIT`. */
typedef struct beo_producer_options {
    /** `sizeof(beo_producer_options)`. */
    uint32_t size;
    /** How long opening waits for the daemon, milliseconds; negative: without end. Default: 0. */
    int32_t wait_ms;
} beo_producer_options;

/**
 * A pinhole camera with lens distortion, as ROS's `camera_info` with `plumb_bob` describes it. The camera frame is the optical one: x
 * right, y down, z along the optical axis; pixels count from the centre of the first.
 */
typedef struct beo_intrinsics {
    /** Pixels of a row. */
    uint32_t width;
    /** Rows. */
    uint32_t height;
    /** Focal length along rows, pixels. */
    double fx;
    /** Focal length along columns, pixels. */
    double fy;
    /** Column of the principal point, pixels. */
    double cx;
    /** Row of the principal point, pixels. */
    double cy;
    /** k1, k2, p1, p2, k3; all 0 for none. */
    double distortion[5];
} beo_intrinsics;

/** One depth image and which object each of its pixels belongs to, both row by row. Start from `BEO_DEPTH_FRAME_INIT`. */
typedef struct beo_depth_frame {
    /** `sizeof(beo_depth_frame)`. */
    uint32_t size;
    /** 0. */
    uint32_t reserved;
    /** The camera. */
    struct beo_intrinsics intrinsics;
    /** Depth along the optical axis, metres; 0, negative or not finite: no reading. See `beo_depth_from_u16` for sensors of integers. */
    const float *depth_m;
    /** Readings at `depth_m`: width × height. */
    size_t depth_count;
    /** Label of the object that each pixel belongs to; 0: none. */
    const uint16_t *labels;
    /** Labels at `labels`: width × height. */
    size_t label_count;
} beo_depth_frame;

/**
 * How far readings may be from the surface: σ(z) = constant_m + quadratic_per_m · z², metres. A voxel within `deviations` of it from the
 * surface is filled; that band is never thinner than the voxel.
 */
typedef struct beo_sensor_model {
    /** Standard deviation at depth 0, metres. Default: 0.001. */
    double constant_m;
    /** Its growth with the squared depth, 1 / metres: 0.0019 for the first Kinect. Default: that. */
    double quadratic_per_m;
    /** Half the width of the band, in standard deviations. Default: 2. */
    double deviations;
} beo_sensor_model;

/** How a depth frame is looked at. Start from `BEO_CAMERA_OPTIONS_INIT`. */
typedef struct beo_camera_options {
    /** `sizeof(beo_camera_options)`. */
    uint32_t size;
    /** Pixels with this label are the support's, at most 65535; 0: those that belong to no object. Default: 0. */
    uint32_t support_label;
    /** The sensor. */
    struct beo_sensor_model sensor;
    /**
     * The direction up in the camera frame, of any length, where it is known (an accelerometer at rest points there); 0, 0, 0 where it is
     * not: then the support plane says so. Default: that.
     */
    double up[3];
    /** Longest side of what is visible of an object, as a share of its grid's shortest side, above 0 and at most 1. Default: 2 / 3. */
    double share;
    /** The object's longest side, metres, where it is known; 0 where it is not. Default: 0. */
    double known_side_m;
    /** Its standard deviation, metres; 0: exact. Default: 0. */
    double known_side_deviation_m;
    /** Fewest readings of an object for which a grid is laid. Default: 40. */
    uint32_t least_readings;
    /** 0. */
    uint32_t reserved;
} beo_camera_options;

/** A plane in the camera frame: what objects stand on. */
typedef struct beo_plane {
    /** Unit normal, to the side where objects are: up. */
    double normal[3];
    /** A point p is at the height normal · p + offset_m: of a support plane, how far the camera is above it. Metres. */
    double offset_m;
} beo_plane;

/**
 * Where a grid lies in the camera frame: its own frame has its origin at the grid's centre, axes along the indices, z up. And what is
 * known of the readings that it is carved from.
 */
typedef struct beo_grid {
    /** Voxels along x, y, z. */
    uint32_t dims[3];
    /** The causes that cut the object off: bits of `BEO_CUT_…`; 0: it is seen whole, or nothing is said. */
    uint32_t cut;
    /** Edge of a voxel, metres. */
    double voxel_size_m;
    /** The grid's centre, metres. */
    double position_m[3];
    /** Turns grid axes into axes of the camera: unit quaternion x, y, z, w. */
    double orientation[4];
    /** Share of the object's labelled readings that were left out because they are the support's, 0 to 1. */
    double share_support;
    /** Share that was left out because it lies at an edge in depth, 0 to 1. */
    double share_edge;
    /** Share that was left out because it does not hang together with the object, 0 to 1. */
    double share_far;
    /** Standard deviation of the surface's position along the line of sight, metres; 0 where it is not said. */
    double surface_deviation_m;
} beo_grid;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/** The version of the library that is linked: compare it with `BEO_ABI_VERSION`, the version of this header. */
uint32_t beo_abi_version(void);

/** The meaning of a status, in English. Never NULL, for any number; owned by the library, valid for ever. */
const char *beo_status_text(int32_t status);

/**
 * The message of the last call of this thread that did not succeed: what was wrong, where, and what to do. Never NULL, empty if all
 * succeeded; owned by the library, valid until this thread's next call that fails.
 */
const char *beo_last_error(void);

/** Now, in nanoseconds of CLOCK_MONOTONIC: the clock of all stamps, the same in all processes of a machine. */
uint64_t beo_monotonic_ns(void);

/**
 * Fills in `header` for a grid of nx × ny × nz voxels: known pose; class and completion; centred at the frame's origin; scale not known.
 *
 * `BEO_STATUS_BAD_DIMS` if an axis has fewer than 8 or more than 256 voxels.
 *
 * The caller promises:
 * `header` is NULL or writable.
 */
beo_status beo_observation_header_init(struct beo_observation_header *header,
                                       uint32_t nx,
                                       uint32_t ny,
                                       uint32_t nz);

/**
 * Opens a subscriber to the daemon of `instance` (NULL: "default") and stores its handle in `*subscriber`. `options` may be NULL.
 *
 * `BEO_STATUS_NOT_RUNNING` if there is no daemon after `wait_ms` milliseconds: try again. Once open, it survives the daemon: see
 * `beo_subscriber_wait`. The caller closes it.
 *
 * The caller promises:
 * `instance` is NULL or a NUL-terminated text; `options` is NULL or readable for its `size`; `subscriber` is NULL or writable.
 */
beo_status beo_subscriber_open(const char *instance,
                               const struct beo_subscriber_options *options,
                               struct beo_subscriber **subscriber);

/** Closes a subscriber. Completions taken from it stay valid until they are released. */
beo_status beo_subscriber_close(struct beo_subscriber *subscriber);

/**
 * Waits until the daemon has sent something, at most `timeout_ms` milliseconds (negative: without end; 0: not at all). Then take all
 * percepts and completions there are: one wake-up can stand for several.
 *
 * `BEO_STATUS_TIMEOUT` if nothing came, `BEO_STATUS_NOT_RUNNING` if nothing came and no daemon is there: waiting again is right for both,
 * as this call also connects to the next daemon. `BEO_STATUS_INTERRUPTED` if a signal came while it slept: the library installs no
 * handlers, the caller's have run. One that comes just before it sleeps does not end it: whoever stops by a signal waits with a timeout.
 */
beo_status beo_subscriber_wait(struct beo_subscriber *subscriber,
                               int32_t timeout_ms);

/**
 * A file descriptor for the caller's own poll or epoll loop: readable when the daemon has sent something, and now and then for a look at
 * the daemon. When it is readable, call `beo_subscriber_wait` with a timeout of 0, then take everything.
 *
 * It stays the same over restarts of the daemon. It belongs to the subscriber: do not close or read it; it ends with the subscriber.
 *
 * The caller promises:
 * `file_descriptor` is NULL or writable.
 */
beo_status beo_subscriber_file_descriptor(struct beo_subscriber *subscriber,
                                          int *file_descriptor);

/**
 * Copies the oldest percept not yet taken to `*percept`. A caller that does not take loses its oldest ones: 32 are kept.
 *
 * `BEO_STATUS_EMPTY` if there is none.
 *
 * The caller promises:
 * `percept` is NULL or writable.
 */
beo_status beo_subscriber_take_percept(struct beo_subscriber *subscriber,
                                       struct beo_percept *percept);

/**
 * How many percepts were published between those that this subscriber has taken, and lost here, to `*missed`: more came than are kept for a
 * reader, or they came from a daemon before it was connected to. Compare it with what it was before: it only grows.
 *
 * The caller promises:
 * `missed` is NULL or writable.
 */
beo_status beo_subscriber_missed(struct beo_subscriber *subscriber,
                                 uint64_t *missed);

/**
 * Takes the oldest completion not yet taken, where it lies: stores its handle in `*completion`, and where its arrays are in `*view`. A
 * completion comes before the percept of the same observation.
 *
 * `BEO_STATUS_EMPTY` if there is none, or if the subscriber was opened without completions. The caller releases it; two can be held at a
 * time, for a third `BEO_STATUS_TOO_MANY_HELD` is returned. One that is held keeps the channel of a daemon that is gone: one with a
 * model of other dims can then not start.
 *
 * The caller promises:
 * `completion` is NULL or writable; `view` is NULL or readable and writable for its `size`.
 */
beo_status beo_subscriber_take_completion(struct beo_subscriber *subscriber,
                                          struct beo_completion **completion,
                                          struct beo_completion_view *view);

/**
 * Copies the newest status of the daemon to `*status` (its model, class names, counters, latencies), and how old its heartbeat is to
 * `*heartbeat_age_ns`, which may be NULL. A heartbeat older than a few times `heartbeat_interval_ns` means that the daemon hangs or is
 * gone.
 *
 * `BEO_STATUS_EMPTY` before the first one, which comes within about a second of opening.
 *
 * The caller promises:
 * `status` is NULL or writable; `heartbeat_age_ns` is NULL or writable.
 */
beo_status beo_subscriber_status(struct beo_subscriber *subscriber,
                                 struct beo_daemon_status *status,
                                 uint64_t *heartbeat_age_ns);

/** Releases a completion: the pointers in its view end here. */
beo_status beo_completion_release(struct beo_completion *completion);

/**
 * Opens a producer of grids of nx × ny × nz voxels for the daemon of `instance` (NULL: "default") and stores its handle in `*producer`.
 * `options` may be NULL.
 *
 * `BEO_STATUS_NOT_RUNNING` if there is no daemon after `wait_ms` milliseconds: try again. Once open, it survives the daemon. Memory for
 * all its grids is taken and touched here: 1.1 MB at 30³, 164 MB at 254³. The caller closes it.
 *
 * The caller promises:
 * `instance` is NULL or a NUL-terminated text; `options` is NULL or readable for its `size`; `producer` is NULL or writable.
 */
beo_status beo_producer_open(const char *instance,
                             uint32_t nx,
                             uint32_t ny,
                             uint32_t nz,
                             const struct beo_producer_options *options,
                             struct beo_producer **producer);

/** Closes a producer. Its loans stay writable, but can only be abandoned. */
beo_status beo_producer_close(struct beo_producer *producer);

/**
 * The identifier of this producer, stored in `*id`: percepts repeat it as `producer_id`.
 *
 * The caller promises:
 * `id` is NULL or writable.
 */
beo_status beo_producer_id(struct beo_producer *producer, uint64_t *id);

/**
 * Loans memory for one grid: stores a handle in `*loan`, where the voxels are in `*voxels`, and how many in `*voxel_count`, which may be
 * NULL. Write every voxel: 0 empty, 1 filled, 255 unknown; voxel (x, y, z) is at `(x * ny + y) * nz + z`.
 *
 * `BEO_STATUS_NOT_RUNNING` while no daemon is there: leave this grid out, and try again with the next. The caller commits or abandons the
 * loan; two can be held at a time whatever the readers do, beyond that `BEO_STATUS_NO_FREE_CHUNK` can be returned.
 *
 * The caller promises:
 * `loan`, `voxels` and `voxel_count` are each NULL or writable.
 */
beo_status beo_producer_loan(struct beo_producer *producer,
                             struct beo_loan **loan,
                             uint8_t **voxels,
                             size_t *voxel_count);

/**
 * Sends the grid and stores its number, which its percept repeats, in `*sequence`, which may be NULL. Never waits for a reader. The loan
 * and its voxels end here, unless the header is refused with `BEO_STATUS_INVALID_ARGUMENT`. `BEO_STATUS_NOT_RUNNING` if the producer was
 * closed, or let go of a daemon that went away, after the loan: the grid is lost.
 *
 * `header` says what the grid is and what is asked for; start from `beo_observation_header_init`; NULL stands for what that fills in.
 * `producer_id`, `sequence` and `written_ns` are filled in here, and `capture_ns` if it is 0: with the time of the loan.
 *
 * The caller promises:
 * `header` is NULL or readable; `sequence` is NULL or writable.
 */
beo_status beo_loan_commit(struct beo_loan *loan,
                           const struct beo_observation_header *header,
                           uint64_t *sequence);

/** Gives the memory back without sending anything. The loan and its voxels end here. */
beo_status beo_loan_abandon(struct beo_loan *loan);

/**
 * Turns a depth image of integers into metres: `depth_m[i]` = `depth[i]` × `scale_m`, which is 0.001 for millimetres. 0 stays 0: no
 * reading. Once per frame, before the calls below.
 *
 * The caller promises:
 * `depth` is NULL or has `count` readable numbers; `depth_m` is NULL or has `count` writable ones, somewhere else.
 */
beo_status beo_depth_from_u16(const uint16_t *depth,
                              size_t count,
                              double scale_m,
                              float *depth_m);

/**
 * Finds the plane that objects stand on, and stores it in `*plane`: the one with the most readings among the pixels of
 * `options.support_label`, its normal within 15° of `options.up`; without that, the camera is taken to be upright and to look down on it.
 * The same frame gives the same plane. `options` may be NULL for the defaults.
 *
 * `BEO_STATUS_NOT_SEEN` if there is none: try the next frame, or use a plane that you know.
 *
 * The caller promises:
 * `frame` and `options` are NULL or readable for their `size`, and what the frame points to for as many values as it says; `plane` is
 * NULL or writable.
 */
beo_status beo_fit_support(const struct beo_depth_frame *frame,
                           const struct beo_camera_options *options,
                           struct beo_plane *plane);

/**
 * Labels what stands on the table of a frame without a mask: each object's pixels have its number, from 1 to `*object_count`, all others
 * 0. An object is what rises from a plane of the depth image, by 6 mm or more than the sensor's noise, and lies apart from the others. Of
 * `options`, `sensor` and `up` are used, as by beo_fit_support; it may be NULL for the defaults. `frame.labels` is not looked at: it may
 * be NULL, and it may be `labels`, so that the same frame can go to the calls below.
 *
 * The same frame gives the same numbers, but nothing is kept between calls: an object may have another number in the next frame. Where
 * there is no plane, or nothing stands on it, that is `BEO_STATUS_OK` with 0 objects. After an error nothing has been written.
 *
 * `BEO_STATUS_WRONG_SIZE` if `label_count` or `frame.depth_count` is not the camera's width × height.
 *
 * The caller promises:
 * `frame` and `options` are NULL or readable for their `size`, and `frame.depth_m` for as many values as the frame says; `labels` is NULL
 * or has `label_count` writable numbers, which are the caller's before and after; `object_count` is NULL or writable.
 */
beo_status beo_segment_table(const struct beo_depth_frame *frame,
                             const struct beo_camera_options *options,
                             uint16_t *labels,
                             size_t label_count,
                             uint32_t *object_count);

/**
 * Lays a grid of nx × ny × nz voxels about the pixels that are labelled `object`, and stores where it lies in `*grid`: upright, x away
 * from the camera, its centre that of the box about the readings, which reaches down to the support plane if they end near it. Its size
 * is by `options.share`, or by `options.known_side_m`. `options` may be NULL for the defaults; `support` may be NULL if there is none and
 * `options.up` says what is up.
 *
 * `BEO_STATUS_NOT_SEEN` if the object has too few readings: leave it out of this frame. `BEO_STATUS_BAD_DIMS` as for a producer.
 *
 * The caller promises:
 * `frame` and `options` are NULL or readable for their `size`, and what the frame points to for as many values as it says; `support` is
 * NULL or readable; `grid` is NULL or writable.
 */
beo_status beo_place_grid(const struct beo_depth_frame *frame,
                          const struct beo_camera_options *options,
                          uint16_t object,
                          const struct beo_plane *support,
                          uint32_t nx,
                          uint32_t ny,
                          uint32_t nz,
                          struct beo_grid *grid);

/**
 * Writes all `voxel_count` voxels of a grid, those of a loan, say: 0 empty, in front of the measured surface; 1 filled, within the
 * sensor's band of it at a pixel of `object`; 255 unknown, behind it, hidden, without reading or not in the image. With a `support`, what
 * lies below it is empty; it may be NULL, as may `options` for the defaults.
 *
 * `BEO_STATUS_WRONG_SIZE` if `voxel_count` is not what the grid's dims say.
 *
 * The caller promises:
 * `frame` and `options` are NULL or readable for their `size`, and what the frame points to for as many values as it says; `support` and
 * `grid` are NULL or readable; `voxels` is NULL or has `voxel_count` writable bytes.
 */
beo_status beo_carve(const struct beo_depth_frame *frame,
                     const struct beo_camera_options *options,
                     uint16_t object,
                     const struct beo_plane *support,
                     const struct beo_grid *grid,
                     uint8_t *voxels,
                     size_t voxel_count);

/**
 * Fills in `header` for a grid that was carved from a camera's frame: where it lies, in metres in the frame named "camera"; where the
 * camera is; what `grid` says of its readings; size, place, and rotation about the vertical to be found, in class, pose and completion;
 * outside of the grid unknown. `options.known_side_m` and `options.known_side_deviation_m` go with it. `options` may be NULL for the defaults. `object_id` and the rest are then the caller's to set.
 *
 * The caller promises:
 * `grid` is NULL or readable; `options` is NULL or readable for its `size`; `header` is NULL or writable.
 */
beo_status beo_observation_header_of_grid(const struct beo_grid *grid,
                                          const struct beo_camera_options *options,
                                          struct beo_observation_header *header);

/**
 * Sends one grid to the daemon of `instance` (NULL: "default"), waits for its percept and copies that to `*percept`. The whole, waiting
 * for the daemon included, takes at most `timeout_ms` milliseconds (negative: without end).
 *
 * `header` says what the grid is and what is asked for: start from `beo_observation_header_init`. `voxels` are `voxel_count` bytes, as
 * many as the header's dims say. `BEO_STATUS_TIMEOUT` if no percept came, `BEO_STATUS_NOT_RUNNING` if there was no daemon. A refused grid
 * has a percept too: see its `status` and `explanation`.
 *
 * This opens and closes a producer and a subscriber: for a stream of grids, keep them and use `beo_perceive_with`.
 *
 * The caller promises:
 * `instance` is NULL or a NUL-terminated text; `header` is NULL or readable; `voxels` is NULL or has `voxel_count` readable bytes;
 * `percept` is NULL or writable.
 */
beo_status beo_perceive(const char *instance,
                        const struct beo_observation_header *header,
                        const uint8_t *voxels,
                        size_t voxel_count,
                        int32_t timeout_ms,
                        struct beo_percept *percept);

/**
 * Sends one grid through `producer`, waits for its percept at `subscriber`, at most `timeout_ms` milliseconds (negative: without end), and
 * copies it to `*percept`. Percepts of other observations that come before it are taken and thrown away.
 *
 * As `beo_perceive` for the rest; `header` may be NULL as for `beo_loan_commit`.
 *
 * The caller promises:
 * `header` is NULL or readable; `voxels` is NULL or has `voxel_count` readable bytes; `percept` is NULL or writable.
 */
beo_status beo_perceive_with(struct beo_producer *producer,
                             struct beo_subscriber *subscriber,
                             const struct beo_observation_header *header,
                             const uint8_t *voxels,
                             size_t voxel_count,
                             int32_t timeout_ms,
                             struct beo_percept *percept);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* BEO_H */


/** Options to start from: `beo_subscriber_options options = BEO_SUBSCRIBER_OPTIONS_INIT;` */
#define BEO_SUBSCRIBER_OPTIONS_INIT { sizeof(beo_subscriber_options), 0, 0, 0 }
/** Options to start from: `beo_producer_options options = BEO_PRODUCER_OPTIONS_INIT;` */
#define BEO_PRODUCER_OPTIONS_INIT { sizeof(beo_producer_options), 0 }
/** Options to start from: `beo_camera_options options = BEO_CAMERA_OPTIONS_INIT;` */
#define BEO_CAMERA_OPTIONS_INIT { sizeof(beo_camera_options), 0, { 0.001, 0.0019, 2.0 }, { 0, 0, 0 }, 2.0 / 3.0, 0, 0, 40, 0 }
/** Zeroes `frame` and sets its size: a statement. */
#define BEO_DEPTH_FRAME_INIT(frame) (memset(&(frame), 0, sizeof(beo_depth_frame)), (frame).size = (uint32_t)sizeof(beo_depth_frame))
/** Zeroes `view` and sets its size: a statement. */
#define BEO_COMPLETION_VIEW_INIT(view) (memset(&(view), 0, sizeof(beo_completion_view)), (view).size = (uint32_t)sizeof(beo_completion_view))

#ifdef __cplusplus
#define BEO_STATIC_ASSERT(condition, text) static_assert(condition, text)
#else
#define BEO_STATIC_ASSERT(condition, text) _Static_assert(condition, text)
#endif

BEO_STATIC_ASSERT(sizeof(beo_observation_header) == 320, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, abi_version) == 0, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->abi_version) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, pose_search) == 4, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->pose_search) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, producer_id) == 8, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->producer_id) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, object_id) == 16, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->object_id) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, sequence) == 24, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->sequence) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, capture_ns) == 32, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->capture_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, sensor_stamp_ns) == 40, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->sensor_stamp_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, written_ns) == 48, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->written_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, deadline_ns) == 56, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->deadline_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, position_m) == 64, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->position_m) == 24, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, orientation) == 88, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->orientation) == 32, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, voxel_size_m) == 120, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->voxel_size_m) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, dims) == 124, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->dims) == 12, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, tasks) == 136, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->tasks) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, completion_frame) == 140, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->completion_frame) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, outside) == 144, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->outside) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, view) == 148, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->view) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, frame_id) == 152, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->frame_id) == 32, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, continued_object_id) == 184, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->continued_object_id) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, continues) == 192, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->continues) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, rotation_prior_concentration) == 196, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->rotation_prior_concentration) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, rotation_prior) == 200, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->rotation_prior) == 16, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, sensor_position_m) == 216, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->sensor_position_m) == 12, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, scale_search) == 228, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->scale_search) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, known_side_m) == 232, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->known_side_m) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, known_side_deviation_m) == 236, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->known_side_deviation_m) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, unit) == 240, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->unit) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, cut) == 244, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->cut) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, share_support) == 248, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->share_support) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, share_edge) == 252, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->share_edge) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, share_far) == 256, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->share_far) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, surface_deviation_m) == 260, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->surface_deviation_m) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_observation_header, reserved) == 264, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_observation_header *)0)->reserved) == 56, "layout");
BEO_STATIC_ASSERT(sizeof(beo_hypothesis) == 24, "layout");
BEO_STATIC_ASSERT(offsetof(beo_hypothesis, rotation_object_to_grid) == 0, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_hypothesis *)0)->rotation_object_to_grid) == 16, "layout");
BEO_STATIC_ASSERT(offsetof(beo_hypothesis, class_index) == 16, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_hypothesis *)0)->class_index) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_hypothesis, probability) == 20, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_hypothesis *)0)->probability) == 4, "layout");
BEO_STATIC_ASSERT(sizeof(beo_percept) == 1280, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, abi_version) == 0, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->abi_version) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, status) == 4, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->status) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, daemon_id) == 8, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->daemon_id) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, model_id) == 16, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->model_id) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, producer_id) == 24, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->producer_id) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, object_id) == 32, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->object_id) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, sequence) == 40, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->sequence) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, answer_number) == 48, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->answer_number) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, detail) == 56, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->detail) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, capture_ns) == 64, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->capture_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, sensor_stamp_ns) == 72, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->sensor_stamp_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, written_ns) == 80, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->written_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, received_ns) == 88, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->received_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, projected_ns) == 96, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->projected_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, classified_ns) == 104, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->classified_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, posed_ns) == 112, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->posed_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, completed_ns) == 120, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->completed_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, published_ns) == 128, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->published_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, position_m) == 136, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->position_m) == 24, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, orientation) == 160, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->orientation) == 32, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, voxel_size_m) == 192, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->voxel_size_m) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, dims) == 196, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->dims) == 12, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, frame_id) == 208, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->frame_id) == 32, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, method) == 240, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->method) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, class_count) == 244, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->class_count) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, class_index) == 248, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->class_index) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, hypothesis_count) == 252, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->hypothesis_count) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, rotation_spread_rad) == 256, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->rotation_spread_rad) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, tasks) == 260, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->tasks) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, none_probability) == 264, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->none_probability) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, fit) == 268, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->fit) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, resting_pose) == 272, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->resting_pose) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, filtered) == 276, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->filtered) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, cut) == 280, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->cut) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, unit) == 284, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->unit) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, posterior) == 288, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->posterior) == 256, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, log_score) == 544, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->log_score) == 256, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, hypotheses) == 800, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->hypotheses) == 192, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, explanation) == 992, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->explanation) == 128, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, object_position_m) == 1120, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->object_position_m) == 24, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, object_position_deviation_m) == 1144, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->object_position_deviation_m) == 12, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, object_extent_m) == 1156, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->object_extent_m) == 12, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, object_extent_deviation_m) == 1168, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->object_extent_deviation_m) == 12, "layout");
BEO_STATIC_ASSERT(offsetof(beo_percept, reserved) == 1180, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_percept *)0)->reserved) == 100, "layout");
BEO_STATIC_ASSERT(sizeof(beo_completion_header) == 288, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, abi_version) == 0, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->abi_version) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, frame) == 4, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->frame) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, daemon_id) == 8, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->daemon_id) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, model_id) == 16, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->model_id) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, producer_id) == 24, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->producer_id) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, object_id) == 32, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->object_id) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, sequence) == 40, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->sequence) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, capture_ns) == 48, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->capture_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, sensor_stamp_ns) == 56, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->sensor_stamp_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, published_ns) == 64, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->published_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, position_m) == 72, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->position_m) == 24, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, orientation) == 96, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->orientation) == 32, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, voxel_size_m) == 128, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->voxel_size_m) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, dims) == 132, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->dims) == 12, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, frame_id) == 144, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->frame_id) == 32, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, rotation_object_to_grid) == 176, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->rotation_object_to_grid) == 16, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, class_index) == 192, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->class_index) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, method) == 196, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->method) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, none_probability) == 200, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->none_probability) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, cut) == 204, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->cut) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, unit) == 208, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->unit) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_header, reserved) == 212, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_completion_header *)0)->reserved) == 76, "layout");
BEO_STATIC_ASSERT(sizeof(beo_daemon_status) == 2368, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, abi_version) == 0, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->abi_version) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, pid) == 4, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->pid) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, daemon_id) == 8, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->daemon_id) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, model_id) == 16, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->model_id) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, started_ns) == 24, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->started_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, heartbeat_ns) == 32, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->heartbeat_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, heartbeat_interval_ns) == 40, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->heartbeat_interval_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, answer_number) == 48, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->answer_number) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, received) == 56, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->received) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, answered) == 64, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->answered) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, dropped) == 72, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->dropped) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, refused) == 80, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->refused) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, failed) == 88, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->failed) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, nothing_seen) == 96, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->nothing_seen) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, answered_none) == 104, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->answered_none) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, overflowed) == 112, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->overflowed) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, latency_count) == 120, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->latency_count) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, latency_p50_ns) == 128, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->latency_p50_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, latency_p90_ns) == 136, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->latency_p90_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, latency_p99_ns) == 144, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->latency_p99_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, latency_p999_ns) == 152, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->latency_p999_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, latency_max_ns) == 160, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->latency_max_ns) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, dims) == 168, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->dims) == 12, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, class_count) == 180, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->class_count) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, state) == 184, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->state) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, reloads) == 188, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->reloads) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, reloads_refused) == 192, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->reloads_refused) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, class_names) == 196, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->class_names) == 2048, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, model_name) == 2244, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->model_name) == 64, "layout");
BEO_STATIC_ASSERT(offsetof(beo_daemon_status, reserved) == 2308, "layout");
BEO_STATIC_ASSERT(sizeof(((beo_daemon_status *)0)->reserved) == 60, "layout");
BEO_STATIC_ASSERT(sizeof(beo_subscriber_options) == 16, "layout");
BEO_STATIC_ASSERT(offsetof(beo_subscriber_options, size) == 0, "layout");
BEO_STATIC_ASSERT(offsetof(beo_subscriber_options, completion) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_subscriber_options, wait_ms) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_subscriber_options, reserved) == 12, "layout");
BEO_STATIC_ASSERT(sizeof(beo_producer_options) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_producer_options, size) == 0, "layout");
BEO_STATIC_ASSERT(offsetof(beo_producer_options, wait_ms) == 4, "layout");
BEO_STATIC_ASSERT(sizeof(beo_completion_view) == 8 + 3 * sizeof(void *) + sizeof(beo_completion_header), "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_view, size) == 0, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_view, reserved) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_view, voxel_count) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_view, occupancy) == 8 + sizeof(void *), "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_view, deviation) == 8 + 2 * sizeof(void *), "layout");
BEO_STATIC_ASSERT(offsetof(beo_completion_view, header) == 8 + 3 * sizeof(void *), "layout");
BEO_STATIC_ASSERT(sizeof(beo_intrinsics) == 80, "layout");
BEO_STATIC_ASSERT(offsetof(beo_intrinsics, width) == 0, "layout");
BEO_STATIC_ASSERT(offsetof(beo_intrinsics, height) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_intrinsics, fx) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_intrinsics, fy) == 16, "layout");
BEO_STATIC_ASSERT(offsetof(beo_intrinsics, cx) == 24, "layout");
BEO_STATIC_ASSERT(offsetof(beo_intrinsics, cy) == 32, "layout");
BEO_STATIC_ASSERT(offsetof(beo_intrinsics, distortion) == 40, "layout");
BEO_STATIC_ASSERT(sizeof(beo_depth_frame) == 88 + 4 * sizeof(void *), "layout");
BEO_STATIC_ASSERT(offsetof(beo_depth_frame, size) == 0, "layout");
BEO_STATIC_ASSERT(offsetof(beo_depth_frame, reserved) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_depth_frame, intrinsics) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_depth_frame, depth_m) == 88, "layout");
BEO_STATIC_ASSERT(offsetof(beo_depth_frame, depth_count) == 88 + sizeof(void *), "layout");
BEO_STATIC_ASSERT(offsetof(beo_depth_frame, labels) == 88 + 2 * sizeof(void *), "layout");
BEO_STATIC_ASSERT(offsetof(beo_depth_frame, label_count) == 88 + 3 * sizeof(void *), "layout");
BEO_STATIC_ASSERT(sizeof(beo_sensor_model) == 24, "layout");
BEO_STATIC_ASSERT(offsetof(beo_sensor_model, constant_m) == 0, "layout");
BEO_STATIC_ASSERT(offsetof(beo_sensor_model, quadratic_per_m) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_sensor_model, deviations) == 16, "layout");
BEO_STATIC_ASSERT(sizeof(beo_camera_options) == 88, "layout");
BEO_STATIC_ASSERT(offsetof(beo_camera_options, size) == 0, "layout");
BEO_STATIC_ASSERT(offsetof(beo_camera_options, support_label) == 4, "layout");
BEO_STATIC_ASSERT(offsetof(beo_camera_options, sensor) == 8, "layout");
BEO_STATIC_ASSERT(offsetof(beo_camera_options, up) == 32, "layout");
BEO_STATIC_ASSERT(offsetof(beo_camera_options, share) == 56, "layout");
BEO_STATIC_ASSERT(offsetof(beo_camera_options, known_side_m) == 64, "layout");
BEO_STATIC_ASSERT(offsetof(beo_camera_options, known_side_deviation_m) == 72, "layout");
BEO_STATIC_ASSERT(offsetof(beo_camera_options, least_readings) == 80, "layout");
BEO_STATIC_ASSERT(offsetof(beo_camera_options, reserved) == 84, "layout");
BEO_STATIC_ASSERT(sizeof(beo_plane) == 32, "layout");
BEO_STATIC_ASSERT(offsetof(beo_plane, normal) == 0, "layout");
BEO_STATIC_ASSERT(offsetof(beo_plane, offset_m) == 24, "layout");
BEO_STATIC_ASSERT(sizeof(beo_grid) == 112, "layout");
BEO_STATIC_ASSERT(offsetof(beo_grid, dims) == 0, "layout");
BEO_STATIC_ASSERT(offsetof(beo_grid, cut) == 12, "layout");
BEO_STATIC_ASSERT(offsetof(beo_grid, voxel_size_m) == 16, "layout");
BEO_STATIC_ASSERT(offsetof(beo_grid, position_m) == 24, "layout");
BEO_STATIC_ASSERT(offsetof(beo_grid, orientation) == 48, "layout");
BEO_STATIC_ASSERT(offsetof(beo_grid, share_support) == 80, "layout");
BEO_STATIC_ASSERT(offsetof(beo_grid, share_edge) == 88, "layout");
BEO_STATIC_ASSERT(offsetof(beo_grid, share_far) == 96, "layout");
BEO_STATIC_ASSERT(offsetof(beo_grid, surface_deviation_m) == 104, "layout");
