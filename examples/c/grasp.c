/* A gripper's process: from every completion, how large the object is and where its centroid lies in the sensor's frame.
 *
 *     grasp [INSTANCE] [COUNT]
 *
 * INSTANCE: of the daemon (default); COUNT: completions to print (without end).
 *
 * Centroid: the mean of the voxels' centres, weighted with their probability of being filled; its uncertainty is what it would move if all
 * voxels' deviations went together, the worst case. Extent along each axis of the frame: of the voxels whose probability is at least one
 * half, between brackets if each had one deviation less, and one more. From every percept of a grid whose size and place were to be
 * found, as a depth camera's are: the box that the daemon found.
 */

#include <beo.h>
#include <limits.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

/* Lengths in metres along the axes of the sensor's frame. */
struct grasp {
    double centroid[3];
    double deviation[3];
    double extent[3];
    double least[3];
    double most[3];
};

static void rotation_matrix(const double q[4], double r[3][3]) {
    const double x = q[0], y = q[1], z = q[2], w = q[3];
    const double rows[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)},
                               {2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)},
                               {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)}};
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            r[i][j] = rows[i][j];
        }
    }
}

/* Centre of voxel `index` in the sensor's frame. */
static void centre(const beo_completion_header *header, double r[3][3], size_t index, double point[3]) {
    const uint32_t *n = header->dims;
    const double ijk[3] = {(double)(index / ((size_t)n[1] * n[2])), (double)(index / n[2] % n[1]), (double)(index % n[2])};
    for (int axis = 0; axis < 3; axis++) {
        point[axis] = header->position_m[axis];
        for (int j = 0; j < 3; j++) {
            point[axis] += r[axis][j] * (ijk[j] + 0.5 - n[j] / 2.0) * (double)header->voxel_size_m;
        }
    }
}

/* A range that grows with every voxel. */
static void include(double low[3], double high[3], const double point[3], const double half[3]) {
    for (int axis = 0; axis < 3; axis++) {
        low[axis] = fmin(low[axis], point[axis] - half[axis]);
        high[axis] = fmax(high[axis], point[axis] + half[axis]);
    }
}

/* 0 if nothing is there to be grasped. */
static int estimate(const beo_completion_view *view, struct grasp *grasp) {
    double r[3][3], half[3], point[3], mass = 0;
    double low[3][3], high[3][3];
    rotation_matrix(view->header.orientation, r);
    for (int axis = 0; axis < 3; axis++) {
        half[axis] = 0.5 * (double)view->header.voxel_size_m * (fabs(r[axis][0]) + fabs(r[axis][1]) + fabs(r[axis][2]));
        grasp->centroid[axis] = grasp->deviation[axis] = 0;
        for (int which = 0; which < 3; which++) {
            low[which][axis] = INFINITY;
            high[which][axis] = -INFINITY;
        }
    }
    for (size_t index = 0; index < view->voxel_count; index++) {
        const int p = view->occupancy[index], s = view->deviation[index];
        centre(&view->header, r, index, point);
        mass += p;
        for (int axis = 0; axis < 3; axis++) {
            grasp->centroid[axis] += p * point[axis];
        }
        for (int which = 0; which < 3; which++) {
            if (p + (which - 1) * s >= 128) {
                include(low[which], high[which], point, half);
            }
        }
    }
    if (mass == 0 || high[1][0] < low[1][0]) {
        return 0;
    }
    for (int axis = 0; axis < 3; axis++) {
        grasp->centroid[axis] /= mass;
        grasp->least[axis] = fmax(high[0][axis] - low[0][axis], 0);
        grasp->extent[axis] = high[1][axis] - low[1][axis];
        grasp->most[axis] = high[2][axis] - low[2][axis];
    }
    for (size_t index = 0; index < view->voxel_count; index++) {
        if (view->deviation[index] > 0) {
            centre(&view->header, r, index, point);
            for (int axis = 0; axis < 3; axis++) {
                grasp->deviation[axis] += view->deviation[index] * fabs(point[axis] - grasp->centroid[axis]) / mass;
            }
        }
    }
    return 1;
}

static void print(const beo_completion_view *view) {
    struct grasp g;
    const unsigned long long number = view->header.sequence;
    if (view->header.frame != BEO_COMPLETION_FRAME_GRID) {
        printf("#%llu is completed in the object's frame: ask for the grid's\n", number);
    } else if (!estimate(view, &g)) {
        printf("#%llu nothing to grasp\n", number);
    } else {
        printf("#%llu in %.32s: centroid (%.3f, %.3f, %.3f) +- (%.3f, %.3f, %.3f) m, "
               "extent %.3f [%.3f, %.3f] x %.3f [%.3f, %.3f] x %.3f [%.3f, %.3f] m\n",
               number, (const char *)view->header.frame_id, g.centroid[0], g.centroid[1], g.centroid[2], g.deviation[0], g.deviation[1],
               g.deviation[2], g.extent[0], g.least[0], g.most[0], g.extent[1], g.least[1], g.most[1], g.extent[2], g.least[2], g.most[2]);
    }
}

/* Where the object's box is and how big, if the daemon was asked to find out: in the sensor's frame, sides along the object's axes. */
static void print_box(const beo_percept *percept) {
    const double *p = percept->object_position_m;
    const float *dp = percept->object_position_deviation_m, *e = percept->object_extent_m, *de = percept->object_extent_deviation_m;
    if (percept->status == BEO_PERCEPT_STATUS_OK && e[0] > 0) {
        printf("#%llu box at (%.3f, %.3f, %.3f) +- (%.3f, %.3f, %.3f) m, sides %.3f x %.3f x %.3f +- (%.3f, %.3f, %.3f) m\n", (unsigned long long)percept->sequence, p[0], p[1], p[2],
               (double)dp[0], (double)dp[1], (double)dp[2], (double)e[0], (double)e[1], (double)e[2], (double)de[0], (double)de[1],
               (double)de[2]);
    }
}

int main(int argc, char **argv) {
    const char *instance = argc > 1 ? argv[1] : NULL;
    const unsigned long count = argc > 2 ? strtoul(argv[2], NULL, 10) : ULONG_MAX;

    beo_subscriber_options options = BEO_SUBSCRIBER_OPTIONS_INIT;
    options.completion = 1;
    options.wait_ms = 10000;
    beo_subscriber *subscriber;
    if (beo_subscriber_open(instance, &options, &subscriber) != BEO_STATUS_OK) {
        fprintf(stderr, "grasp: %s\n", beo_last_error());
        return 1;
    }
    fprintf(stderr, "listening\n");

    unsigned long done = 0;
    beo_status status = BEO_STATUS_OK;
    while (done < count && status >= 0) {
        status = beo_subscriber_wait(subscriber, 500);
        beo_completion *completion;
        beo_completion_view view;
        BEO_COMPLETION_VIEW_INIT(view);
        while (done < count && status >= 0 &&
               (status = beo_subscriber_take_completion(subscriber, &completion, &view)) == BEO_STATUS_OK) {
            print(&view);
            fflush(stdout);
            beo_completion_release(completion); /* The arrays of the view end here. */
            done++;
        }
        beo_percept percept;
        while (status >= 0 && (status = beo_subscriber_take_percept(subscriber, &percept)) == BEO_STATUS_OK) {
            print_box(&percept);
            fflush(stdout);
        }
    }
    if (status < 0) {
        fprintf(stderr, "grasp: %s\n", beo_last_error());
    }
    beo_subscriber_close(subscriber);
    return status < 0;
}
