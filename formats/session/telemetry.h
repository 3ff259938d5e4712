// SPDX-License-Identifier: Apache-2.0
// Shared-memory telemetry: the memory through which other processes observe and command a running
// session (trocar-run --live FILE). telemetry.md specifies its layout to the byte.
//
// Contract:
//  1. The writer never waits for a reader. The writer reads back only two things from the memory:
//     the command words and the live hand (item 5). A command word is a counter that a reader
//     raises to give a command. The writer only looks whether the word has changed and, for X-ray
//     screening, whether it is odd. So no reader can block or crash the writer: a reader can only
//     give commands, and move a live hand within the hand's limits.
//  2. A reader gets complete values only, and never an older value after a newer one. A reader
//     gives up after a bounded number of attempts, so it does not wait forever if the writer was
//     killed in the middle of a write.
//  3. Events are numbered from 1. A reader gets each event, or the number of events that it lost.
//  4. A reader validates everything that it uses. It can write only to one memory page, which holds
//     the commands and the live hand. The memory is sealed, so neither side can shrink the memory.
//     (A shrunk memory would kill the other side by SIGBUS.)
//  5. The live hand is a simulated hand that a person moves: another process writes the pose that
//     the hand shall have. In each tick the session tries once to read this pose. It gets a
//     complete value or none, provided that only one process writes. If several processes write, or
//     a hostile one does, the session may get any numbers. Therefore the session checks each
//     number, and does not rely on TelemetryHand::count to ascend.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/faults.h"

namespace trocar {

inline constexpr const char* kTelemetrySchema = "trocar.live/1";
inline constexpr std::uint64_t kTelemetryVersion = 1;
/// Largest number of events that are kept; newer events replace the oldest.
inline constexpr std::size_t kTelemetryEvents = 4096;
inline constexpr std::size_t kMaxTelemetryColumns = 4096, kMaxTelemetrySheets = 64;

enum class TelemetryCommand : std::uint8_t {
  kStop,
  kPause,
  kResume,
  kZero,
  kRecover,
  kEmergencyStop,
  kXrayShot
};
inline constexpr std::size_t kTelemetryCommands = 7;
/// "stop", "pause", "resume", "zero", "recover", "emergency_stop", "xray_shot".
const char* to_string(TelemetryCommand command);

/// In parentheses: the members of TelemetryEvent that the event uses in addition to its time.
enum class TelemetryEventKind : std::uint8_t {
  kPuncture = 1,  ///< a sheet was punctured (sheet, slice, cut, positions and forces)
  kFault,         ///< a fault was detected (found)
  kNotRecovered,  ///< a requested recovery is delayed by the fault in `found` or, if that is kNone,
                  ///< because the tool is still in material (found, retract_distance_m)
  kRecovered,     ///< the session recovered (found: the fault that it recovered from)
  kCutShown,      ///< a new mesh of a sheet, with `cut` holes, was published (sheet, slice, cut)
  kPaused,        ///< time stopped
  kResumed,       ///< time runs again
  kEnded,         ///< the session ended (end; found: the fault latched at the end, if any)
  kHand,          ///< a live hand holds the tool
  kHandLetGo,     ///< the live hand let go
  kHandLost,      ///< the live hand was silent for too long, and counts as let go
  kXrayShot,      ///< an X-ray picture was taken
  kXrayOn,        ///< X-ray screening began
  kXrayOff,       ///< X-ray screening ended
  kBreakThrough,  ///< the tip broke through (sheet; slice: RecordingRow::break_through_at; tool_z_m;
                  ///< tip_N: RecordingRow::break_through_N)
  kRecoveryRefused,  ///< a request was refused and is not kept, because the device's stop is held
                     ///< (found: kEmergencyStop, or kLinkLost if it cannot tell its release)
  kSoftened,         ///< the guard softens the force, because the contact oscillates by itself
};
inline constexpr std::size_t kTelemetryEventKinds = 17;
/// "puncture", "fault", "not_recovered", "recovered", "cut_shown", "paused", "resumed", "ended",
/// "hand", "hand_let_go", "hand_lost", "xray_shot", "xray_on", "xray_off", "break_through",
/// "recovery_refused", "softened".
const char* to_string(TelemetryEventKind kind);

enum class TelemetryEnd : std::uint8_t { kDone, kInterrupted, kFault };
/// "done", "interrupted", "fault".
const char* to_string(TelemetryEnd end);

struct TelemetryEvent {
  std::uint64_t number = 0;  ///< counts from 1; the writer sets it
  TelemetryEventKind kind = TelemetryEventKind::kPuncture;
  TelemetryEnd end = TelemetryEnd::kDone;
  double t_s = 0;           ///< session time
  std::int32_t sheet = -1;  ///< index of the sheet, 0 for the topmost; -1: none
  std::int32_t slice = -1;  ///< AssetSlice::index of the sheet's slice; -1: none
  std::uint32_t cut = 0;    ///< number of the sheet's newest hole, counted from 1
  /// Of kPuncture. tip_N is RecordingRow::tip_N of the tick before. trial_force_N is the force that exceeded the threshold (glossary: trial force). With the force
  /// law `cutting`, trial_force_N is the largest strength of the slabs that were passed in this
  /// tick.
  double tool_z_m = 0, penetration_m = 0, tip_N = 0, trial_force_N = 0;
  double hand_N = 0;              ///< kPuncture: force on the hand in the tick before the puncture
  FaultDetail found{};            ///< fault and measured value, for the kinds that name `found`
  double retract_distance_m = 0;  ///< kNotRecovered: distance by which to retract the tool
};

/// The mesh of one sheet in {B}.
struct TelemetrySheet {
  std::uint32_t cuts = 0;  ///< number of holes cut during the session
  /// False if the mesh does not fit into the sheet's region of the memory. The memory then has no
  /// mesh of the sheet.
  bool is_shown = false;
  std::vector<float> xy_m;  ///< x and y for each vertex
  std::vector<float> hu;    ///< one value for each vertex; empty if the asset has no HU
  std::vector<std::uint32_t> triangles;  ///< three vertex indices for each triangle
};

/// The deformed sheet around the tool (force law `network`). If the tool has penetrated by the
/// depth d, the height of a vertex is z_m - d * w. Each vertex has its own w.
struct TelemetryShape {
  std::uint64_t version = 0;  ///< number of this write of the shape, counted from 1
  std::int32_t sheet = -1;
  std::uint32_t cuts = 0;
  double z_m = 0;
  bool is_shown = false;   ///< same meaning as TelemetrySheet::is_shown
  std::vector<float> xyw;  ///< x, y (m) and w for each vertex
  std::vector<std::uint32_t> triangles;
};

/// The target of a live hand, as another process has written it. The numbers are not validated and
/// may have any value.
struct TelemetryHand {
  std::uint64_t count = 0;  ///< changes with each message
  bool is_held = false;     ///< false: the hand has let go, and the numbers have no meaning
  /// Position of the tool's tip in {B}, m, and rotation vector of the plate in {B}, rad.
  std::array<double, 6> target{};
};

/// The sizes and counts that determine the size of the memory.
struct TelemetrySizes {
  struct Mesh {
    std::size_t vertices = 0, triangles = 0;
    bool has_hu = false;
  };
  std::string about;        ///< description of the session, JSON
  std::size_t columns = 0;  ///< number of values in a snapshot; a snapshot shows one tick
  /// Sizes of the sheets' initial meshes. The region of a sheet has space for twice its initial
  /// mesh plus 64 KiB.
  std::vector<Mesh> sheets{};
  bool has_shape = false;
  bool has_hand = false;  ///< the session has a live hand
};

/// The session's side of the memory. Three threads may write at the same time: one writes the
/// snapshots and events, one the sheets, one the shape.
class TelemetryWriter {
 public:
  /// Allocates all pages, and locks them in memory if the system allows it. Errors: kUnwritable if
  /// the memory cannot be allocated; kBug if a size is above its largest value.
  static Result<std::unique_ptr<TelemetryWriter>> make(const TelemetrySizes& sizes);
  /// Removes the link and frees the memory.
  ~TelemetryWriter();
  TelemetryWriter(const TelemetryWriter&) = delete;
  TelemetryWriter& operator=(const TelemetryWriter&) = delete;

  /// Atomically makes `file` a symbolic link to the memory. A link left by a process that has ended
  /// is replaced. Errors: kUnwritable if `file` exists and is not such a link, or if it belongs to
  /// a running session.
  Result<void> link(const std::filesystem::path& file);

  /// Publishes a snapshot. `values` must have TelemetrySizes::columns elements.
  void snapshot(std::span<const double> values) noexcept;
  /// Publishes the event and sets its number.
  void event(TelemetryEvent& event) noexcept;
  std::uint64_t last_event() const noexcept { return events_; }
  /// Skips `count` event numbers, so that readers notice that `count` events are lost.
  void lose_events(std::uint64_t count) noexcept;
  /// sheet() publishes the mesh of a sheet, shape() the deformed sheet. If a mesh does not fit into
  /// its region, no mesh is stored, and readers get is_shown = false.
  void sheet(std::size_t index, const TelemetrySheet& sheet) noexcept;
  void shape(const TelemetryShape& shape) noexcept;

  /// The counter of a command, modulo 2^64. If it changes, the command was given; the value itself
  /// has no meaning. Wait-free, for the haptic thread.
  std::uint64_t commands(TelemetryCommand command) const noexcept {
    return commands_[static_cast<std::size_t>(command)].load(std::memory_order_acquire);
  }

  /// The word of X-ray screening. The word is odd while a process requests screening. This process
  /// must add 2 to the word at least once a second, otherwise screening ends (telemetry.md).
  /// Wait-free, for the haptic thread.
  std::uint64_t screening() const noexcept {
    return commands_[kTelemetryCommands].load(std::memory_order_acquire);
  }

  /// Reads the live hand in one attempt. Returns false, and leaves `hand` unchanged, if nothing was
  /// written yet, a write is in progress, or the session has no live hand. Wait-free, for the
  /// haptic thread.
  bool hand(TelemetryHand& hand) const noexcept;

  /// The file descriptor of the memory.
  int fd() const noexcept { return fd_; }

 private:
  using Word = std::atomic<std::uint64_t>;
  struct Region {
    Word* words = nullptr;
    std::size_t data_words = 0;  ///< capacity of the region, words
    std::uint64_t sequence = 0;  ///< the writer's own count; the memory is not read back
  };
  struct MeshHead {
    std::size_t vertices;
    std::int32_t sheet;
    std::uint32_t cuts;
    double z_m;
  };
  static void write_mesh(Region& region, const MeshHead& head, std::span<const float> values,
                         std::span<const float> hu,
                         std::span<const std::uint32_t> triangles) noexcept;
  TelemetryWriter() = default;

  int fd_ = -1;
  void* memory_ = nullptr;
  std::size_t bytes_ = 0;
  std::filesystem::path link_, target_;
  Region snapshot_, shape_;
  std::vector<Region> sheets_;
  Word* event_words_ = nullptr;
  Word* commands_ = nullptr;
  const Word* hand_ = nullptr;  ///< null: the session has no live hand
  std::uint64_t events_ = 0;
};

/// Access to the memory for another process. Only one thread may use a reader.
class TelemetryReader {
 public:
  /// Opens the memory to which the link `file` leads. Errors: kRefused if there is no link, if its
  /// process has ended, if the memory is not that of a session or has an unknown version, or if a
  /// size or offset in the memory is impossible.
  static Result<std::unique_ptr<TelemetryReader>> open(const std::filesystem::path& file);
  ~TelemetryReader();
  TelemetryReader(const TelemetryReader&) = delete;
  TelemetryReader& operator=(const TelemetryReader&) = delete;

  /// The description of the session: JSON, not validated here (telemetry.md).
  std::string_view about() const noexcept { return about_; }
  std::size_t columns() const noexcept { return columns_; }
  std::size_t sheets() const noexcept { return sheets_.size(); }

  /// Reads the latest snapshot. Returns false and leaves `values` unchanged if there is no new
  /// snapshot since the last call, or if the snapshot was being written during every attempt.
  bool snapshot(std::vector<double>& values);

  enum class Next : std::uint8_t {
    kNone,
    kEvent,
    kLost,  ///< events before event.number were lost; the next call goes on with that event
  };
  /// Reads the next event. The first call begins with the oldest event that is kept. If the result
  /// is kLost, sets `lost` to the number of lost events.
  Next next_event(TelemetryEvent& event, std::uint64_t& lost);
  /// Makes next_event() continue after the event with the number `last`.
  void go_to_event(std::uint64_t last) noexcept { next_event_ = last + 1; }
  std::uint64_t last_event() const noexcept;

  /// A number that changes whenever the sheet is written; 0: not yet written.
  std::uint64_t sheet_version(std::size_t index) const noexcept;
  /// Reads a sheet. Returns false, and leaves `sheet` in an unspecified state, if there is no such
  /// sheet, if it was not yet written, if it was being written during every attempt, or if its
  /// numbers are impossible.
  bool sheet(std::size_t index, TelemetrySheet& sheet);
  /// A number that changes whenever the shape is written; 0: not yet written.
  std::uint64_t shape_version() const noexcept;
  /// Reads the shape. Returns false for the same reasons as sheet().
  bool shape(TelemetryShape& shape);

  /// False if the session's process has ended, normally or not.
  bool writer_is_alive() const noexcept;
  void command(TelemetryCommand command) noexcept;
  /// Switches X-ray screening on or off. Screening stays on for 1 s; to keep it on longer,
  /// call this function again within this time. Only one process may call this function during
  /// a session.
  void screen(bool is_held) noexcept;
  bool has_hand() const noexcept { return hand_ != nullptr; }
  /// Writes the live hand. Preconditions: has_hand() is true, and no other process writes
  /// the live hand.
  void hand(const TelemetryHand& hand) noexcept;

 private:
  using Word = std::atomic<std::uint64_t>;
  struct Region {
    const Word* words = nullptr;
    std::size_t data_words = 0;
  };
  TelemetryReader() = default;
  Result<void> map(const std::string& name);
  struct MeshCopy {
    std::array<std::uint64_t, 8> head;
    std::vector<std::uint32_t> values;
  };
  static bool read_mesh(const Region& region, std::size_t per_vertex, bool may_have_hu,
                        MeshCopy& mesh);

  int fd_ = -1;
  const void* memory_ = nullptr;
  std::size_t bytes_ = 0;
  void* command_page_ = nullptr;
  std::string about_;
  std::size_t columns_ = 0;
  Region snapshot_, shape_;
  std::vector<Region> sheets_;
  const Word* event_words_ = nullptr;
  Word* commands_ = nullptr;
  Word* hand_ = nullptr;
  std::uint64_t last_snapshot_ = 0;
  std::uint64_t next_event_ = 1;
};

}  // namespace trocar
