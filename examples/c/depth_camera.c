/* A depth camera's driver: frame in, table, where the object's grid lies, carving, commit; thirty times a second.
 *
 *     depth_camera [INSTANCE] [COUNT] [SIDE] [SEGMENTATION]
 *
 * INSTANCE: of the daemon (default); COUNT: grids to send (90); SIDE: voxels along each axis, as the model has (30).
 * SEGMENTATION: mask, the camera comes with labels (default); table, it does not, and what stands on the table is the object.
 *
 * For your own camera, replace `camera` and `next_frame`: the made-up one looks down on a box that turns on a table.
 */

#define _POSIX_C_SOURCE 200809L
#include <beo.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum {
    WIDTH = 320,
    HEIGHT = 240,
    PIXELS = WIDTH * HEIGHT,
    OBJECT = 1, /* The object's label in the mask. For several objects, do the second half of `send` for each label. */
};

/* From your camera's calibration: width, height, fx, fy, cx, cy, distortion (k1, k2, p1, p2, k3). */
static const beo_intrinsics camera = {WIDTH, HEIGHT, 277.0, 277.0, 160.3, 119.1, {0, 0, 0, 0, 0}};

static uint16_t depth_mm[PIXELS]; /* 0: no reading */
static uint16_t labels[PIXELS];   /* from your segmentation; 0: no object */
static int has_labels = 1;        /* 0: there is no segmentation */

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Waits for the next frame of the camera, and returns when it was taken (CLOCK_MONOTONIC). REPLACE THIS: here, a box of 7 × 10 × 14 cm on
 * a table is made up. */
static uint64_t next_frame(void) {
    static struct timespec due;
    static int count;
    if (count == 0) {
        clock_gettime(CLOCK_MONOTONIC, &due);
    }
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
    due.tv_nsec += 33333333;
    due.tv_sec += due.tv_nsec / 1000000000;
    due.tv_nsec %= 1000000000;

    /* The camera is 0.4 m above the table and looks down by 0.55 rad; the box stands 0.55 m before it. */
    const double pitch = 0.55, turned = 0.3 + 0.02 * count++;
    const double up[3] = {0, -cos(pitch), -sin(pitch)}, ahead[3] = {0, -sin(pitch), cos(pitch)};
    const double axes[3][3] = {{cos(turned), ahead[1] * sin(turned), ahead[2] * sin(turned)},
                               {-sin(turned), ahead[1] * cos(turned), ahead[2] * cos(turned)},
                               {up[0], up[1], up[2]}};
    const double half[3] = {0.035, 0.05, 0.07};
    const double centre[3] = {0, 0.55 * ahead[1] - 0.33 * up[1], 0.55 * ahead[2] - 0.33 * up[2]};
    const uint64_t captured_ns = beo_monotonic_ns();
    for (int i = 0; i < PIXELS; i++) {
        const int u = i % WIDTH, v = i / WIDTH;
        const double ray[3] = {(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1};
        double enter = 0, leave = 10;
        for (int axis = 0; axis < 3; axis++) {
            const double along = dot(axes[axis], ray), middle = dot(axes[axis], centre) / along, width = half[axis] / fabs(along);
            enter = fmax(enter, middle - width);
            leave = fmin(leave, middle + width);
        }
        const int is_box = enter < leave;
        const double table = -0.4 / dot(up, ray), depth = is_box ? enter : table > 0 && table < 5 ? table : 0;
        depth_mm[i] = (uint16_t)floor(1000 * depth + 0.5);
        labels[i] = has_labels && is_box ? OBJECT : 0;
    }
    return captured_ns;
}

/* One frame's observation. A status above 0: not this frame, but perhaps the next. */
static beo_status send(beo_producer *producer, uint32_t side, uint64_t *sequence) {
    /* The sensor's noise, what is up, if you know it, and the object's size, if you know it, go in here. */
    const beo_camera_options options = BEO_CAMERA_OPTIONS_INIT;
    static float depth_m[PIXELS];
    static beo_plane table;
    static int has_table;

    const uint64_t captured_ns = next_frame();
    beo_status status = beo_depth_from_u16(depth_mm, PIXELS, 0.001, depth_m);
    if (status != BEO_STATUS_OK) {
        return status;
    }
    beo_depth_frame frame;
    BEO_DEPTH_FRAME_INIT(frame);
    frame.intrinsics = camera;
    frame.depth_m = depth_m;
    frame.labels = labels;
    frame.depth_count = frame.label_count = PIXELS;
    uint32_t objects;
    if (!has_labels && (status = beo_segment_table(&frame, &options, labels, PIXELS, &objects)) != BEO_STATUS_OK) {
        return status;
    }
    status = beo_fit_support(&frame, &options, &table);
    has_table = has_table || status == BEO_STATUS_OK; /* Where it is hidden, it is where it was. */
    if (!has_table) {
        return status;
    }

    beo_grid grid;
    beo_observation_header header;
    if ((status = beo_place_grid(&frame, &options, OBJECT, &table, side, side, side, &grid)) != BEO_STATUS_OK ||
        (status = beo_observation_header_of_grid(&grid, &options, &header)) != BEO_STATUS_OK) {
        return status;
    }
    header.object_id = OBJECT;
    header.capture_ns = captured_ns;
    beo_loan *loan;
    uint8_t *voxels;
    size_t count;
    if ((status = beo_producer_loan(producer, &loan, &voxels, &count)) != BEO_STATUS_OK) {
        return status;
    }
    if ((status = beo_carve(&frame, &options, OBJECT, &table, &grid, voxels, count)) != BEO_STATUS_OK) {
        beo_loan_abandon(loan);
        return status;
    }
    return beo_loan_commit(loan, &header, sequence);
}

int main(int argc, char **argv) {
    const char *instance = argc > 1 ? argv[1] : NULL;
    const unsigned long count = argc > 2 ? strtoul(argv[2], NULL, 10) : 90;
    const uint32_t side = argc > 3 ? (uint32_t)strtoul(argv[3], NULL, 10) : 30;

    const char *segmentation = argc > 4 ? argv[4] : "mask";
    has_labels = strcmp(segmentation, "table") != 0;
    if (has_labels && strcmp(segmentation, "mask") != 0) {
        fprintf(stderr, "depth_camera: SEGMENTATION is mask or table, not %s\n", segmentation);
        return 1;
    }

    beo_producer_options options = BEO_PRODUCER_OPTIONS_INIT;
    options.wait_ms = 10000;
    beo_producer *producer;
    if (beo_producer_open(instance, side, side, side, &options, &producer) != BEO_STATUS_OK) {
        fprintf(stderr, "depth_camera: %s\n", beo_last_error());
        return 1;
    }
    beo_status status = BEO_STATUS_OK;
    for (unsigned long sent = 0; sent < count && status >= 0;) {
        uint64_t sequence;
        status = send(producer, side, &sequence);
        if (status == BEO_STATUS_OK) {
            printf("sent observation %llu\n", (unsigned long long)sequence);
            fflush(stdout);
            sent++;
        }
    }
    if (status < 0) {
        fprintf(stderr, "depth_camera: %s\n", beo_last_error());
    }
    beo_producer_close(producer);
    return status < 0;
}
