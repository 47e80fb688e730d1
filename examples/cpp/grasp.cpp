// A gripper's process: from every completion, how large the object is and where its centroid lies in the sensor's frame.
//
//     grasp [INSTANCE] [COUNT]
//
// INSTANCE: of the daemon (default); COUNT: completions to print (without end).
//
// Centroid: the mean of the voxels' centres, weighted with their probability of being filled; its uncertainty is what it would move if all
// voxels' deviations went together, the worst case. Extent along each axis of the frame: of the voxels whose probability is at least one
// half, between brackets if each had one deviation less, and one more. From every percept of a grid whose size and place were to be found,
// as a depth camera's are: the box that the daemon found.

#include <beo.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>
#include <string>

namespace {

using Vector = std::array<double, 3>;
using Matrix = std::array<Vector, 3>;

Matrix rotation_matrix(const double (&q)[4]) {
    const double x = q[0], y = q[1], z = q[2], w = q[3];
    return {Vector{1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)},
            Vector{2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)},
            Vector{2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)}};
}

// A grid in the sensor's frame.
class Placement {
public:
    explicit Placement(const beo::CompletionHeader &header) : header_(header), rotation_(rotation_matrix(header.orientation)) {}

    // Centre of a voxel.
    Vector centre(std::size_t index) const {
        const std::uint32_t *n = header_.dims;
        const Vector ijk = {static_cast<double>(index / (std::size_t{n[1]} * n[2])), static_cast<double>(index / n[2] % n[1]),
                            static_cast<double>(index % n[2])};
        Vector point;
        for (std::size_t axis = 0; axis < 3; axis++) {
            point[axis] = header_.position_m[axis];
            for (std::size_t j = 0; j < 3; j++) {
                point[axis] += rotation_[axis][j] * (ijk[j] + 0.5 - n[j] / 2.0) * static_cast<double>(header_.voxel_size_m);
            }
        }
        return point;
    }

    // Half the extent of a voxel along an axis of the frame.
    double half(std::size_t axis) const {
        const Vector &row = rotation_[axis];
        return 0.5 * static_cast<double>(header_.voxel_size_m) * (std::fabs(row[0]) + std::fabs(row[1]) + std::fabs(row[2]));
    }

private:
    const beo::CompletionHeader &header_;
    Matrix rotation_;
};

// A box that grows with every point.
struct Box {
    Vector low, high;

    Box() {
        low.fill(std::numeric_limits<double>::infinity());
        high.fill(-std::numeric_limits<double>::infinity());
    }
    void include(const Vector &point) {
        for (std::size_t axis = 0; axis < 3; axis++) {
            low[axis] = std::min(low[axis], point[axis]);
            high[axis] = std::max(high[axis], point[axis]);
        }
    }
    bool empty() const { return high[0] < low[0]; }
    double extent(std::size_t axis, const Placement &placement) const {
        return empty() ? 0 : high[axis] - low[axis] + 2 * placement.half(axis);
    }
};

void print(const beo::Completion &completion) {
    const beo::CompletionHeader &header = completion.header();
    const auto number = static_cast<unsigned long long>(header.sequence);
    if (header.frame != BEO_COMPLETION_FRAME_GRID) {
        std::printf("#%llu is completed in the object's frame: ask for the grid's\n", number);
        return;
    }
    const auto occupancy = completion.occupancy(), deviation = completion.deviation();
    const Placement placement(header);
    Vector centroid = {}, moves = {};
    double mass = 0;
    Box least, likely, most;
    for (std::size_t index = 0; index < occupancy.size(); index++) {
        const int p = occupancy[index], s = deviation[index];
        const Vector point = placement.centre(index);
        mass += p;
        for (std::size_t axis = 0; axis < 3; axis++) {
            centroid[axis] += p * point[axis];
        }
        if (p - s >= 128) {
            least.include(point);
        }
        if (p >= 128) {
            likely.include(point);
        }
        if (p + s >= 128) {
            most.include(point);
        }
    }
    if (likely.empty()) {
        std::printf("#%llu nothing to grasp\n", number);
        return;
    }
    for (double &coordinate : centroid) {
        coordinate /= mass;
    }
    for (std::size_t index = 0; index < deviation.size(); index++) {
        if (deviation[index] > 0) {
            const Vector point = placement.centre(index);
            for (std::size_t axis = 0; axis < 3; axis++) {
                moves[axis] += deviation[index] * std::fabs(point[axis] - centroid[axis]) / mass;
            }
        }
    }
    std::printf("#%llu in %s: centroid (%.3f, %.3f, %.3f) +- (%.3f, %.3f, %.3f) m, extent ", number,
                std::string(beo::text(header.frame_id)).c_str(), centroid[0], centroid[1], centroid[2], moves[0], moves[1], moves[2]);
    for (std::size_t axis = 0; axis < 3; axis++) {
        std::printf("%.3f [%.3f, %.3f] %s", likely.extent(axis, placement), least.extent(axis, placement), most.extent(axis, placement),
                    axis < 2 ? "x " : "m\n");
    }
}

// Where the object's box is and how big, if the daemon was asked to find out: in the sensor's frame, sides along the object's axes.
void print_box(const beo::Percept &percept) {
    const double *p = percept.object_position_m;
    const float *dp = percept.object_position_deviation_m, *e = percept.object_extent_m, *de = percept.object_extent_deviation_m;
    if (beo::has_box(percept)) {
        std::printf("#%llu box at (%.3f, %.3f, %.3f) +- (%.3f, %.3f, %.3f) m, sides %.3f x %.3f x %.3f +- (%.3f, %.3f, %.3f) m\n", static_cast<unsigned long long>(percept.sequence), p[0],
                    p[1], p[2], static_cast<double>(dp[0]), static_cast<double>(dp[1]), static_cast<double>(dp[2]),
                    static_cast<double>(e[0]), static_cast<double>(e[1]), static_cast<double>(e[2]), static_cast<double>(de[0]),
                    static_cast<double>(de[1]), static_cast<double>(de[2]));
    }
}

void run(const std::string &instance, unsigned long count) {
    beo::Subscriber::Options options;
    options.completion = true;
    options.wait = std::chrono::seconds(10);
    beo::Subscriber subscriber = beo::Subscriber::open(instance, options).value();
    std::fprintf(stderr, "listening\n");
    for (unsigned long done = 0; done < count;) {
        const auto waited = subscriber.wait(std::chrono::milliseconds(500));
        if (!waited && !waited.is_retryable()) {
            waited.value(); // Throws.
        }
        while (done < count) {
            const auto completion = subscriber.take_completion(); // Released at the end of this round.
            if (!completion) {
                break;
            }
            print(*completion);
            std::fflush(stdout);
            done++;
        }
        while (const auto percept = subscriber.take_percept()) {
            print_box(*percept);
            std::fflush(stdout);
        }
    }
}

} // namespace

int main(int argc, char **argv) {
    try {
        run(argc > 1 ? argv[1] : "default", argc > 2 ? std::stoul(argv[2]) : std::numeric_limits<unsigned long>::max());
    } catch (const std::exception &error) {
        std::fprintf(stderr, "grasp: %s\n", error.what());
        return 1;
    }
    return 0;
}
