/* A robot's process: prints class, pose, box and latency of what the daemon perceives.
 *
 *     listen [INSTANCE] [COUNT]
 *
 * INSTANCE: of the daemon (default); COUNT: percepts to print (without end).
 */

#include <beo.h>
#include <limits.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

/* The names of the classes come with the daemon's status; the first one is there within about a second. */
static const char *class_name(const beo_percept *percept, beo_subscriber *subscriber) {
    static beo_daemon_status status;
    while (beo_subscriber_status(subscriber, &status, NULL) == BEO_STATUS_EMPTY) {
        beo_subscriber_wait(subscriber, 50);
    }
    return status.model_id == percept->model_id ? (const char *)status.class_names[percept->class_index] : "?";
}

/* Where the object's box is and how big, if the daemon was asked to find out: in the sensor's frame, sides along the object's axes. */
static void print_box(const beo_percept *percept) {
    const double *p = percept->object_position_m;
    const float *dp = percept->object_position_deviation_m, *e = percept->object_extent_m, *de = percept->object_extent_deviation_m;
    if (percept->status == BEO_PERCEPT_STATUS_OK && e[0] > 0) {
        printf("box at (%.3f, %.3f, %.3f) +- (%.3f, %.3f, %.3f) m, sides %.3f x %.3f x %.3f +- (%.3f, %.3f, %.3f) m, ", p[0], p[1], p[2],
               (double)dp[0], (double)dp[1], (double)dp[2], (double)e[0], (double)e[1], (double)e[2], (double)de[0], (double)de[1],
               (double)de[2]);
    }
}

static void print(const beo_percept *percept, beo_subscriber *subscriber) {
    const unsigned long long number = percept->sequence;
    const double latency_us = (double)(beo_monotonic_ns() - percept->capture_ns) / 1e3;
    if (percept->status != BEO_PERCEPT_STATUS_OK || percept->class_index >= BEO_MAX_CLASSES) {
        printf("#%llu refused: %.128s\n", number, (const char *)percept->explanation);
        return;
    }
    printf("#%llu %.32s %.1f %%, ", number, class_name(percept, subscriber), 100.0 * (double)percept->posterior[percept->class_index]);
    if (percept->hypothesis_count > 0) {
        const float *q = percept->hypotheses[0].rotation_object_to_grid;
        printf("rotation (%.3f, %.3f, %.3f, %.3f), spread %.1f deg, ", (double)q[0], (double)q[1], (double)q[2], (double)q[3],
               (double)percept->rotation_spread_rad * 57.29577951308232);
    }
    print_box(percept);
    printf("%.0f us\n", latency_us);
}

int main(int argc, char **argv) {
    const char *instance = argc > 1 ? argv[1] : NULL;
    const unsigned long count = argc > 2 ? strtoul(argv[2], NULL, 10) : ULONG_MAX;

    beo_subscriber_options options = BEO_SUBSCRIBER_OPTIONS_INIT;
    options.wait_ms = 10000;
    beo_subscriber *subscriber;
    if (beo_subscriber_open(instance, &options, &subscriber) != BEO_STATUS_OK) {
        fprintf(stderr, "listen: %s\n", beo_last_error());
        return 1;
    }
    fprintf(stderr, "listening\n");

    unsigned long heard = 0;
    uint64_t told = 0;
    beo_status status = BEO_STATUS_OK;
    while (heard < count && status >= 0) {
        /* A timeout, or a daemon that is away, is no reason to end: waiting also connects to the next daemon. */
        status = beo_subscriber_wait(subscriber, 500);
        if (status == BEO_STATUS_NOT_RUNNING) {
            fprintf(stderr, "waiting for the daemon\n");
        }
        beo_percept percept;
        while (heard < count && status >= 0 && (status = beo_subscriber_take_percept(subscriber, &percept)) == BEO_STATUS_OK) {
            print(&percept, subscriber);
            fflush(stdout);
            heard++;
        }
        /* More came than are kept for a reader. */
        uint64_t missed = 0;
        if (beo_subscriber_missed(subscriber, &missed) == BEO_STATUS_OK && missed > told) {
            fprintf(stderr, "missed %llu percepts\n", (unsigned long long)(missed - told));
            told = missed;
        }
    }
    if (status < 0) {
        fprintf(stderr, "listen: %s\n", beo_last_error());
    }
    beo_subscriber_close(subscriber);
    return status < 0;
}
