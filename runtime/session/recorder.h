// SPDX-License-Identifier: Apache-2.0
// The interface to a loop's observers, and those that record: recorder and black box.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "formats/base/files.h"
#include "formats/base/result.h"
#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/haptics/loop/haptic_loop.h"
#include "runtime/realtime/queues.h"
#include "runtime/realtime/realtime_thread.h"

namespace trocar::runtime {

// The interface between the haptic loop and its observers: the recorder, the black box, messages to
// the operator, the session publisher, the frame display, the tick feed, and the statistics. A new
// observer is one class derived from TickObserver, and one line in make_workers()
// (runtime/session/session.cpp) or an entry in SessionOptions::observers.

/// Returns true for the faults that the operator's commands pause and zero raise. These faults are
/// not failures: the session waits for the operator.
constexpr bool is_by_operator(Fault fault) noexcept {
  return fault == Fault::kPaused || fault == Fault::kForcesOff;
}

/// Returns true for the faults that are failures of the device or of the loop. A session that could
/// not be recorded ends as if the operator had stopped it.
constexpr bool is_failure(Fault fault) noexcept {
  return fault != Fault::kNone && fault != Fault::kRecordingFailed && !is_by_operator(fault);
}

struct PunctureEvent {
  std::int32_t sheet = -1;  ///< index of the sheet; the topmost is 0
  std::int32_t slice = -1;  ///< slice index in the asset
  std::uint32_t cut = 0;    ///< number of the hole in this sheet, counted from 1
  double t_s = 0;
  double tool_z_m = 0;       ///< height of the tip in {B}: RecordingRow::tool_m of the tick
  double penetration_m = 0;  ///< ContactOutput::penetration_m of the tick
  double tip_N = 0;          ///< RecordingRow::tip_N of the tick before the puncture
  double hand_N = 0;         ///< delivered force in the tick before the puncture
  /// Force that would have exceeded the tissue's threshold (law `cutting`: largest strength of the
  /// bone that the front passed), without the factor force_scale.
  double trial_force_N = 0;
};

/// A break-through (runtime/haptics/loop/break_through.h).
struct BreakThroughEvent {
  std::int32_t sheet = -1;  ///< index of the sheet; -1: none
  std::int32_t at = -1;     ///< RecordingRow::break_through_at
  double t_s = 0;
  double tool_z_m = 0;
  double resistance_N = 0;  ///< RecordingRow::break_through_N
};

/// A message to the operator while a session runs.
struct OperatorMessage {
  enum class Kind : std::uint8_t {
    kFault,         ///< the fault `detail` was latched
    kNotRecovered,  ///< a requested recovery is delayed by the fault `detail`; if `detail` has no
                    ///< fault, the recovery is delayed because the tool is in material
    kRecovered,     ///< forces rise again; `detail.fault` is the fault that has ended
    kRefused,       ///< a request for recovery was refused, because the device's stop is held;
                    ///< `detail.fault` is kLinkLost if the device cannot tell its release
    kSoftened,      ///< the guard softens the force, because the contact oscillates by itself
  };
  Kind kind = Kind::kFault;
  double t_s = 0;
  FaultDetail detail;
  double retract_distance_m = 0;  ///< kNotRecovered: distance by which the tool must be retracted
};

/// One tick, valid during the call of TickObserver::on_tick().
struct TickView {
  const TickResult& result;
  const LoopState& state;                ///< state after the tick
  std::span<const Sheet* const> sheets;  ///< meshes that the tick used, the topmost first
  const TickTiming& timing;              ///< all zero if is_real_time is false
  const LateTicks::Counts& late_ticks;   ///< deadlines missed before this tick, for each cause
  bool is_real_time = false;             ///< ticks follow the wall clock
  std::int64_t start_ns = 0;             ///< start of the tick on CLOCK_MONOTONIC
};

class TickObserver {
 public:
  /// In real time a background thread calls serve() and sleeps for `interval`, in turn. If the
  /// interval is 0, there is no such thread.
  explicit TickObserver(std::chrono::nanoseconds interval = {}) : interval_(interval) {}
  /// A derived class that overrides serve() must call stop() in its destructor.
  virtual ~TickObserver() = default;
  TickObserver(const TickObserver&) = delete;
  TickObserver& operator=(const TickObserver&) = delete;

  // The haptic thread calls these functions. They must not allocate, lock or make a system call.

  virtual void on_puncture(const PunctureEvent&) noexcept {}
  virtual void on_break_through(const BreakThroughEvent&) noexcept {}
  virtual void on_message(const OperatorMessage&) noexcept {}
  /// Called once a tick, after the punctures and messages of that tick.
  virtual void on_tick(const TickView& tick) noexcept = 0;

  // The thread that runs the session calls start() before the first tick, but only in real time,
  // and stop() after the last tick. In real time the thread that start() creates calls serve(). In
  // virtual time the thread that runs the session calls serve() after every tick.

  /// Processes the data that the haptic thread has queued.
  virtual void serve() {}
  void start() {
    if (interval_.count() > 0) thread_.start(interval_, [this] { serve(); });
  }
  /// Call this after the last tick. Ends the thread, if there is one, and calls serve() once more.
  virtual void stop() {
    join();
    serve();
  }

 protected:
  void join() { thread_.stop(); }

 private:
  std::chrono::nanoseconds interval_;
  PollingThread thread_;
};

// Passes every tick, with the sheets and layers punctured in it, to a function that may take longer
// than the haptic thread can wait. On the real clock, another thread calls this function.

/// One tick. `punctured`, `side_cut` and `layers_punctured` are sets: each bit stands for a sheet
/// or a soft layer, bit 0 for the topmost one.
struct ObservedTick {
  RecordingRow row;
  std::uint64_t punctured = 0;  ///< sheets that were punctured (law `cutting`: passed by the front)
  std::uint64_t side_cut = 0;   ///< sheets in which the tool cut a hole's wall (law `cutting`)
  std::uint64_t layers_punctured = 0;  ///< soft layers that were punctured
  /// In the tick of a puncture: RecordingRow::tip_N of the tick before. Otherwise without meaning.
  double tip_N = 0;
  BreakThroughTick break_through;
};
static_assert(kMaxSceneSlices <= 64 && kMaxLayers <= 64, "one bit for each");

class TickFeed final : public TickObserver {
 public:
  static constexpr std::size_t kCapacity = 8192;  ///< queue capacity in ticks: one second at 8 kHz

  /// serve() calls `observe` with every tick, in order.
  explicit TickFeed(std::function<void(const ObservedTick&)> observe);
  ~TickFeed() override { stop(); }

  /// If the queue is full, the tick is lost, and lost() counts it.
  void on_tick(const TickView& tick) noexcept override;
  void serve() override;
  std::uint64_t lost() const noexcept { return lost_.load(); }

 private:
  SpscQueue<ObservedTick, kCapacity> ticks_;
  std::atomic<std::uint64_t> lost_{0};
  std::function<void(const ObservedTick&)> observe_;
};

// A histogram of durations for the console. Each range from 2^k ns to 2^(k + 1) ns is
// divided into four bins of equal width.

/// The first bin begins at 256 ns and also counts shorter durations. The last bin counts all
/// durations above 14.7 ms. One thread writes, and any thread may read.
class TelemetryHistogram {
 public:
  static constexpr std::size_t kBins = 64;

  void add(std::int64_t duration_ns) noexcept {
    std::atomic<std::uint64_t>& count = counts_[bin(duration_ns)];
    count.store(count.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  }
  std::uint64_t count(std::size_t i) const noexcept {
    return counts_[i].load(std::memory_order_relaxed);
  }
  /// Returns the bin of a duration.
  static std::size_t bin(std::int64_t duration_ns) noexcept;
  /// Returns the lower end of bin i; 0 for the first bin.
  static double lower_us(std::size_t i) noexcept;

 private:
  std::array<std::atomic<std::uint64_t>, kBins> counts_{};
};

// Space on a disk that is held free, so that the last rows and the reports of a session can be
// written when the disk is full.

/// The space belongs to a file without a name, so nothing is left if the program is killed.
class DiskReserve {
 public:
  static constexpr std::uint64_t kBytes = std::uint64_t{1} << 20;

  /// Holds kBytes on the disk of `folder`, or nothing if its file system cannot hold space. Errors:
  /// kUnwritable if the disk has less space than that.
  static Result<DiskReserve> hold(const std::filesystem::path& folder);
  /// Gives the space back to the disk.
  void release() noexcept { file_.reset(); }

 private:
  DiskReserve() = default;
  std::optional<FileDescriptor> file_;
};

// The black box keeps the rows of the last seconds. After a fault, it writes these rows to a new
// file. The haptic thread pushes rows into a preallocated ring buffer. When the torques have fallen
// to zero after a fault, the haptic thread requests a file. A worker thread copies the rows and
// writes the file. The ring buffer holds twice as many rows as a file, so the worker has
// kBlackBox_s to copy the rows before they are overwritten. If the worker is too late, no file is
// written, and BlackBoxFile::error is set.

inline constexpr double kBlackBox_s = 4;  ///< time that the rows of a file cover

/// The outcome of one request for a file.
struct BlackBoxFile {
  Fault fault = Fault::kNone;
  double t_s = 0;          ///< time of the fault
  std::uint64_t rows = 0;  ///< number of rows copied from the ring buffer for this file
  std::filesystem::path file;
  /// None: the file is complete. Otherwise: the reason why there is no file, and where the rows are
  /// that could be written.
  std::optional<Error> error{};
};

class BlackBox final : public TickObserver {
 public:
  /// Makes a black box that writes its files to `folder`. A file's name is
  /// black_box_TIME_tSECONDSs_FAULT.csv. TIME is utc_name() of this call, SECONDS the session's time
  /// at the fault, and FAULT the name of the fault. If such a file exists, "_2"
  /// or a higher number is added to the name. `origin` is written into the first row of each file.
  /// Errors: kUnwritable if the folder does not exist, or if files cannot be created in it.
  static Result<std::unique_ptr<BlackBox>> make(const std::filesystem::path& folder, double rate_Hz,
                                                const RecordingOrigin& origin = {});
  ~BlackBox() override { stop(); }

  // The haptic thread calls these functions.

  void push(const RecordingRow& row) noexcept { ring_.push(row); }
  /// Requests a file with the last rows pushed so far. If too many requests are waiting, the
  /// request is lost: the function returns false, and lost() counts the request.
  bool save(Fault fault, double t_s) noexcept;
  /// Pushes the row. After a fault, the torques fall to zero in a ramp. When the ramp has ended,
  /// requests a file, so that the file contains the whole ramp. No file is requested after faults for
  /// which is_failure() is false.
  void on_tick(const TickView& tick) noexcept override;

  // TickObserver says which thread calls these functions.

  /// Writes the requested files.
  void serve() override;
  /// Like TickObserver::stop(). If the session ended during the ramp after a fault, first requests
  /// a file for that fault.
  void stop() override;

  // Call these functions after stop(), or on the thread that calls serve().

  /// The outcomes of all requests so far.
  const std::vector<BlackBoxFile>& files() const noexcept { return files_; }
  /// Number of requests lost because the queue was full.
  std::uint64_t lost() const noexcept { return lost_.load(); }

 private:
  struct Request {
    Fault fault = Fault::kNone;
    double t_s = 0;
    std::uint64_t end = 0;  ///< number of rows pushed before the file was requested
  };

  BlackBox(std::filesystem::path folder, std::string name, std::size_t rows_of_file,
           RecordingOrigin origin);
  void serve_one(const Request& request);
  std::filesystem::path name_of(const Request& request) const;

  std::filesystem::path folder_;
  std::string name_;
  std::size_t rows_of_file_;
  RecordingOrigin origin_;
  RingBuffer<RecordingRow> ring_;
  SpscQueue<Request, 256> requests_;
  std::atomic<std::uint64_t> lost_{0};
  bool is_pending_ = false;  ///< a file will be requested when the ramp after a fault has ended
  Fault latched_ = Fault::kNone;
  double latched_t_s_ = 0;
  std::vector<BlackBoxFile> files_;
};

// Writes the row of every tick to a recording, and watches the space on its disk. In real time a
// separate thread writes the rows. If the rows cannot be written, the session is to end, because
// what it did could not be shown. The rows until its end still fit on a full disk, because the
// recorder holds space for them.

class Recorder final : public TickObserver {
 public:
  static constexpr std::size_t kCapacity = 8192;  ///< queue capacity in rows: one second at 8 kHz
  static constexpr double kLowSpace_s = 600;

  /// Opens the recording. `rate_Hz`: rate of the ticks. `low_space` is called at most once, on the
  /// thread that writes the rows, if only `left_s` < kLowSpace_s of recording fit on the disk.
  /// Errors: those of RecordingWriter::open() and DiskReserve::hold().
  static Result<std::unique_ptr<Recorder>> make(const std::filesystem::path& file,
                                                const RecordingOrigin& origin, double rate_Hz,
                                                std::function<void(double left_s)> low_space = {});
  ~Recorder() override { stop(); }

  /// If the queue is full, this row and all later ones are lost.
  void on_tick(const TickView& tick) noexcept override {
    if (is_full_.load(std::memory_order_relaxed) || rows_.push(tick.result.row)) return;
    is_full_.store(true, std::memory_order_relaxed);
  }
  /// True if a row could not be written or is lost. Wait-free, for the haptic thread.
  bool has_failed() const noexcept {
    return has_failed_.load(std::memory_order_relaxed) || is_full_.load(std::memory_order_relaxed);
  }
  /// Time of recording that fits on the disk; infinite until it has been measured. Any thread may
  /// call this function.
  double left_s() const noexcept { return left_s_.load(std::memory_order_relaxed); }

  /// Writes the rows that are now in the queue to the file.
  void serve() override;
  /// Calls stop(), and renames the file, which has a temporary name until then. Errors: kUnwritable
  /// if has_failed() is true, or if the recording cannot be ended. The message says where the rows
  /// are: in the recording, unless they did not fit on the disk.
  Result<void> finish();

 private:
  Recorder(RecordingWriter writer, DiskReserve reserve, double rate_Hz,
           std::function<void(double left_s)> low_space);
  void write(std::span<const RecordingRow> rows);
  void fail(const Error& error);
  void measure_space();

  SpscQueue<RecordingRow, kCapacity> rows_;
  std::atomic<bool> has_failed_{false}, is_full_{false};
  std::atomic<double> left_s_{std::numeric_limits<double>::infinity()};
  std::optional<Error> error_;
  RecordingWriter writer_;
  DiskReserve reserve_;
  double rate_Hz_;
  std::function<void(double left_s)> low_space_;
  std::chrono::steady_clock::time_point measured_at_{};
  bool is_low_ = false;
};

}  // namespace trocar::runtime
