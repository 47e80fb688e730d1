// A robot's process: prints class, pose, box and latency of what the daemon perceives.
//
//     listen [INSTANCE] [COUNT]
//
// INSTANCE: of the daemon (default); COUNT: percepts to print (without end). Written without exceptions: see grasp.cpp for them.

#include <beo.hpp>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <string>

namespace {

// The names of the classes come with the daemon's status; the first one is there within about a second.
std::string class_name(const beo::Percept &percept, beo::Subscriber &subscriber) {
    auto status = subscriber.status();
    for (; !status && status.is_retryable(); status = subscriber.status()) {
        static_cast<void>(subscriber.wait(std::chrono::milliseconds(50)));
    }
    return status && status->model_id == percept.model_id ? std::string(beo::class_name(*status, percept.class_index)) : "?";
}

// Where the object's box is and how big, if the daemon was asked to find out: in the sensor's frame, sides along the object's axes.
void print_box(const beo::Percept &percept) {
    const double *p = percept.object_position_m;
    const float *dp = percept.object_position_deviation_m, *e = percept.object_extent_m, *de = percept.object_extent_deviation_m;
    if (beo::has_box(percept)) {
        std::printf("box at (%.3f, %.3f, %.3f) +- (%.3f, %.3f, %.3f) m, sides %.3f x %.3f x %.3f +- (%.3f, %.3f, %.3f) m, ", p[0],
                    p[1], p[2], static_cast<double>(dp[0]), static_cast<double>(dp[1]), static_cast<double>(dp[2]),
                    static_cast<double>(e[0]), static_cast<double>(e[1]), static_cast<double>(e[2]), static_cast<double>(de[0]),
                    static_cast<double>(de[1]), static_cast<double>(de[2]));
    }
}

void print(const beo::Percept &percept, beo::Subscriber &subscriber) {
    const auto number = static_cast<unsigned long long>(percept.sequence);
    const double latency_us = static_cast<double>(beo::monotonic_ns() - percept.capture_ns) / 1e3;
    if (percept.status != BEO_PERCEPT_STATUS_OK || percept.class_index >= BEO_MAX_CLASSES) {
        std::printf("#%llu refused: %s\n", number, std::string(beo::text(percept.explanation)).c_str());
        return;
    }
    std::printf("#%llu %s %.1f %%, ", number, class_name(percept, subscriber).c_str(),
                100.0 * static_cast<double>(percept.posterior[percept.class_index]));
    for (const beo::Hypothesis &best : beo::hypotheses(percept)) {
        const float *q = best.rotation_object_to_grid;
        std::printf("rotation (%.3f, %.3f, %.3f, %.3f), spread %.1f deg, ", static_cast<double>(q[0]), static_cast<double>(q[1]),
                    static_cast<double>(q[2]), static_cast<double>(q[3]),
                    static_cast<double>(percept.rotation_spread_rad) * 57.29577951308232);
        break; // Most probable first.
    }
    print_box(percept);
    std::printf("%.0f us\n", latency_us);
}

} // namespace

int main(int argc, char **argv) {
    const std::string instance = argc > 1 ? argv[1] : "default";
    const unsigned long count = argc > 2 ? std::strtoul(argv[2], nullptr, 10) : std::numeric_limits<unsigned long>::max();

    beo::Subscriber::Options options;
    options.wait = std::chrono::seconds(10);
    auto subscriber = beo::Subscriber::open(instance, options);
    if (!subscriber) {
        std::fprintf(stderr, "listen: %s\n", subscriber.error().c_str());
        return 1;
    }
    std::fprintf(stderr, "listening\n");

    std::uint64_t told = 0;
    for (unsigned long heard = 0; heard < count;) {
        // A timeout, or a daemon that is away, is no reason to end: waiting also connects to the next daemon.
        const auto waited = subscriber->wait(std::chrono::milliseconds(500));
        if (!waited && !waited.is_retryable()) {
            std::fprintf(stderr, "listen: %s\n", waited.error().c_str());
            return 1;
        }
        if (waited.status() == BEO_STATUS_NOT_RUNNING) {
            std::fprintf(stderr, "waiting for the daemon\n");
        }
        while (heard < count) {
            const auto percept = subscriber->take_percept();
            if (!percept) {
                break;
            }
            print(*percept, *subscriber);
            std::fflush(stdout);
            heard++;
        }
        // More came than are kept for a reader.
        if (subscriber->missed() > told) {
            std::fprintf(stderr, "missed %llu percepts\n", static_cast<unsigned long long>(subscriber->missed() - told));
            told = subscriber->missed();
        }
    }
    return 0;
}
