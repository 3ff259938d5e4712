// SPDX-License-Identifier: Apache-2.0
// The memory through which a running session is seen and commanded by other processes (trocar-run
// --live FILE). live_memory.md is its layout to the byte.
//
// Contract (tests/formats/session/live_memory_test.cpp):
//  1. The writer waits for no reader and takes nothing from the memory but the words of its
//     commands, which only count as "changed": whatever readers do, it goes on.
//  2. A reader gets whole values only, never an older one after a newer one, and gives up after a
//     bounded number of attempts, also if the writer was killed while it wrote.
//  3. Events have numbers from 1 on. A reader gets each one, or is told how many it lost.
//  4. A reader checks everything that it uses. It maps only the commands for writing. The memory is
//     sealed, so that neither side can be killed by the other making it shorter.
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
#include "formats/session/fault_words.h"

namespace trocar {

inline constexpr const char* kLiveSchema = "trocar.live/1";
inline constexpr std::uint64_t kLiveVersion = 1;
inline constexpr std::size_t kLiveEvents = 4096;  ///< the last ones are kept
inline constexpr std::size_t kMostLiveColumns = 4096, kMostLiveSheets = 64;

enum class LiveCommand : std::uint8_t { kStop, kPause, kResume, kZero, kRecover, kEmergencyStop };
inline constexpr std::size_t kLiveCommands = 6;
/// "stop", "pause", "resume", "zero", "recover", "emergency_stop".
const char* to_string(LiveCommand command);

enum class LiveEventKind : std::uint8_t {
  kPuncture = 1,  ///< sheet, slice, cut, tool_z_m, penetration_m, force_N, judged_force_N
  kFault,         ///< found
  kNotRecovered,  ///< found (its fault kNone: the tool is in material, by lift_m)
  kRecovered,     ///< found: its fault, from which
  kCutShown,      ///< sheet, slice, cut: the sheet's mesh in the memory has so many holes
  kPaused,        ///< time stands still
  kResumed,       ///< time goes on
  kEnded,         ///< end; found: its fault, latched at the end
};
/// "puncture", "fault", "not_recovered", "recovered", "cut_shown", "paused", "resumed", "ended".
const char* to_string(LiveEventKind kind);

enum class LiveEnd : std::uint8_t { kDone, kInterrupted, kFault };
/// "done", "interrupted", "fault".
const char* to_string(LiveEnd end);

struct LiveEvent {
  std::uint64_t number = 0;  ///< from 1 on; the writer sets it
  LiveEventKind kind = LiveEventKind::kPuncture;
  LiveEnd end = LiveEnd::kDone;
  double t_s = 0;           ///< of the session
  std::int32_t sheet = -1;  ///< the topmost is 0
  std::int32_t slice = -1;  ///< AssetSlice::index
  std::uint32_t cut = 0;    ///< number of the hole in this sheet, from 1
  double tool_z_m = 0, penetration_m = 0, force_N = 0, judged_force_N = 0;
  FaultDetail found;
  double lift_m = 0;
};

/// The mesh of one sheet in {B}.
struct LiveSheet {
  std::uint32_t cuts = 0;                ///< holes in it that the asset's slice does not have
  bool is_shown = false;                 ///< false: it did not fit into its part; there is no mesh
  std::vector<float> xy_m;               ///< x, y of each vertex
  std::vector<float> hu;                 ///< of each vertex; empty: the asset has none
  std::vector<std::uint32_t> triangles;  ///< three vertices each
};

/// The sheet around the tool (force law `network`). With the tool at depth d a vertex has the
/// height z_m - d w.
struct LiveShape {
  std::uint64_t version = 0;  ///< counts shapes
  std::int32_t sheet = -1;
  std::uint32_t cuts = 0;
  double z_m = 0;
  bool is_shown = false;   ///< as LiveSheet
  std::vector<float> xyw;  ///< x, y (m), w of each vertex
  std::vector<std::uint32_t> triangles;
};

/// What the memory must hold.
struct LiveSizes {
  struct Mesh {
    std::size_t vertices = 0, triangles = 0;
    bool has_hu = false;
  };
  std::string about;         ///< JSON
  std::size_t columns = 0;   ///< numbers of a snapshot
  std::vector<Mesh> sheets;  ///< as they are first; there is room for twice as much and 64 KiB
  bool has_shape = false;
};

/// The session's side. Not thread-safe, but its parts may be written by different threads: the
/// snapshot and events by one, sheets by one, the shape by one.
class LiveWriter {
 public:
  /// All pages are there afterwards, and locked where that is allowed. Unwritable: no memory.
  static Result<std::unique_ptr<LiveWriter>> make(const LiveSizes& sizes);
  /// Removes the link.
  ~LiveWriter();
  LiveWriter(const LiveWriter&) = delete;
  LiveWriter& operator=(const LiveWriter&) = delete;

  /// Makes `file` a symbolic link to the memory, at once as a whole. A link to the memory of a
  /// process that has ended is replaced. Unwritable: there is another file, or the link of a
  /// session that runs.
  Result<void> link(const std::filesystem::path& file);

  /// As many numbers as columns.
  void snapshot(std::span<const double> values) noexcept;
  /// Sets its number.
  void event(LiveEvent& event) noexcept;
  std::uint64_t last_event() const noexcept { return events_; }
  /// Leaves out numbers, which readers take for lost events.
  void lose_events(std::uint64_t count) noexcept;
  /// Without the mesh (is_shown false) if it does not fit.
  void sheet(std::size_t index, const LiveSheet& sheet) noexcept;
  void shape(const LiveShape& shape) noexcept;

  /// How often a command was given, modulo 2^64: only differences mean something. Wait-free, for
  /// the haptic thread.
  std::uint64_t commands(LiveCommand command) const noexcept {
    return commands_[static_cast<std::size_t>(command)].load(std::memory_order_acquire);
  }

  int fd() const noexcept { return fd_; }  ///< of the memory

 private:
  using Word = std::atomic<std::uint64_t>;
  struct Part {
    Word* words = nullptr;
    std::size_t data_words = 0;  ///< capacity
    std::uint64_t sequence = 0;  ///< never read back from the memory
  };
  LiveWriter() = default;

  int fd_ = -1;
  void* memory_ = nullptr;
  std::size_t bytes_ = 0;
  std::filesystem::path link_, target_;
  Part snapshot_, shape_;
  std::vector<Part> sheets_;
  Word* event_words_ = nullptr;
  Word* commands_ = nullptr;
  std::uint64_t events_ = 0;
};

/// Another process's side, from one thread.
class LiveReader {
 public:
  /// `file`: the link. Refused: there is none or its process has ended; not such a memory; another
  /// version; a size or place in it that is not possible.
  static Result<std::unique_ptr<LiveReader>> open(const std::filesystem::path& file);
  ~LiveReader();
  LiveReader(const LiveReader&) = delete;
  LiveReader& operator=(const LiveReader&) = delete;

  /// JSON, live_memory.md; not checked.
  std::string_view about() const noexcept { return about_; }
  std::size_t columns() const noexcept { return columns_; }
  std::size_t sheets() const noexcept { return sheets_.size(); }

  /// False, and `values` is unchanged: none since the last call, or it was being written all the
  /// time.
  bool snapshot(std::vector<double>& values);

  enum class Next : std::uint8_t {
    kNone,
    kEvent,
    kLost,  ///< event.number - 1 is the last of those lost; next_event() goes on with event.number
  };
  /// The first is the oldest that is kept. `lost`: how many, with kLost.
  Next next_event(LiveEvent& event, std::uint64_t& lost);
  /// Continue after this event.
  void go_to_event(std::uint64_t last) noexcept { next_event_ = last + 1; }
  std::uint64_t last_event() const noexcept;

  /// Changes whenever the sheet was written; 0: not yet.
  std::uint64_t sheet_version(std::size_t index) const noexcept;
  /// False, and `sheet` is not to be used: no such sheet, or it was being written all the time.
  bool sheet(std::size_t index, LiveSheet& sheet);
  /// Changes whenever the shape was written; 0: not yet.
  std::uint64_t shape_version() const noexcept;
  /// False: none yet, or as sheet().
  bool shape(LiveShape& shape);

  /// False: the process has ended, whether it was killed or not.
  bool writer_is_alive() const noexcept;
  void command(LiveCommand command) noexcept;

 private:
  using Word = std::atomic<std::uint64_t>;
  struct Part {
    const Word* words = nullptr;
    std::size_t data_words = 0;
  };
  LiveReader() = default;
  Result<void> map(const std::string& name);
  struct MeshCopy {
    std::array<std::uint64_t, 8> head;
    std::vector<std::uint32_t> values;
  };
  static bool read_mesh(const Part& part, std::size_t of_vertex, bool may_have_hu, MeshCopy& mesh);

  int fd_ = -1;
  const void* memory_ = nullptr;
  std::size_t bytes_ = 0;
  void* command_page_ = nullptr;
  std::string about_;
  std::size_t columns_ = 0;
  Part snapshot_, shape_;
  std::vector<Part> sheets_;
  const Word* event_words_ = nullptr;
  Word* commands_ = nullptr;
  std::uint64_t seen_snapshot_ = 0;
  std::uint64_t next_event_ = 1;
};

}  // namespace trocar
