// A depth camera's driver: frame in, table, where the object's grid lies, carving, commit; thirty times a second.
//
//     depth_camera [INSTANCE] [COUNT] [SIDE] [SEGMENTATION]
//
// INSTANCE: of the daemon (default); COUNT: grids to send (90); SIDE: voxels along each axis, as the model has (30).
// SEGMENTATION: mask, the camera comes with labels (default); table, it does not, and what stands on the table is the object.
//
// For your own camera, replace `intrinsics` and `next_frame`: the made-up one looks down on a box that turns on a table.

#include <beo.hpp>

#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace {

// From your camera's calibration: width, height, fx, fy, cx, cy, distortion (k1, k2, p1, p2, k3).
const beo::Intrinsics intrinsics = {320, 240, 277.0, 277.0, 160.3, 119.1, {0, 0, 0, 0, 0}};

// The label of the object in the mask. For several objects, do the second half of `run`'s loop for each label.
constexpr std::uint16_t OBJECT = 1;

struct Frame {
    std::vector<std::uint16_t> depth_mm; // 0: no reading
    std::vector<std::uint16_t> labels;   // from your segmentation; 0: no object; empty: there is none
    std::uint64_t captured_ns = 0;       // CLOCK_MONOTONIC
};

// Waits for the next frame of the camera. REPLACE THIS: here, a box of 7 × 10 × 14 cm on a table is made up.
Frame next_frame(bool has_labels) {
    using Vector = std::array<double, 3>;
    const auto dot = [](const Vector &a, const Vector &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; };
    static auto due = std::chrono::steady_clock::now();
    static int count = 0;
    std::this_thread::sleep_until(due);
    due += std::chrono::microseconds(33333);

    // The camera is 0.4 m above the table and looks down by 0.55 rad; the box stands 0.55 m before it.
    const double pitch = 0.55, turned = 0.3 + 0.02 * count++;
    const Vector up = {0, -std::cos(pitch), -std::sin(pitch)}, ahead = {0, -std::sin(pitch), std::cos(pitch)};
    const Vector axes[3] = {{std::cos(turned), ahead[1] * std::sin(turned), ahead[2] * std::sin(turned)},
                            {-std::sin(turned), ahead[1] * std::cos(turned), ahead[2] * std::cos(turned)},
                            up};
    const Vector half = {0.035, 0.05, 0.07};
    const Vector centre = {0, 0.55 * ahead[1] - 0.33 * up[1], 0.55 * ahead[2] - 0.33 * up[2]};
    Frame frame;
    frame.captured_ns = beo::monotonic_ns();
    for (std::uint32_t v = 0; v < intrinsics.height; v++) {
        for (std::uint32_t u = 0; u < intrinsics.width; u++) {
            const Vector ray = {(u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy, 1};
            double enter = 0, leave = 10;
            for (std::size_t i = 0; i < 3; i++) {
                const double along = dot(axes[i], ray), middle = dot(axes[i], centre) / along, width = half[i] / std::fabs(along);
                enter = std::fmax(enter, middle - width);
                leave = std::fmin(leave, middle + width);
            }
            const bool is_box = enter < leave;
            const double table = -0.4 / dot(up, ray), depth = is_box ? enter : table > 0 && table < 5 ? table : 0;
            frame.depth_mm.push_back(static_cast<std::uint16_t>(std::floor(1000 * depth + 0.5)));
            if (has_labels) {
                frame.labels.push_back(is_box ? OBJECT : 0);
            }
        }
    }
    return frame;
}

void run(const std::string &instance, unsigned long count, std::uint32_t side, const std::string &segmentation) {
    if (segmentation != "mask" && segmentation != "table") {
        throw std::invalid_argument("SEGMENTATION is mask or table, not " + segmentation);
    }
    // The sensor's noise, what is up, if you know it, and the object's size, if you know it, go in here.
    const beo::CameraOptions options = beo::camera_options();

    beo::Producer producer = beo::Producer::open(instance, {side, side, side}, std::chrono::seconds(10)).value();
    std::vector<float> depth_m(std::size_t{intrinsics.width} * intrinsics.height);
    std::optional<beo::Plane> table;
    for (unsigned long sent = 0; sent < count;) {
        Frame frame = next_frame(segmentation == "mask");
        beo::depth_from_u16(frame.depth_mm, 0.001, depth_m).value();
        if (frame.labels.empty()) {
            frame.labels = beo::segment_table(beo::depth_frame(intrinsics, depth_m), options).value();
        }
        const beo::DepthFrame view = beo::depth_frame(intrinsics, depth_m, frame.labels);
        if (const beo::Result<beo::Plane> found = beo::fit_support(view, options)) {
            table = *found; // Where it is hidden, it is where it was.
        }
        if (!table) {
            continue;
        }
        const beo::Result<beo::Grid> grid = beo::place_grid(view, OBJECT, &*table, {side, side, side}, options);
        if (!grid && grid.is_retryable()) {
            continue; // Hardly seen: left out of this frame.
        }
        beo::Result<beo::Loan> loan = producer.loan();
        if (!loan && loan.is_retryable()) {
            continue; // The daemon is away, say: this frame is left out.
        }
        beo::carve(view, OBJECT, &*table, grid.value(), loan.value().voxels(), options).value();
        beo::ObservationHeader header = beo::observation_header_of_grid(grid.value(), options).value();
        header.object_id = OBJECT;
        header.capture_ns = frame.captured_ns;
        const std::uint64_t sequence = std::move(*loan).commit(header).value();
        std::printf("sent observation %llu\n", static_cast<unsigned long long>(sequence));
        std::fflush(stdout);
        sent++;
    }
}

} // namespace

int main(int argc, char **argv) {
    try {
        run(argc > 1 ? argv[1] : "default", argc > 2 ? std::stoul(argv[2]) : 90,
            argc > 3 ? static_cast<std::uint32_t>(std::stoul(argv[3])) : 30, argc > 4 ? argv[4] : "mask");
    } catch (const std::exception &error) {
        std::fprintf(stderr, "depth_camera: %s\n", error.what());
        return 1;
    }
    return 0;
}
