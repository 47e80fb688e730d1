/* Breaks the rules of the C interface, one after the other: each must give its status, and nothing may crash.
 *
 *     misuse INSTANCE NOBODY
 *
 * INSTANCE: of a daemon with a model of 16 voxels a side; NOBODY: an instance without a daemon.
 */

#define _XOPEN_SOURCE 700
#include <beo.h>
#include <math.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>
#include <unistd.h>

enum { SIDE = 16, VOXELS = SIDE * SIDE * SIDE };

#define MUST(condition)                                                                                                                   \
    do {                                                                                                                                  \
        if (!(condition)) {                                                                                                               \
            fprintf(stderr, "line %d: not true: %s (last error: %s)\n", __LINE__, #condition, beo_last_error());                          \
            exit(1);                                                                                                                      \
        }                                                                                                                                 \
    } while (0)

#define GIVES(status, call)                                                                                                               \
    do {                                                                                                                                  \
        const beo_status given = (call);                                                                                                  \
        if (given != (status)) {                                                                                                          \
            fprintf(stderr, "line %d: %s gives %d, not %s: %s\n", __LINE__, #call, (int)given, #status, beo_last_error());                \
            exit(1);                                                                                                                      \
        }                                                                                                                                 \
    } while (0)

static void ignore_alarm(int signal) { (void)signal; }

static void texts(void) {
    MUST(beo_abi_version() == BEO_ABI_VERSION);
    MUST(strcmp(beo_status_text(BEO_STATUS_OK), "done") == 0);
    MUST(strcmp(beo_status_text(12345), "unknown status") == 0);
    MUST(strcmp(beo_last_error(), "") == 0);
    MUST(beo_monotonic_ns() > 0);
}

static void nulls(void) {
    beo_percept percept;
    beo_daemon_status status;
    beo_completion_view view;
    BEO_COMPLETION_VIEW_INIT(view);
    beo_completion *completion;
    beo_loan *loan;
    uint8_t *voxels, voxel = 0;
    uint64_t id;
    int descriptor;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_observation_header_init(NULL, SIDE, SIDE, SIDE));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_subscriber_open("x", NULL, NULL));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_subscriber_close(NULL));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_subscriber_wait(NULL, 0));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_subscriber_file_descriptor(NULL, &descriptor));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_subscriber_take_percept(NULL, &percept));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_subscriber_take_completion(NULL, &completion, &view));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_subscriber_status(NULL, &status, NULL));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_completion_release(NULL));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_producer_open("x", SIDE, SIDE, SIDE, NULL, NULL));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_producer_close(NULL));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_producer_id(NULL, &id));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_producer_loan(NULL, &loan, &voxels, NULL));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_loan_commit(NULL, NULL, NULL));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_loan_abandon(NULL));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_perceive("x", NULL, &voxel, 1, 0, &percept));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_perceive_with(NULL, NULL, NULL, &voxel, 1, 0, &percept));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_perceive_with(NULL, NULL, NULL, NULL, 0, 0, &percept));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_perceive_with(NULL, NULL, NULL, &voxel, 1, 0, NULL));
    MUST(strstr(beo_last_error(), "`percept` is NULL") != NULL);
}

enum { COLUMNS = 64, ROWS = 48, PIXELS = COLUMNS * ROWS };

/* A block before a wall, which is the support: its normal is towards the camera, which `up` must say. */
static void from_depth_to_a_grid(void) {
    static uint16_t readings[PIXELS], labels[PIXELS];
    static float depth[PIXELS];
    for (int i = 0; i < PIXELS; i++) {
        const int column = i % COLUMNS, row = i / COLUMNS;
        labels[i] = column >= 24 && column < 40 && row >= 16 && row < 32 ? 2 : 0;
        readings[i] = labels[i] ? 900 : 1000;
    }
    readings[0] = 0;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_depth_from_u16(NULL, PIXELS, 0.001, depth));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_depth_from_u16(readings, PIXELS, 0.001, NULL));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_depth_from_u16(readings, PIXELS, 0.0, depth));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_depth_from_u16(readings, PIXELS, -1.0, depth));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_depth_from_u16(readings, PIXELS, (double)NAN, depth));
    GIVES(BEO_STATUS_WRONG_SIZE, beo_depth_from_u16(readings, SIZE_MAX, 0.001, depth));
    GIVES(BEO_STATUS_OK, beo_depth_from_u16(readings, PIXELS, 0.001, depth));
    MUST(depth[0] == 0.0f && depth[1] == 1.0f && depth[20 * COLUMNS + 30] == 0.9f);

    beo_depth_frame frame;
    BEO_DEPTH_FRAME_INIT(frame);
    const beo_intrinsics camera = {COLUMNS, ROWS, 60, 60, 31.5, 23.5, {0, 0, 0, 0, 0}};
    beo_camera_options options = BEO_CAMERA_OPTIONS_INIT;
    beo_plane plane;
    beo_grid grid;
    beo_observation_header header;
    static uint8_t voxels[VOXELS];
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_fit_support(&frame, NULL, &plane)); /* no camera */
    frame.intrinsics = camera;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_fit_support(&frame, NULL, &plane)); /* no images */
    frame.depth_m = depth;
    frame.depth_count = PIXELS;
    frame.labels = labels;
    frame.label_count = PIXELS - 1;
    GIVES(BEO_STATUS_WRONG_SIZE, beo_fit_support(&frame, NULL, &plane));
    MUST(strstr(beo_last_error(), "label") != NULL);
    frame.label_count = SIZE_MAX;
    GIVES(BEO_STATUS_WRONG_SIZE, beo_fit_support(&frame, NULL, &plane));
    frame.label_count = PIXELS;
    frame.depth_m = (const float *)(const void *)((const char *)depth + 1);
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_fit_support(&frame, NULL, &plane));
    frame.depth_m = depth;
    frame.reserved = 1;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_fit_support(&frame, NULL, &plane));
    frame.reserved = 0;
    frame.size--;
    GIVES(BEO_STATUS_WRONG_SIZE, beo_fit_support(&frame, NULL, &plane));
    frame.size++;
    frame.intrinsics.fx = 0;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_fit_support(&frame, NULL, &plane));
    frame.intrinsics.fx = 60;
    frame.intrinsics.distortion[4] = (double)INFINITY;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_fit_support(&frame, NULL, &plane));
    frame.intrinsics.distortion[4] = 0;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_fit_support(NULL, NULL, &plane));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_fit_support(&frame, NULL, NULL));
    uint32_t objects;
    static uint16_t segments[PIXELS];
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_segment_table(NULL, NULL, segments, PIXELS, &objects));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_segment_table(&frame, NULL, NULL, PIXELS, &objects));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_segment_table(&frame, NULL, segments, PIXELS, NULL));
    GIVES(BEO_STATUS_WRONG_SIZE, beo_segment_table(&frame, NULL, segments, PIXELS - 1, &objects));
    GIVES(BEO_STATUS_OK, beo_segment_table(&frame, NULL, segments, PIXELS, &objects));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_place_grid(NULL, &options, 2, NULL, SIDE, SIDE, SIDE, &grid));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_place_grid(&frame, &options, 2, NULL, SIDE, SIDE, SIDE, NULL));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_place_grid(&frame, NULL, 2, NULL, SIDE, SIDE, SIDE, &grid));
    MUST(strstr(beo_last_error(), "up") != NULL);

    /* Nothing to stand on and nothing to see is no error: the next frame may show it. */
    options.support_label = 7;
    GIVES(BEO_STATUS_NOT_SEEN, beo_fit_support(&frame, &options, &plane));
    options.support_label = 0;
    options.up[2] = -4;
    GIVES(BEO_STATUS_NOT_SEEN, beo_place_grid(&frame, &options, 3, NULL, SIDE, SIDE, SIDE, &grid));
    MUST(strstr(beo_last_error(), "object 3 has 0 depth readings") != NULL);

    options.size = 8;
    GIVES(BEO_STATUS_WRONG_SIZE, beo_fit_support(&frame, &options, &plane));
    options.size = sizeof options;
    const beo_camera_options good = options;
#define BAD_OPTION(field, value)                                                                                                          \
    do {                                                                                                                                  \
        options.field = (value);                                                                                                          \
        GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_fit_support(&frame, &options, &plane));                                                    \
        options = good;                                                                                                                   \
    } while (0)
    BAD_OPTION(support_label, 65536);
    BAD_OPTION(sensor.constant_m, -1);
    BAD_OPTION(sensor.deviations, (double)NAN);
    BAD_OPTION(up[0], (double)NAN);
    BAD_OPTION(up[0], (double)INFINITY);
    BAD_OPTION(share, 0);
    BAD_OPTION(share, 1.5);
    BAD_OPTION(known_side_m, -1);
    BAD_OPTION(known_side_m, (double)NAN);
    BAD_OPTION(known_side_deviation_m, -1);
    BAD_OPTION(reserved, 1);

    GIVES(BEO_STATUS_OK, beo_fit_support(&frame, &options, &plane));
    MUST(fabs(plane.normal[2] + 1) < 1e-6 && fabs(plane.offset_m - 1) < 1e-6);
    GIVES(BEO_STATUS_BAD_DIMS, beo_place_grid(&frame, &options, 2, &plane, SIDE, 7, SIDE, &grid));
    beo_plane no_plane = plane;
    no_plane.normal[0] = 1;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_place_grid(&frame, &options, 2, &no_plane, SIDE, SIDE, SIDE, &grid));
    no_plane = plane;
    no_plane.offset_m = (double)NAN;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_place_grid(&frame, &options, 2, &no_plane, SIDE, SIDE, SIDE, &grid));
    GIVES(BEO_STATUS_OK, beo_place_grid(&frame, &options, 2, &plane, SIDE, SIDE, SIDE, &grid));
    /* About the block's front: 15 pixels broad at 0.9 m, which are two thirds of the grid. */
    MUST(fabs(grid.position_m[2] - 0.9) < 1e-6 && fabs(grid.voxel_size_m - 15 * 0.9 / 60 / (SIDE * 2.0 / 3)) < 1e-6);

    GIVES(BEO_STATUS_WRONG_SIZE, beo_carve(&frame, &options, 2, &plane, &grid, voxels, VOXELS - 1));
    GIVES(BEO_STATUS_WRONG_SIZE, beo_carve(&frame, &options, 2, &plane, &grid, voxels, SIZE_MAX));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_carve(&frame, &options, 2, &plane, &grid, NULL, VOXELS));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_carve(&frame, &options, 2, &plane, NULL, voxels, VOXELS));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_carve(NULL, &options, 2, &plane, &grid, voxels, VOXELS));
    beo_grid no_grid = grid;
    no_grid.orientation[0] = (double)NAN;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_carve(&frame, &options, 2, &plane, &no_grid, voxels, VOXELS));
    no_grid = grid;
    no_grid.position_m[1] = (double)INFINITY;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_carve(&frame, &options, 2, &plane, &no_grid, voxels, VOXELS));
    no_grid = grid;
    no_grid.voxel_size_m = 0;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_carve(&frame, &options, 2, &plane, &no_grid, voxels, VOXELS));
    no_grid = grid;
    no_grid.dims[0] = 300;
    GIVES(BEO_STATUS_BAD_DIMS, beo_carve(&frame, &options, 2, &plane, &no_grid, voxels, VOXELS));
    memset(voxels, 9, VOXELS);
    GIVES(BEO_STATUS_OK, beo_carve(&frame, &options, 2, NULL, &grid, voxels, VOXELS));
    size_t codes[3] = {0, 0, 0};
    for (int i = 0; i < VOXELS; i++) {
        MUST(voxels[i] == 0 || voxels[i] == 1 || voxels[i] == 255);
        codes[voxels[i] == 255 ? 2 : voxels[i]]++;
    }
    MUST(codes[0] > 100 && codes[1] > 50 && codes[2] > 100);

    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_observation_header_of_grid(NULL, NULL, &header));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_observation_header_of_grid(&grid, NULL, NULL));
    no_grid = grid;
    no_grid.position_m[0] = 1e300;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_observation_header_of_grid(&no_grid, NULL, &header));
    no_grid.position_m[0] = 0;
    no_grid.voxel_size_m = 1e-60;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_observation_header_of_grid(&no_grid, NULL, &header));
    no_grid = grid;
    no_grid.cut = 4;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_observation_header_of_grid(&no_grid, NULL, &header));
    no_grid.cut = 0;
    no_grid.share_edge = 1.5;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_observation_header_of_grid(&no_grid, NULL, &header));
    MUST(strstr(beo_last_error(), "share_edge") != NULL);
    options.known_side_m = 0.25;
    options.known_side_deviation_m = 0.5;
    grid.cut = BEO_CUT_BORDER | BEO_CUT_OCCLUDER;
    grid.share_support = 0.125;
    grid.surface_deviation_m = 0.25;
    GIVES(BEO_STATUS_OK, beo_observation_header_of_grid(&grid, &options, &header));
    MUST(header.unit == BEO_UNIT_METRES && header.cut == 3 && header.share_support == 0.125f && header.surface_deviation_m == 0.25f);
    MUST(header.known_side_deviation_m == 0.5f);
    MUST(header.view == BEO_VIEW_CAMERA && header.outside == BEO_OUTSIDE_UNKNOWN && header.scale_search == BEO_SCALE_SEARCH_SEARCH);
    MUST(header.pose_search == BEO_POSE_SEARCH_REST && header.dims[1] == SIDE && header.known_side_m == 0.25f);
    /* Up is towards the camera: it is above the grid. */
    MUST(fabs((double)header.sensor_position_m[2] - 0.9) < 1e-3 && header.position_m[2] == grid.position_m[2]);
    MUST(strcmp((const char *)header.frame_id, "camera") == 0);
}

static void opening(const char *instance, const char *nobody) {
    beo_observation_header header;
    GIVES(BEO_STATUS_BAD_DIMS, beo_observation_header_init(&header, SIDE, 7, SIDE));
    GIVES(BEO_STATUS_BAD_DIMS, beo_observation_header_init(&header, SIDE, SIDE, 257));
    GIVES(BEO_STATUS_OK, beo_observation_header_init(&header, SIDE, SIDE, SIDE));

    beo_subscriber *subscriber = (beo_subscriber *)&header;
    GIVES(BEO_STATUS_NOT_RUNNING, beo_subscriber_open(nobody, NULL, &subscriber));
    MUST(subscriber == NULL);
    MUST(strstr(beo_last_error(), nobody) != NULL);
    GIVES(BEO_STATUS_BAD_INSTANCE, beo_subscriber_open("not a name", NULL, &subscriber));
    GIVES(BEO_STATUS_BAD_INSTANCE, beo_subscriber_open("\xff", NULL, &subscriber));
    GIVES(BEO_STATUS_BAD_INSTANCE, beo_subscriber_open("", NULL, &subscriber));
    beo_subscriber_options options = BEO_SUBSCRIBER_OPTIONS_INIT;
    options.size = 4;
    GIVES(BEO_STATUS_WRONG_SIZE, beo_subscriber_open(instance, &options, &subscriber));
    options.size = 0;
    GIVES(BEO_STATUS_WRONG_SIZE, beo_subscriber_open(instance, &options, &subscriber));
    options.size = sizeof options;
    options.completion = 2;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_subscriber_open(instance, &options, &subscriber));
    options.completion = 0;
    options.reserved = 1;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_subscriber_open(instance, &options, &subscriber));

    beo_producer *producer;
    GIVES(BEO_STATUS_NOT_RUNNING, beo_producer_open(nobody, SIDE, SIDE, SIDE, NULL, &producer));
    GIVES(BEO_STATUS_BAD_DIMS, beo_producer_open(instance, SIDE, SIDE, 7, NULL, &producer));
    beo_producer_options producer_options = BEO_PRODUCER_OPTIONS_INIT;
    producer_options.size += 1;
    GIVES(BEO_STATUS_WRONG_SIZE, beo_producer_open(instance, SIDE, SIDE, SIDE, &producer_options, &producer));

    static uint8_t voxels[VOXELS];
    /* A wall in the middle: a grid without a filled voxel is refused as one in which nothing is seen. */
    memset(voxels + VOXELS / 2, 1, SIDE * SIDE);
    beo_percept percept;
    GIVES(BEO_STATUS_NOT_RUNNING, beo_perceive(nobody, &header, voxels, VOXELS, 30, &percept));
    GIVES(BEO_STATUS_WRONG_SIZE, beo_perceive(instance, &header, voxels, VOXELS - 1, 30000, &percept));
    GIVES(BEO_STATUS_OK, beo_perceive(instance, &header, voxels, VOXELS, 30000, &percept));
    MUST(percept.status == BEO_PERCEPT_STATUS_OK && percept.class_count == 10);
    voxels[77] = 9;
    GIVES(BEO_STATUS_OK, beo_perceive(instance, &header, voxels, VOXELS, 30000, &percept));
    MUST(percept.status == BEO_PERCEPT_STATUS_BAD_VOXEL && percept.detail == 77 && percept.class_index == BEO_NO_CLASS);
    MUST(strncmp((const char *)percept.explanation, "voxel 77 is 9", 13) == 0);
}

static void loans(beo_producer *producer, beo_subscriber *subscriber) {
    beo_loan *loan, *other;
    uint8_t *voxels;
    size_t count;
    uint64_t sequence = 0;
    beo_observation_header header;
    GIVES(BEO_STATUS_OK, beo_observation_header_init(&header, SIDE, SIDE, SIDE + 1));
    GIVES(BEO_STATUS_OK, beo_producer_loan(producer, &loan, &voxels, &count));
    MUST(count == VOXELS);
    memset(voxels, 0, count);
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_loan_commit(loan, &header, &sequence)); /* other dims */
    header.dims[2] = SIDE;
    header.abi_version = 7;
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_loan_commit(loan, &header, &sequence));
    header.abi_version = BEO_ABI_VERSION;
    GIVES(BEO_STATUS_OK, beo_producer_loan(producer, &other, &voxels, NULL));
    GIVES(BEO_STATUS_OK, beo_loan_abandon(other));
    GIVES(BEO_STATUS_BAD_HANDLE, beo_loan_abandon(other));
    GIVES(BEO_STATUS_BAD_HANDLE, beo_loan_commit(other, &header, &sequence));
    MUST(sequence == 0);
    GIVES(BEO_STATUS_OK, beo_loan_commit(loan, &header, &sequence)); /* still good after its errors */
    MUST(sequence == 1);
    GIVES(BEO_STATUS_BAD_HANDLE, beo_loan_commit(loan, &header, &sequence));
    GIVES(BEO_STATUS_BAD_HANDLE, beo_loan_abandon((beo_loan *)(void *)subscriber)); /* another kind */

    /* Memory ends at some number of loans; what was loaned is given back. */
    beo_loan *many[1000];
    size_t loaned = 0;
    beo_status status = BEO_STATUS_OK;
    while (loaned < 1000 && (status = beo_producer_loan(producer, &many[loaned], &voxels, NULL)) == BEO_STATUS_OK) {
        loaned++;
    }
    MUST(loaned >= 2 && status == BEO_STATUS_NO_FREE_CHUNK);
    while (loaned > 0) {
        loaned--;
        GIVES(BEO_STATUS_OK, beo_loan_abandon(many[loaned]));
    }
}

static void completions(beo_producer *producer, beo_subscriber *subscriber) {
    static uint8_t voxels[VOXELS];
    memset(voxels, 255, VOXELS);
    memset(voxels + VOXELS / 2, 1, SIDE * SIDE);
    beo_completion_view view;
    BEO_COMPLETION_VIEW_INIT(view);
    beo_completion *held[3];
    while (beo_subscriber_take_completion(subscriber, &held[0], &view) == BEO_STATUS_OK) {
        GIVES(BEO_STATUS_OK, beo_completion_release(held[0]));
    }
    for (int i = 0; i < 3; i++) {
        beo_percept percept;
        GIVES(BEO_STATUS_OK, beo_perceive_with(producer, subscriber, NULL, voxels, VOXELS, 30000, &percept));
        beo_status taken = beo_subscriber_take_completion(subscriber, &held[i], &view);
        /* What other producers were answered before comes with the first answer that is sent after the subscriber is there. */
        while (taken == BEO_STATUS_OK && view.header.producer_id != percept.producer_id) {
            GIVES(BEO_STATUS_OK, beo_completion_release(held[i]));
            taken = beo_subscriber_take_completion(subscriber, &held[i], &view);
        }
        MUST(taken == (i < 2 ? BEO_STATUS_OK : BEO_STATUS_TOO_MANY_HELD));
        MUST(i == 2 || (view.voxel_count == VOXELS && view.header.sequence == percept.sequence));
    }
    MUST(held[2] == NULL);
    GIVES(BEO_STATUS_OK, beo_completion_release(held[0]));
    GIVES(BEO_STATUS_BAD_HANDLE, beo_completion_release(held[0]));
    view.size = 0;
    GIVES(BEO_STATUS_WRONG_SIZE, beo_subscriber_take_completion(subscriber, &held[2], &view));
    BEO_COMPLETION_VIEW_INIT(view);
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_subscriber_take_completion(subscriber, NULL, &view));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_subscriber_take_completion(subscriber, &held[2], NULL));
    GIVES(BEO_STATUS_OK, beo_subscriber_take_completion(subscriber, &held[2], &view));
    GIVES(BEO_STATUS_EMPTY, beo_subscriber_take_completion(subscriber, &held[0], &view));
    GIVES(BEO_STATUS_OK, beo_completion_release(held[1]));
    /* held[2] outlives its subscriber: see main. */
    GIVES(BEO_STATUS_BAD_HANDLE, beo_subscriber_close((beo_subscriber *)(void *)held[2]));
    GIVES(BEO_STATUS_OK, beo_completion_release(held[2]));
}

enum { AWAITED = 99 };

static void *wait_without_end(void *subscriber) {
    beo_percept percept;
    for (;;) {
        const beo_status status = beo_subscriber_take_percept(subscriber, &percept);
        if (status == BEO_STATUS_OK && percept.sensor_stamp_ns == AWAITED) {
            return NULL;
        }
        if (status != BEO_STATUS_OK && status != BEO_STATUS_EMPTY && status != BEO_STATUS_BUSY) {
            return (void *)"an error of taking";
        }
        /* One wake-up can stand for several percepts: all are taken before waiting again. Busy while the main thread looks. */
        const beo_status waited = status == BEO_STATUS_EMPTY ? beo_subscriber_wait(subscriber, -1) : BEO_STATUS_OK;
        if (waited != BEO_STATUS_OK && waited != BEO_STATUS_BUSY) {
            return (void *)"an error of waiting";
        }
    }
}

/* From any thread, one at a time. */
static void threads(const char *instance, beo_producer *producer) {
    beo_subscriber *subscriber;
    GIVES(BEO_STATUS_OK, beo_subscriber_open(instance, NULL, &subscriber));
    pthread_t thread;
    MUST(pthread_create(&thread, NULL, wait_without_end, subscriber) == 0);
    while (beo_subscriber_wait(subscriber, 0) != BEO_STATUS_BUSY) {
        poll(NULL, 0, 5); /* until the other thread waits; valgrind runs one thread at a time, and must be given the time to change */
    }
    beo_observation_header header;
    GIVES(BEO_STATUS_OK, beo_observation_header_init(&header, SIDE, SIDE, SIDE));
    header.sensor_stamp_ns = AWAITED;
    beo_loan *loan;
    uint8_t *voxels;
    GIVES(BEO_STATUS_OK, beo_producer_loan(producer, &loan, &voxels, NULL));
    memset(voxels, 255, VOXELS);
    GIVES(BEO_STATUS_OK, beo_loan_commit(loan, &header, NULL));
    void *result;
    MUST(pthread_join(thread, &result) == 0 && result == NULL);
    GIVES(BEO_STATUS_OK, beo_subscriber_close(subscriber));
}

/* What the program was started with, whatever that is: a shell's background jobs ignore SIGINT, a sanitizer handles SIGSEGV. */
static const int signals[] = {SIGINT, SIGTERM, SIGPIPE, SIGSEGV, SIGBUS, SIGUSR1};
static struct sigaction at_start[sizeof signals / sizeof *signals];

static void waiting(beo_subscriber *subscriber, beo_producer *producer) {
    beo_percept percept;
    uint64_t id;
    GIVES(BEO_STATUS_OK, beo_producer_id(producer, &id));
    while (beo_subscriber_take_percept(subscriber, &percept) != BEO_STATUS_OK || percept.producer_id != id) {
        MUST(beo_subscriber_wait(subscriber, 50) >= 0); /* until the observation of `loans` has been answered */
    }
    while (beo_subscriber_wait(subscriber, 0) == BEO_STATUS_OK) {
    }
    GIVES(BEO_STATUS_TIMEOUT, beo_subscriber_wait(subscriber, 0));
    GIVES(BEO_STATUS_TIMEOUT, beo_subscriber_wait(subscriber, 30));
    GIVES(BEO_STATUS_EMPTY, beo_subscriber_take_percept(subscriber, &percept));
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_subscriber_take_percept(subscriber, NULL));

    /* The caller's signals are the caller's. */
    struct sigaction action, found;
    for (size_t i = 0; i < sizeof signals / sizeof *signals; i++) {
        MUST(sigaction(signals[i], NULL, &found) == 0);
        MUST(found.sa_handler == at_start[i].sa_handler);
    }
    memset(&action, 0, sizeof action);
    action.sa_handler = ignore_alarm;
    MUST(sigaction(SIGALRM, &action, NULL) == 0);
    /* Again and again: an alarm that comes before the wait, or while it looks after the daemon, does not end it. */
    const struct itimerval alarms = {{0, 200000}, {0, 200000}}, none = {{0, 0}, {0, 0}};
    MUST(setitimer(ITIMER_REAL, &alarms, NULL) == 0);
    GIVES(BEO_STATUS_INTERRUPTED, beo_subscriber_wait(subscriber, -1));
    MUST(setitimer(ITIMER_REAL, &none, NULL) == 0);

    /* A poll loop of the caller's. */
    struct pollfd entry = {-1, POLLIN, 0};
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_subscriber_file_descriptor(subscriber, NULL));
    GIVES(BEO_STATUS_OK, beo_subscriber_file_descriptor(subscriber, &entry.fd));
    beo_loan *loan;
    uint8_t *voxels;
    GIVES(BEO_STATUS_OK, beo_producer_loan(producer, &loan, &voxels, NULL));
    memset(voxels, 255, VOXELS);
    GIVES(BEO_STATUS_OK, beo_loan_commit(loan, NULL, NULL));
    beo_status status;
    do {
        MUST(poll(&entry, 1, 30000) == 1);
        MUST(beo_subscriber_wait(subscriber, 0) >= 0);
        status = beo_subscriber_take_percept(subscriber, &percept);
    } while (status == BEO_STATUS_EMPTY);
    MUST(status == BEO_STATUS_OK);

    beo_daemon_status daemon;
    uint64_t age;
    while (beo_subscriber_status(subscriber, &daemon, &age) == BEO_STATUS_EMPTY) {
        beo_subscriber_wait(subscriber, 50);
    }
    MUST(daemon.class_count == 10 && daemon.dims[0] == SIDE && daemon.model_id == percept.model_id && age > 0);
    GIVES(BEO_STATUS_INVALID_ARGUMENT, beo_subscriber_status(subscriber, NULL, &age));
}

int main(int argc, char **argv) {
    if (argc != 3) {
        fprintf(stderr, "misuse INSTANCE NOBODY\n");
        return 2;
    }
    for (size_t i = 0; i < sizeof signals / sizeof *signals; i++) {
        MUST(sigaction(signals[i], NULL, &at_start[i]) == 0);
    }
    texts();
    nulls();
    from_depth_to_a_grid();
    opening(argv[1], argv[2]);

    beo_subscriber_options options = BEO_SUBSCRIBER_OPTIONS_INIT;
    options.completion = 1;
    beo_subscriber *subscriber;
    beo_producer *producer;
    GIVES(BEO_STATUS_OK, beo_subscriber_open(argv[1], &options, &subscriber));
    GIVES(BEO_STATUS_OK, beo_producer_open(argv[1], SIDE, SIDE, SIDE, NULL, &producer));
    loans(producer, subscriber);
    waiting(subscriber, producer);
    completions(producer, subscriber);
    threads(argv[1], producer);

    /* What was taken or loaned outlives its handle. */
    static uint8_t seen[VOXELS];
    memset(seen, 255, VOXELS);
    memset(seen + VOXELS / 2, 1, SIDE * SIDE);
    beo_percept percept;
    beo_completion_view view;
    BEO_COMPLETION_VIEW_INIT(view);
    beo_completion *completion;
    beo_loan *loan;
    uint8_t *voxels;
    while (beo_subscriber_take_completion(subscriber, &completion, &view) == BEO_STATUS_OK) {
        GIVES(BEO_STATUS_OK, beo_completion_release(completion));
    }
    GIVES(BEO_STATUS_OK, beo_perceive_with(producer, subscriber, NULL, seen, VOXELS, 30000, &percept));
    GIVES(BEO_STATUS_OK, beo_subscriber_take_completion(subscriber, &completion, &view));
    GIVES(BEO_STATUS_OK, beo_producer_loan(producer, &loan, &voxels, NULL));
    GIVES(BEO_STATUS_OK, beo_subscriber_close(subscriber));
    GIVES(BEO_STATUS_OK, beo_producer_close(producer));
    unsigned long sum = 0;
    for (size_t i = 0; i < view.voxel_count; i++) {
        sum += view.occupancy[i];
    }
    MUST(sum > 0);
    memset(voxels, 0, VOXELS);
    GIVES(BEO_STATUS_NOT_RUNNING, beo_loan_commit(loan, NULL, NULL));
    GIVES(BEO_STATUS_BAD_HANDLE, beo_loan_abandon(loan));
    GIVES(BEO_STATUS_OK, beo_completion_release(completion));
    GIVES(BEO_STATUS_BAD_HANDLE, beo_subscriber_close(subscriber));
    GIVES(BEO_STATUS_BAD_HANDLE, beo_subscriber_wait(subscriber, -1));
    GIVES(BEO_STATUS_BAD_HANDLE, beo_subscriber_take_percept(subscriber, &percept));
    GIVES(BEO_STATUS_BAD_HANDLE, beo_producer_close(producer));
    GIVES(BEO_STATUS_BAD_HANDLE, beo_producer_loan(producer, &loan, &voxels, NULL));
    printf("the law holds\n");
    return 0;
}
