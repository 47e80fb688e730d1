// beo.hpp: the C++17 interface to the beo perception daemon. Header-only, on top of beo.h; link with libbeo.
//
// Objects own their handles: they close, release or abandon them at the end of their life, and can be moved but not copied. What can fail
// returns a beo::Result: test it and look at its status, or call value(), which throws beo::Error. Without exceptions (-fno-exceptions)
// value() of a failed result prints the error and aborts, so test first.
//
//     beo::Subscriber subscriber = beo::Subscriber::open("default").value();
//     while (subscriber.wait(std::chrono::milliseconds(500))) {
//         while (auto percept = subscriber.take_percept()) { ... percept->class_index ... }
//     }
//
// A depth camera's driver: depth_frame, segment_table without a mask, fit_support, place_grid, Producer::loan, carve, Loan::commit (examples/cpp/depth_camera.cpp).
//
// Objects may be used from any thread, one thread at a time. Rules and units are those of beo.h.

#ifndef BEO_HPP
#define BEO_HPP

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "beo.h"

#if defined(__cpp_exceptions) || defined(__EXCEPTIONS)
#define BEO_HAS_EXCEPTIONS 1
#else
#define BEO_HAS_EXCEPTIONS 0
#endif

namespace beo {

using ObservationHeader = beo_observation_header;
using Percept = beo_percept;
using Hypothesis = beo_hypothesis;
using CompletionHeader = beo_completion_header;
using DaemonStatus = beo_daemon_status;
using Status = beo_status;
using Intrinsics = beo_intrinsics;
using DepthFrame = beo_depth_frame;
using CameraOptions = beo_camera_options;
using Plane = beo_plane;
using Grid = beo_grid;

// Bytes that lie somewhere else: what C++20 calls std::span.
template <class T>
class Span {
public:
    constexpr Span() noexcept = default;
    constexpr Span(T *data, std::size_t size) noexcept : data_(data), size_(size) {}
    // A view of anything with data() and size(): std::vector, std::array, another Span.
    template <class Container, class = std::enable_if_t<!std::is_same_v<std::decay_t<Container>, Span> &&
                                                        std::is_convertible_v<decltype(std::declval<Container &>().data()), T *>>>
    constexpr Span(Container &&container) noexcept : data_(container.data()), size_(container.size()) {}

    constexpr T *data() const noexcept { return data_; }
    constexpr std::size_t size() const noexcept { return size_; }
    constexpr bool empty() const noexcept { return size_ == 0; }
    constexpr T &operator[](std::size_t index) const noexcept { return data_[index]; }
    constexpr T *begin() const noexcept { return data_; }
    constexpr T *end() const noexcept { return data_ + size_; }

private:
    T *data_ = nullptr;
    std::size_t size_ = 0;
};

// A call that was not done, as an exception: its status, and what was wrong, where, and what to do.
class Error : public std::exception {
public:
    Error(Status status, std::string text) : status_(status), text_(std::move(text)) {}
    Status status() const noexcept { return status_; }
    // Nothing is broken: try again.
    bool is_retryable() const noexcept { return status_ > 0; }
    const char *what() const noexcept override { return text_.c_str(); }

private:
    Status status_;
    std::string text_;
};

namespace detail {

[[noreturn]] inline void fail(Status status, const std::string &text) {
#if BEO_HAS_EXCEPTIONS
    throw Error(status, text);
#else
    static_cast<void>(status);
    std::fprintf(stderr, "beo: %s\n", text.c_str());
    std::abort();
#endif
}

// What the library said of a call of this thread that was not done. Statuses without a text of their own have their general one.
inline std::string text_of(Status status) {
    const bool says_nothing_new = status == BEO_STATUS_EMPTY || status == BEO_STATUS_TIMEOUT || status == BEO_STATUS_INTERRUPTED;
    const char *own = says_nothing_new ? "" : beo_last_error();
    return *own != '\0' ? own : beo_status_text(status);
}

inline std::int32_t milliseconds(std::chrono::milliseconds time) {
    const auto count = time.count();
    const auto most = std::numeric_limits<std::int32_t>::max();
    return count < 0 ? -1 : count > most ? most : static_cast<std::int32_t>(count);
}

// A handle of the C interface and the function that ends it.
template <class Handle, Status (*End)(Handle *)>
class Owner {
public:
    Owner() noexcept = default;
    explicit Owner(Handle *handle) noexcept : handle_(handle) {}
    Owner(Owner &&other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
    Owner &operator=(Owner &&other) noexcept {
        if (this != &other) {
            reset();
            handle_ = std::exchange(other.handle_, nullptr);
        }
        return *this;
    }
    Owner(const Owner &) = delete;
    Owner &operator=(const Owner &) = delete;
    ~Owner() { reset(); }

    Handle *get() const noexcept { return handle_; }
    Handle *release() noexcept { return std::exchange(handle_, nullptr); }
    void reset() noexcept {
        if (handle_ != nullptr) {
            End(std::exchange(handle_, nullptr));
        }
    }

private:
    Handle *handle_ = nullptr;
};

} // namespace detail

// What a call gave, or why it gave nothing.
template <class T>
class [[nodiscard]] Result {
public:
    Result(T value) : value_(std::move(value)) {}
    // Of a call that was just not done by this thread.
    explicit Result(Status status) : status_(status), text_(detail::text_of(status)) {}

    explicit operator bool() const noexcept { return value_.has_value(); }
    bool has_value() const noexcept { return value_.has_value(); }
    Status status() const noexcept { return status_; }
    bool is_retryable() const noexcept { return status_ > 0; }
    // What was wrong; empty after success.
    const std::string &error() const noexcept { return text_; }

    // The value; otherwise throws beo::Error, or aborts without exceptions.
    T &value() & {
        require();
        return *value_;
    }
    const T &value() const & {
        require();
        return *value_;
    }
    T value() && {
        require();
        return std::move(*value_);
    }
    // As value(), of a result that has been tested.
    T &operator*() & { return value(); }
    const T &operator*() const & { return value(); }
    T operator*() && { return std::move(*this).value(); }
    T *operator->() { return &value(); }
    const T *operator->() const { return &value(); }

private:
    void require() const {
        if (!value_.has_value()) {
            detail::fail(status_, text_);
        }
    }

    std::optional<T> value_;
    Status status_ = BEO_STATUS_OK;
    std::string text_;
};

// The same for calls that give nothing but their success.
template <>
class [[nodiscard]] Result<void> {
public:
    Result() = default;
    explicit Result(Status status) : status_(status), text_(status == BEO_STATUS_OK ? std::string() : detail::text_of(status)) {}

    explicit operator bool() const noexcept { return status_ == BEO_STATUS_OK; }
    Status status() const noexcept { return status_; }
    bool is_retryable() const noexcept { return status_ > 0; }
    const std::string &error() const noexcept { return text_; }
    void value() const {
        if (status_ != BEO_STATUS_OK) {
            detail::fail(status_, text_);
        }
    }

private:
    Status status_ = BEO_STATUS_OK;
    std::string text_;
};

// Now, in nanoseconds of the clock of all stamps.
inline std::uint64_t monotonic_ns() noexcept { return beo_monotonic_ns(); }

// Whether the library that is linked is of the version of these headers.
inline bool is_compatible() noexcept { return beo_abi_version() == BEO_ABI_VERSION; }

// A text field of a message: UTF-8, padded with NUL.
template <std::size_t N>
std::string_view text(const std::uint8_t (&field)[N]) noexcept {
    const char *start = reinterpret_cast<const char *>(field);
    const void *end = std::memchr(start, '\0', N);
    return {start, end == nullptr ? N : static_cast<std::size_t>(static_cast<const char *>(end) - start)};
}

// Sets a text field of a message; what does not fit is cut off.
template <std::size_t N>
void set_text(std::uint8_t (&field)[N], std::string_view text) noexcept {
    std::memset(field, 0, N);
    std::memcpy(field, text.data(), text.size() < N ? text.size() : N);
}

// The name of a class; empty for one that the model does not have, or BEO_NO_CLASS.
inline std::string_view class_name(const DaemonStatus &status, std::uint32_t class_index) noexcept {
    return class_index < status.class_count && class_index < BEO_MAX_CLASSES ? text(status.class_names[class_index]) : std::string_view();
}

// Whether a none_probability or a fit was computed: BEO_NOT_COMPUTED says that it was not.
inline bool is_computed(float value) noexcept { return value >= 0; }

// The pose hypotheses of a percept, most probable first.
inline Span<const Hypothesis> hypotheses(const Percept &percept) noexcept {
    const std::size_t count = percept.hypothesis_count;
    return {percept.hypotheses, count < BEO_MAX_HYPOTHESES ? count : std::size_t{BEO_MAX_HYPOTHESES}};
}

// Whether a percept says how big the object is: object_position_m is then its box's centre, object_extent_m the box's sides.
inline bool has_box(const Percept &percept) noexcept { return percept.status == BEO_PERCEPT_STATUS_OK && percept.object_extent_m[0] > 0; }

// A header for a grid of these dims, with everything else as beo_observation_header_init has it.
inline Result<ObservationHeader> observation_header(std::array<std::uint32_t, 3> dims) {
    ObservationHeader header;
    const Status status = beo_observation_header_init(&header, dims[0], dims[1], dims[2]);
    return status == BEO_STATUS_OK ? Result<ObservationHeader>(header) : Result<ObservationHeader>(status);
}

// A completed grid where it lies in shared memory, held until the end of this object.
class Completion {
public:
    const CompletionHeader &header() const noexcept { return view_.header; }
    // Probability of being filled × 255, one byte per voxel, C order [x][y][z].
    Span<const std::uint8_t> occupancy() const noexcept { return {view_.occupancy, view_.voxel_count}; }
    // Standard deviation of that probability × 255, in the same order.
    Span<const std::uint8_t> deviation() const noexcept { return {view_.deviation, view_.voxel_count}; }

private:
    friend class Subscriber;
    Completion(beo_completion *handle, const beo_completion_view &view) : handle_(handle), view_(view) {}

    detail::Owner<beo_completion, beo_completion_release> handle_;
    beo_completion_view view_;
};

// Reads percepts, completions and the status of a daemon; outlives the daemon.
class Subscriber {
public:
    struct Options {
        // Completions too.
        bool completion = false;
        // How long opening waits for the daemon; negative: without end.
        std::chrono::milliseconds wait{0};
    };

    // BEO_STATUS_NOT_RUNNING if there is no daemon: try again.
    static Result<Subscriber> open(const std::string &instance, const Options &options) {
        beo_subscriber_options c_options = BEO_SUBSCRIBER_OPTIONS_INIT;
        c_options.completion = options.completion ? 1 : 0;
        c_options.wait_ms = detail::milliseconds(options.wait);
        beo_subscriber *handle = nullptr;
        const Status status = beo_subscriber_open(instance.c_str(), &c_options, &handle);
        return status == BEO_STATUS_OK ? Result<Subscriber>(Subscriber(handle)) : Result<Subscriber>(status);
    }
    static Result<Subscriber> open(const std::string &instance = "default") { return open(instance, Options()); }

    // Waits until the daemon has sent something. Not done: BEO_STATUS_TIMEOUT, _NOT_RUNNING, _INTERRUPTED, all retryable.
    Result<void> wait(std::chrono::milliseconds timeout) {
        return Result<void>(beo_subscriber_wait(handle_.get(), detail::milliseconds(timeout)));
    }

    // For poll or epoll: when it is readable, call wait() with 0 ms, then take everything.
    Result<int> file_descriptor() {
        int descriptor = -1;
        const Status status = beo_subscriber_file_descriptor(handle_.get(), &descriptor);
        return status == BEO_STATUS_OK ? Result<int>(descriptor) : Result<int>(status);
    }

    // The oldest percept not yet taken; BEO_STATUS_EMPTY if there is none.
    Result<Percept> take_percept() {
        Percept percept;
        const Status status = beo_subscriber_take_percept(handle_.get(), &percept);
        return status == BEO_STATUS_OK ? Result<Percept>(percept) : Result<Percept>(status);
    }

    // How many percepts were published between those that were taken, and lost here.
    std::uint64_t missed() const noexcept {
        std::uint64_t missed = 0;
        (void)beo_subscriber_missed(handle_.get(), &missed);
        return missed;
    }

    // The oldest completion not yet taken; BEO_STATUS_EMPTY if there is none. Two can be held at a time.
    Result<Completion> take_completion() {
        beo_completion_view view;
        BEO_COMPLETION_VIEW_INIT(view);
        beo_completion *handle = nullptr;
        const Status status = beo_subscriber_take_completion(handle_.get(), &handle, &view);
        return status == BEO_STATUS_OK ? Result<Completion>(Completion(handle, view)) : Result<Completion>(status);
    }

    // The newest status; BEO_STATUS_EMPTY before the first.
    Result<DaemonStatus> status() {
        DaemonStatus newest;
        const Status status = beo_subscriber_status(handle_.get(), &newest, nullptr);
        return status == BEO_STATUS_OK ? Result<DaemonStatus>(newest) : Result<DaemonStatus>(status);
    }

    // For calls of beo.h.
    beo_subscriber *handle() const noexcept { return handle_.get(); }

private:
    explicit Subscriber(beo_subscriber *handle) : handle_(handle) {}

    detail::Owner<beo_subscriber, beo_subscriber_close> handle_;
};

// Memory for one observation: write every voxel, then commit. Abandoned at the end of its life if it was not committed.
class Loan {
public:
    // 0 empty, 1 filled, 255 unknown; voxel (x, y, z) is at (x * ny + y) * nz + z.
    Span<std::uint8_t> voxels() const noexcept { return voxels_; }

    // Sends it and gives its number, which its percept repeats.
    Result<std::uint64_t> commit(const ObservationHeader &header) && { return send(&header); }
    Result<std::uint64_t> commit() && { return send(nullptr); }

private:
    friend class Producer;
    Loan(beo_loan *handle, Span<std::uint8_t> voxels) : handle_(handle), voxels_(voxels) {}

    Result<std::uint64_t> send(const ObservationHeader *header) {
        std::uint64_t sequence = 0;
        const Status status = beo_loan_commit(handle_.get(), header, &sequence);
        if (status != BEO_STATUS_OK) {
            return Result<std::uint64_t>(status);
        }
        static_cast<void>(handle_.release());
        voxels_ = {};
        return Result<std::uint64_t>(sequence);
    }

    detail::Owner<beo_loan, beo_loan_abandon> handle_;
    Span<std::uint8_t> voxels_;
};

// Writes observations of one size; outlives the daemon.
class Producer {
public:
    // BEO_STATUS_NOT_RUNNING if there is no daemon after `wait` (negative: without end): try again.
    static Result<Producer> open(const std::string &instance, std::array<std::uint32_t, 3> dims,
                                 std::chrono::milliseconds wait = std::chrono::milliseconds(0)) {
        beo_producer_options options = BEO_PRODUCER_OPTIONS_INIT;
        options.wait_ms = detail::milliseconds(wait);
        beo_producer *handle = nullptr;
        const Status status = beo_producer_open(instance.c_str(), dims[0], dims[1], dims[2], &options, &handle);
        return status == BEO_STATUS_OK ? Result<Producer>(Producer(handle)) : Result<Producer>(status);
    }

    // What percepts repeat as producer_id.
    Result<std::uint64_t> id() {
        std::uint64_t id = 0;
        const Status status = beo_producer_id(handle_.get(), &id);
        return status == BEO_STATUS_OK ? Result<std::uint64_t>(id) : Result<std::uint64_t>(status);
    }

    // Memory for one grid; BEO_STATUS_NOT_RUNNING while no daemon is there: try again with the next grid.
    Result<Loan> loan() {
        beo_loan *handle = nullptr;
        std::uint8_t *voxels = nullptr;
        std::size_t count = 0;
        const Status status = beo_producer_loan(handle_.get(), &handle, &voxels, &count);
        return status == BEO_STATUS_OK ? Result<Loan>(Loan(handle, {voxels, count})) : Result<Loan>(status);
    }

    // For calls of beo.h.
    beo_producer *handle() const noexcept { return handle_.get(); }

private:
    explicit Producer(beo_producer *handle) : handle_(handle) {}

    detail::Owner<beo_producer, beo_producer_close> handle_;
};

// One call from a grid to its percept, with a producer and a subscriber of its own.
inline Result<Percept> perceive(const std::string &instance, const ObservationHeader &header, Span<const std::uint8_t> voxels,
                                std::chrono::milliseconds timeout) {
    Percept percept;
    const Status status =
        beo_perceive(instance.c_str(), &header, voxels.data(), voxels.size(), detail::milliseconds(timeout), &percept);
    return status == BEO_STATUS_OK ? Result<Percept>(percept) : Result<Percept>(status);
}

// The same with ones that are open.
inline Result<Percept> perceive(Producer &producer, Subscriber &subscriber, const ObservationHeader &header,
                                Span<const std::uint8_t> voxels, std::chrono::milliseconds timeout) {
    Percept percept;
    const Status status = beo_perceive_with(producer.handle(), subscriber.handle(), &header, voxels.data(), voxels.size(),
                                            detail::milliseconds(timeout), &percept);
    return status == BEO_STATUS_OK ? Result<Percept>(percept) : Result<Percept>(status);
}

// Readings of integers in metres: `scale_m` is 0.001 for millimetres. `depth_m` has as many places as `depth` readings.
inline Result<void> depth_from_u16(Span<const std::uint16_t> depth, double scale_m, Span<float> depth_m) {
    // A place too few or too many is a size that does not fit: the library says so of a length that no image has.
    const std::size_t count = depth.size() == depth_m.size() ? depth.size() : std::numeric_limits<std::size_t>::max();
    return Result<void>(beo_depth_from_u16(depth.data(), count, scale_m, depth_m.data()));
}

// A frame of images that the caller keeps as long as it is used: depth in metres (0: no reading) and labels (0: no object), row by row.
// Without labels, it is for segment_table alone.
inline DepthFrame depth_frame(const Intrinsics &intrinsics, Span<const float> depth_m, Span<const std::uint16_t> labels = {}) noexcept {
    DepthFrame frame;
    BEO_DEPTH_FRAME_INIT(frame);
    frame.intrinsics = intrinsics;
    frame.depth_m = depth_m.data();
    frame.depth_count = depth_m.size();
    frame.labels = labels.data();
    frame.label_count = labels.size();
    return frame;
}

// The defaults, to be changed.
inline CameraOptions camera_options() noexcept { return BEO_CAMERA_OPTIONS_INIT; }

// The labels of what stands on the table of a frame without a mask, row by row: 0 for none, objects from 1 to the largest label; all 0 where
// nothing stands there. The numbers of one frame say nothing of the next: see beo_segment_table.
inline Result<std::vector<std::uint16_t>> segment_table(const DepthFrame &frame, const CameraOptions &options = camera_options()) {
    // A depth image of another size is refused, whatever memory there is for the labels: so that much is enough.
    std::vector<std::uint16_t> labels(frame.depth_m == nullptr ? 1 : frame.depth_count);
    std::uint32_t objects = 0;
    const Status status = beo_segment_table(&frame, &options, labels.data(), labels.size(), &objects);
    return status == BEO_STATUS_OK ? Result<std::vector<std::uint16_t>>(std::move(labels)) : Result<std::vector<std::uint16_t>>(status);
}

// The plane that objects stand on; BEO_STATUS_NOT_SEEN if the frame shows none.
inline Result<Plane> fit_support(const DepthFrame &frame, const CameraOptions &options = camera_options()) {
    Plane plane;
    const Status status = beo_fit_support(&frame, &options, &plane);
    return status == BEO_STATUS_OK ? Result<Plane>(plane) : Result<Plane>(status);
}

// A grid about the pixels that are labelled `object`; BEO_STATUS_NOT_SEEN if they are too few. `support` may be null with `options.up`.
inline Result<Grid> place_grid(const DepthFrame &frame, std::uint16_t object, const Plane *support, std::array<std::uint32_t, 3> dims,
                               const CameraOptions &options = camera_options()) {
    Grid grid;
    const Status status = beo_place_grid(&frame, &options, object, support, dims[0], dims[1], dims[2], &grid);
    return status == BEO_STATUS_OK ? Result<Grid>(grid) : Result<Grid>(status);
}

// Writes all voxels of the grid: those of a loan, say. `support` may be null.
inline Result<void> carve(const DepthFrame &frame, std::uint16_t object, const Plane *support, const Grid &grid, Span<std::uint8_t> voxels,
                          const CameraOptions &options = camera_options()) {
    return Result<void>(beo_carve(&frame, &options, object, support, &grid, voxels.data(), voxels.size()));
}

// The header of a grid that was carved from a camera's frame: see beo_observation_header_of_grid.
inline Result<ObservationHeader> observation_header_of_grid(const Grid &grid, const CameraOptions &options = camera_options()) {
    ObservationHeader header;
    const Status status = beo_observation_header_of_grid(&grid, &options, &header);
    return status == BEO_STATUS_OK ? Result<ObservationHeader>(header) : Result<ObservationHeader>(status);
}

} // namespace beo

#endif // BEO_HPP
