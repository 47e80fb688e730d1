/* A camera's process: writes a partial grid in place into shared memory, thirty times a second.
 *
 *     camera [INSTANCE] [COUNT] [SIDE]
 *
 * INSTANCE: of the daemon (default); COUNT: grids to send (90); SIDE: voxels along each axis, as the model has (30). The object is a
 * made-up table, seen from above: known voxels are 0 (empty) or 1 (filled), hidden ones 255 (unknown).
 */

#define _POSIX_C_SOURCE 200809L
#include <beo.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static const long PERIOD_NS = 33333333;

static void write_table_top(uint8_t *voxels, uint32_t side) {
    for (uint32_t x = 0; x < side; x++) {
        for (uint32_t y = 0; y < side; y++) {
            const int under_the_top = x >= side / 10 && x < side - side / 10 && y >= side / 4 && y < side - side / 4;
            const uint32_t top = side * 7 / 10;
            for (uint32_t z = 0; z < side; z++) {
                voxels[(x * side + y) * side + z] = !under_the_top || z > top ? 0 : z == top ? 1 : 255;
            }
        }
    }
}

static void wait_for(struct timespec *next) {
    next->tv_nsec += PERIOD_NS;
    if (next->tv_nsec >= 1000000000) {
        next->tv_nsec -= 1000000000;
        next->tv_sec += 1;
    }
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, next, NULL);
}

int main(int argc, char **argv) {
    const char *instance = argc > 1 ? argv[1] : NULL;
    const unsigned long count = argc > 2 ? strtoul(argv[2], NULL, 10) : 90;
    const uint32_t side = argc > 3 ? (uint32_t)strtoul(argv[3], NULL, 10) : 30;

    /* What the grid is and where it lies. The grid stands 0.8 m before the sensor, turned by a quarter about z. */
    beo_observation_header header;
    if (beo_observation_header_init(&header, side, side, side) != BEO_STATUS_OK) {
        fprintf(stderr, "camera: %s\n", beo_last_error());
        return 1;
    }
    header.view = BEO_VIEW_TOP_DOWN;
    header.voxel_size_m = 1.2f / (float)side;
    header.position_m[0] = 0.8;
    header.position_m[2] = 0.4;
    header.orientation[2] = header.orientation[3] = 0.70710678118654752;
    memcpy(header.frame_id, "camera", 6);

    beo_producer_options options = BEO_PRODUCER_OPTIONS_INIT;
    options.wait_ms = 10000;
    beo_producer *producer;
    if (beo_producer_open(instance, side, side, side, &options, &producer) != BEO_STATUS_OK) {
        fprintf(stderr, "camera: %s\n", beo_last_error());
        return 1;
    }

    struct timespec next;
    clock_gettime(CLOCK_MONOTONIC, &next);
    beo_status status = BEO_STATUS_OK;
    for (unsigned long sent = 0; sent < count && status >= 0; wait_for(&next)) {
        beo_loan *loan;
        uint8_t *voxels;
        status = beo_producer_loan(producer, &loan, &voxels, NULL);
        if (status != BEO_STATUS_OK) {
            continue; /* Above 0, the daemon is away, say: this grid is left out. Below 0 the loop ends. */
        }
        write_table_top(voxels, side);
        uint64_t sequence;
        status = beo_loan_commit(loan, &header, &sequence);
        if (status == BEO_STATUS_OK) {
            printf("sent observation %llu\n", (unsigned long long)sequence);
            fflush(stdout);
            sent++;
        }
    }
    if (status < 0) {
        fprintf(stderr, "camera: %s\n", beo_last_error());
    }
    beo_producer_close(producer);
    return status < 0;
}
