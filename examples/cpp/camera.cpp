// A camera's process: writes a partial grid in place into shared memory, thirty times a second.
//
//     camera [INSTANCE] [COUNT] [SIDE]
//
// INSTANCE: of the daemon (default); COUNT: grids to send (90); SIDE: voxels along each axis, as the model has (30). The object is a
// made-up table, seen from above: known voxels are 0 (empty) or 1 (filled), hidden ones 255 (unknown).

#include <beo.hpp>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <string>
#include <thread>

namespace {

void write_table_top(beo::Span<std::uint8_t> voxels, std::uint32_t side) {
    const std::uint32_t top = side * 7 / 10;
    for (std::uint32_t x = 0; x < side; x++) {
        for (std::uint32_t y = 0; y < side; y++) {
            const bool under_the_top = x >= side / 10 && x < side - side / 10 && y >= side / 4 && y < side - side / 4;
            for (std::uint32_t z = 0; z < side; z++) {
                voxels[(x * side + y) * side + z] = !under_the_top || z > top ? 0 : z == top ? 1 : 255;
            }
        }
    }
}

void run(const std::string &instance, unsigned long count, std::uint32_t side) {
    // What the grid is and where it lies. The grid stands 0.8 m before the sensor, turned by a quarter about z.
    beo::ObservationHeader header = beo::observation_header({side, side, side}).value();
    header.view = BEO_VIEW_TOP_DOWN;
    header.voxel_size_m = 1.2f / static_cast<float>(side);
    header.position_m[0] = 0.8;
    header.position_m[2] = 0.4;
    header.orientation[2] = header.orientation[3] = 0.70710678118654752;
    beo::set_text(header.frame_id, "camera");

    beo::Producer producer = beo::Producer::open(instance, {side, side, side}, std::chrono::seconds(10)).value();
    auto next = std::chrono::steady_clock::now();
    for (unsigned long sent = 0; sent < count;) {
        if (beo::Result<beo::Loan> loan = producer.loan()) {
            write_table_top(loan->voxels(), side);
            const std::uint64_t sequence = std::move(*loan).commit(header).value();
            std::printf("sent observation %llu\n", static_cast<unsigned long long>(sequence));
            std::fflush(stdout);
            sent++;
        } else if (!loan.is_retryable()) {
            static_cast<void>(loan.value()); // Throws. What can be tried again, the daemon is away, say, leaves this grid out.
        }
        next += std::chrono::microseconds(33333);
        std::this_thread::sleep_until(next);
    }
}

} // namespace

int main(int argc, char **argv) {
    try {
        run(argc > 1 ? argv[1] : "default", argc > 2 ? std::stoul(argv[2]) : 90,
            argc > 3 ? static_cast<std::uint32_t>(std::stoul(argv[3])) : 30);
    } catch (const std::exception &error) {
        std::fprintf(stderr, "camera: %s\n", error.what());
        return 1;
    }
    return 0;
}
