// SPDX-License-Identifier: Apache-2.0
#include "formats/session/telemetry.h"

#include <fcntl.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <algorithm>
#include <bit>
#include <climits>
#include <cstdio>
#include <cstring>

namespace trocar {
namespace {

// The layout of shared-memory telemetry (telemetry.md), used by writer and reader. The memory
// consists of 64-bit words.

using Word = std::atomic<std::uint64_t>;
static_assert(sizeof(Word) == 8 && Word::is_always_lock_free);
static_assert(std::endian::native == std::endian::little);

/// Word numbers in the header.
enum Header : std::size_t {
  kMagic,
  kVersion,
  kBytes,
  kAboutOffset,
  kAboutBytes,
  kSnapshotOffset,
  kColumns,
  kShapeOffset,
  kShapeWords,
  kDirectoryOffset,
  kSheets,
  kEventsOffset,
  kEventSlots,
  kCommandsOffset,
  kHandOffset,
  kHandSize,
  kHeaderWords = 16
};
constexpr std::uint64_t kMagicWord =
    std::bit_cast<std::uint64_t>(std::array<char, 8>{'T', 'R', 'C', 'R', 'L', 'I', 'V', 'E'});

/// Word numbers in the head of a mesh. The vertices and triangles of the mesh follow the head.
enum Mesh : std::size_t {
  kSequence,
  kMeshVersion,
  kFlags,
  kVertices,
  kTriangles,
  kMeshSheet,
  kMeshCuts,
  kHeight,
  kMeshHead
};
constexpr std::uint64_t kIsShown = 1, kHasHu = 2;  ///< bits of kFlags
/// Word numbers in the region of the live hand, which follows the commands in the same kPage bytes.
enum Hand : std::size_t {
  kHandSequence,
  kHandCount,
  kHandHeld,
  kHandPose,
  kHandWords = kHandPose + 6
};
constexpr std::size_t kHandInPage = 64;  ///< offset of the hand's region in the page, bytes

/// Number of words of an event, and of the head that precedes the first event.
constexpr std::size_t kEventWords = 16, kEventsHead = 8;

constexpr std::size_t kPage = 4096;
constexpr std::uint64_t kMaxBytes = std::uint64_t{1} << 34;
constexpr std::uint64_t kMaxAbout = std::uint64_t{1} << 24;
constexpr int kSeals = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL;

std::uint64_t word_of(double x) {
  return std::bit_cast<std::uint64_t>(x);
}
double number_in(std::uint64_t word) {
  return std::bit_cast<double>(word);
}
/// The integer is sign-extended to 64 bits.
std::uint64_t word_of(std::int32_t x) {
  return static_cast<std::uint64_t>(std::int64_t{x});
}
std::int32_t int_in(std::uint64_t word) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(word));
}

/// The argument of fcntl() for a write lock on all bytes of a file.
struct flock whole_file() {
  struct flock lock {};
  lock.l_type = F_WRLCK;
  lock.l_whence = SEEK_SET;
  return lock;
}

/// The text of a symbolic link; empty if `file` is not a symbolic link.
std::string read_link(const std::filesystem::path& file) {
  std::array<char, PATH_MAX> text;
  const ssize_t size = ::readlink(file.c_str(), text.data(), text.size());
  return size <= 0 ? std::string() : std::string(text.data(), static_cast<std::size_t>(size));
}

/// Returns true if the text of a link has the form that TelemetryWriter::link() writes,
/// "/proc/PID/fd/N".
bool is_session_link(const std::string& target) {
  int pid = 0, fd = 0, end = 0;
  return std::sscanf(target.c_str(), "/proc/%9d/fd/%9d%n", &pid, &fd, &end) == 2 &&
         static_cast<std::size_t>(end) == target.size() && pid > 0 && fd >= 0;
}

// A reader gives up after this many attempts to read a value that is being written.
constexpr int kAttempts = 200;

std::vector<float> floats(std::span<const std::uint32_t> values) {
  std::vector<float> result(values.size());
  std::transform(values.begin(), values.end(), result.begin(),
                 [](std::uint32_t bits) { return std::bit_cast<float>(bits); });
  return result;
}

constexpr std::size_t kSpareBytes = std::size_t{64} << 10;

constexpr std::size_t words_for(std::size_t bytes) {
  return (bytes + 7) / 8;
}
constexpr std::size_t aligned(std::size_t bytes, std::size_t to) {
  return (bytes + to - 1) / to * to;
}

/// Stores values of 32 bits, two to a word.
class Packer {
 public:
  explicit Packer(Word* to) : to_(to) {}
  void put(std::uint32_t value) noexcept {
    if (is_second_)
      to_++->store(low_ | std::uint64_t{value} << 32U, std::memory_order_release);
    else
      low_ = value;
    is_second_ = !is_second_;
  }
  void finish() noexcept {
    if (is_second_) put(0);
  }

 private:
  Word* to_;
  std::uint64_t low_ = 0;
  bool is_second_ = false;
};

std::size_t mesh_words(std::size_t vertices, std::size_t per_vertex, std::size_t triangles) {
  return words_for(4 * (vertices * per_vertex + 3 * triangles));
}

// The offsets of all regions of the memory. The header also states the size of the memory.
struct Layout {
  std::array<std::uint64_t, kHeaderWords> header{};
  // Offset and capacity, in words, of each sheet.
  std::vector<std::pair<std::size_t, std::size_t>> directory;
};
Layout layout_of(const TelemetrySizes& sizes) {
  Layout out;
  std::size_t end = sizeof out.header;
  const auto reserve = [&end](std::size_t bytes) {
    const std::size_t at = end;
    end += aligned(bytes, 64);
    return at;
  };
  auto& header = out.header;
  header[kMagic] = kMagicWord;
  header[kVersion] = kTelemetryVersion;
  header[kAboutOffset] = reserve(sizes.about.size());
  header[kAboutBytes] = sizes.about.size();
  header[kSnapshotOffset] = reserve(8 * (1 + sizes.columns));
  header[kColumns] = sizes.columns;
  header[kDirectoryOffset] = reserve(16 * sizes.sheets.size());
  header[kSheets] = sizes.sheets.size();
  header[kEventsOffset] = reserve(8 * (kEventsHead + kTelemetryEvents * kEventWords));
  header[kEventSlots] = kTelemetryEvents;
  std::size_t shape_words = 0;
  for (const TelemetrySizes::Mesh& mesh : sizes.sheets) {
    const auto capacity = [&](std::size_t per_vertex) {
      return 2 * mesh_words(mesh.vertices, per_vertex, mesh.triangles) + kSpareBytes / 8;
    };
    out.directory.emplace_back(0, capacity(mesh.has_hu ? 3 : 2));
    out.directory.back().first = reserve(8 * (kMeshHead + out.directory.back().second));
    if (sizes.has_shape) shape_words = std::max(shape_words, capacity(3));
  }
  if (sizes.has_shape) {
    header[kShapeOffset] = reserve(8 * (kMeshHead + shape_words));
    header[kShapeWords] = shape_words;
  }
  end = aligned(end, kPage);
  header[kCommandsOffset] = reserve(kPage);
  if (sizes.has_hand) {
    header[kHandOffset] = header[kCommandsOffset] + kHandInPage;
    header[kHandSize] = kHandWords;
  }
  header[kBytes] = end;
  return out;
}

}  // namespace

const char* to_string(TelemetryCommand command) {
  constexpr std::array kNames{"stop",    "pause",          "resume",   "zero",
                              "recover", "emergency_stop", "xray_shot"};
  static_assert(kNames.size() == kTelemetryCommands);
  return kNames.at(static_cast<std::size_t>(command));
}

const char* to_string(TelemetryEventKind kind) {
  constexpr std::array kNames{
      "puncture", "fault",    "not_recovered", "recovered",        "cut_shown", "paused",
      "resumed",  "ended",    "hand",          "hand_let_go",      "hand_lost", "xray_shot",
      "xray_on",  "xray_off", "break_through", "recovery_refused", "softened"};
  static_assert(kNames.size() == kTelemetryEventKinds);
  return kNames.at(static_cast<std::size_t>(kind) - 1);
}

const char* to_string(TelemetryEnd end) {
  constexpr std::array kNames{"done", "interrupted", "fault"};
  return kNames.at(static_cast<std::size_t>(end));
}

Result<std::unique_ptr<TelemetryReader>> TelemetryReader::open(const std::filesystem::path& file) {
  const std::string name = file.string();
  std::unique_ptr<TelemetryReader> reader(new TelemetryReader());
  reader->fd_ = ::open(file.c_str(), O_RDWR | O_CLOEXEC | O_NOCTTY | O_NONBLOCK);
  if (reader->fd_ < 0) {
    const int error = errno;
    if (error == ENOENT && is_session_link(read_link(file)))
      return refused(name + ": its session has ended");
    return refused(name + ": " + system_message(error));
  }
  if (Result<void> mapped = reader->map(name); !mapped) return mapped.error();
  return reader;
}

TelemetryReader::~TelemetryReader() {
  if (memory_ != nullptr) ::munmap(const_cast<void*>(memory_), bytes_);
  if (command_page_ != nullptr) ::munmap(command_page_, kPage);
  if (fd_ >= 0) ::close(fd_);
}

Result<void> TelemetryReader::map(const std::string& name) {
  const auto no = [&](const std::string& what) {
    return refused(name + ": not the memory of a session: " + what);
  };
  struct stat status {};
  if (::fstat(fd_, &status) != 0) return no(system_message(errno));
  const int seals = ::fcntl(fd_, F_GET_SEALS);
  if (!S_ISREG(status.st_mode) || seals < 0) return no("not a memfd");
  if ((seals & kSeals) != kSeals) return no("it is not sealed");
  const auto size = static_cast<std::uint64_t>(status.st_size);
  if (size < 2 * kPage || size > kMaxBytes || size % kPage != 0)
    return no("its size of " + std::to_string(size) + " bytes is not possible");
  void* memory = ::mmap(nullptr, size, PROT_READ, MAP_SHARED, fd_, 0);
  if (memory == MAP_FAILED) return no("mmap: " + system_message(errno));
  memory_ = memory;
  bytes_ = size;

  const auto words_at = [&](std::uint64_t offset) {
    return reinterpret_cast<const Word*>(static_cast<const char*>(memory) + offset);
  };
  std::array<std::uint64_t, kHeaderWords> header;
  for (std::size_t i = 0; i < kHeaderWords; ++i)
    header[i] = words_at(0)[i].load(std::memory_order_acquire);
  if (header[kMagic] != kMagicWord) return no("it does not begin with TRCRLIVE");
  if (header[kVersion] != kTelemetryVersion)
    return refused(name + ": is of version " + std::to_string(header[kVersion]) +
                   "; this program reads version " + std::to_string(kTelemetryVersion));
  if (header[kBytes] != size) return no("its size differs from the one that its header states");
  const auto is_inside = [&](std::uint64_t offset, std::uint64_t bytes) {
    return offset % 8 == 0 && offset >= sizeof header && offset <= size && bytes <= size - offset;
  };
  if (header[kAboutBytes] > kMaxAbout || !is_inside(header[kAboutOffset], header[kAboutBytes]))
    return no("its description is not inside it");
  if (header[kColumns] > kMaxTelemetryColumns ||
      !is_inside(header[kSnapshotOffset], 8 * (1 + header[kColumns])))
    return no("its snapshot is not inside it");
  if (header[kSheets] > kMaxTelemetrySheets ||
      !is_inside(header[kDirectoryOffset], 16 * header[kSheets]))
    return no("its list of sheets is not inside it");
  if (header[kEventSlots] != kTelemetryEvents ||
      !is_inside(header[kEventsOffset], 8 * (kEventsHead + kTelemetryEvents * kEventWords)))
    return no("its events are not inside it");
  if (header[kCommandsOffset] % kPage != 0 || !is_inside(header[kCommandsOffset], kPage))
    return no("its commands are not inside it");
  if (header[kHandOffset] != 0 && (header[kHandOffset] != header[kCommandsOffset] + kHandInPage ||
                                   header[kHandSize] != kHandWords))
    return no("its hand is not behind its commands");
  const auto mesh_region = [&](std::uint64_t offset, std::uint64_t words, Region& region) {
    if (words > kMaxBytes / 8 || !is_inside(offset, 8 * (kMeshHead + words))) return false;
    region = {words_at(offset), words};
    return true;
  };
  if (header[kShapeOffset] != 0 && !mesh_region(header[kShapeOffset], header[kShapeWords], shape_))
    return no("its shape is not inside it");
  for (std::size_t i = 0; i < header[kSheets]; ++i) {
    const Word* entry = words_at(header[kDirectoryOffset]) + 2 * i;
    const std::uint64_t offset = entry[0].load(std::memory_order_acquire);
    const std::uint64_t words = entry[1].load(std::memory_order_acquire);
    if (!mesh_region(offset, words, sheets_.emplace_back()))
      return no("sheet " + std::to_string(i) + " is not inside it");
  }
  void* page = ::mmap(nullptr, kPage, PROT_READ | PROT_WRITE, MAP_SHARED, fd_,
                      static_cast<off_t>(header[kCommandsOffset]));
  if (page == MAP_FAILED) return no("mmap: " + system_message(errno));
  command_page_ = page;
  commands_ = static_cast<Word*>(page);
  if (header[kHandOffset] != 0) hand_ = commands_ + kHandInPage / sizeof(Word);
  about_.assign(static_cast<const char*>(memory) + header[kAboutOffset], header[kAboutBytes]);
  columns_ = header[kColumns];
  snapshot_ = {words_at(header[kSnapshotOffset]), columns_};
  event_words_ = words_at(header[kEventsOffset]);
  return {};
}

bool TelemetryReader::snapshot(std::vector<double>& values) {
  const Word* words = snapshot_.words;
  std::vector<double> found(columns_);
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const std::uint64_t sequence = words[0].load(std::memory_order_acquire);
    if (sequence == last_snapshot_) return false;
    if (sequence % 2 != 0) {
      ::sched_yield();
      continue;
    }
    for (std::size_t i = 0; i < columns_; ++i)
      found[i] = number_in(words[1 + i].load(std::memory_order_acquire));
    if (words[0].load(std::memory_order_acquire) != sequence) continue;
    last_snapshot_ = sequence;
    values = std::move(found);
    return true;
  }
  return false;
}

std::uint64_t TelemetryReader::last_event() const noexcept {
  return event_words_[0].load(std::memory_order_acquire);
}

TelemetryReader::Next TelemetryReader::next_event(TelemetryEvent& event, std::uint64_t& lost) {
  const std::uint64_t number = next_event_, last = last_event();
  if (last < number) return Next::kNone;
  const auto lose_to = [&](std::uint64_t next) {
    lost = next - number;
    next_event_ = next;
    event = {};
    event.number = next;
    return Next::kLost;
  };
  // The slot of the next event may be in the middle of a write.
  const auto lapped = [&](std::uint64_t newest) {
    return lose_to(newest > kTelemetryEvents ? std::max(number + 1, newest - kTelemetryEvents + 2)
                                             : number + 1);
  };
  if (last - number >= kTelemetryEvents) return lapped(last);
  const Word* slot = event_words_ + kEventsHead + (number - 1) % kTelemetryEvents * kEventWords;
  std::array<std::uint64_t, kEventWords> values;
  for (std::size_t i = 0; i < kEventWords; ++i)
    values[i] = slot[i].load(std::memory_order_acquire);
  if (values[0] != 2 * number || slot[0].load(std::memory_order_acquire) != 2 * number)
    return lapped(last_event());
  const auto kind = static_cast<TelemetryEventKind>(values[1]);
  TelemetryEvent found{.number = number,
                       .kind = kind,
                       .t_s = number_in(values[2]),
                       .sheet = int_in(values[3]),
                       .slice = int_in(values[4])};
  const bool has_end = kind == TelemetryEventKind::kEnded;
  if (has_end)
    found.end = static_cast<TelemetryEnd>(values[5]);
  else
    found.cut = static_cast<std::uint32_t>(values[5]);
  found.tool_z_m = number_in(values[6]);
  found.penetration_m = number_in(values[7]);
  found.tip_N = number_in(values[8]);
  found.trial_force_N = number_in(values[9]);
  const auto index = static_cast<std::int64_t>(values[12]);
  const bool is_possible =
      values[1] >= 1 && values[1] <= kTelemetryEventKinds &&
      (!has_end || values[5] <= static_cast<std::uint64_t>(TelemetryEnd::kFault)) &&
      values[10] < kFaults && values[11] < kFaultQuantities && index >= -1 && index < 16;
  if (!is_possible) return lose_to(number + 1);
  found.found = FaultDetail(static_cast<Fault>(values[10]), static_cast<FaultQuantity>(values[11]),
                            static_cast<int>(index), number_in(values[13]), number_in(values[14]));
  (kind == TelemetryEventKind::kPuncture ? found.hand_N : found.retract_distance_m) =
      number_in(values[15]);
  if (!is_known(found.found)) return lose_to(number + 1);
  event = found;
  next_event_ = number + 1;
  return Next::kEvent;
}

std::uint64_t TelemetryReader::sheet_version(std::size_t index) const noexcept {
  if (index >= sheets_.size()) return 0;
  return sheets_[index].words[kSequence].load(std::memory_order_acquire) / 2;
}

std::uint64_t TelemetryReader::shape_version() const noexcept {
  if (shape_.words == nullptr) return 0;
  return shape_.words[kSequence].load(std::memory_order_acquire) / 2;
}

bool TelemetryReader::read_mesh(const Region& region, std::size_t per_vertex, bool may_have_hu,
                                MeshCopy& mesh) {
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const std::uint64_t sequence = region.words[kSequence].load(std::memory_order_acquire);
    if (sequence == 0) return false;
    if (sequence % 2 != 0) {
      ::sched_yield();
      continue;
    }
    for (std::size_t i = 0; i < kMeshHead; ++i)
      mesh.head[i] = region.words[i].load(std::memory_order_acquire);
    const std::uint64_t vertices = mesh.head[kVertices], triangles = mesh.head[kTriangles];
    const bool has_hu = may_have_hu && (mesh.head[kFlags] & kHasHu) != 0;
    const std::size_t numbers = per_vertex + (has_hu ? 1 : 0);
    const std::uint64_t max_values = 2 * region.data_words;  // of 32 bits each
    const bool fits = vertices <= max_values / numbers && triangles <= max_values / 3 &&
                      vertices * numbers + 3 * triangles <= max_values;
    if (fits) {
      mesh.values.resize(vertices * numbers + 3 * triangles);
      for (std::size_t i = 0; i < mesh.values.size(); i += 2) {
        const std::uint64_t word = region.words[kMeshHead + i / 2].load(std::memory_order_acquire);
        mesh.values[i] = static_cast<std::uint32_t>(word);
        if (i + 1 < mesh.values.size())
          mesh.values[i + 1] = static_cast<std::uint32_t>(word >> 32U);
      }
    }
    if (region.words[kSequence].load(std::memory_order_acquire) != sequence) continue;
    const auto first_triangle =
        mesh.values.begin() + static_cast<std::ptrdiff_t>(fits ? vertices * numbers : 0);
    return fits && std::all_of(first_triangle, mesh.values.end(),
                               [&](std::uint32_t v) { return v < vertices; });
  }
  return false;
}

bool TelemetryReader::sheet(std::size_t index, TelemetrySheet& sheet) {
  MeshCopy mesh;
  if (index >= sheets_.size() || !read_mesh(sheets_[index], 2, true, mesh)) return false;
  const std::uint64_t vertices = mesh.head[kVertices];
  const std::span<const std::uint32_t> values = mesh.values;
  const std::size_t hu = (mesh.head[kFlags] & kHasHu) != 0 ? vertices : 0;
  sheet.cuts = static_cast<std::uint32_t>(mesh.head[kMeshCuts]);
  sheet.is_shown = (mesh.head[kFlags] & kIsShown) != 0;
  sheet.xy_m = floats(values.first(2 * vertices));
  sheet.hu = floats(values.subspan(2 * vertices, hu));
  const auto triangles = values.subspan(2 * vertices + hu);
  sheet.triangles.assign(triangles.begin(), triangles.end());
  return true;
}

bool TelemetryReader::shape(TelemetryShape& shape) {
  MeshCopy mesh;
  if (shape_.words == nullptr || !read_mesh(shape_, 3, false, mesh)) return false;
  const std::uint64_t vertices = mesh.head[kVertices];
  const std::span<const std::uint32_t> values = mesh.values;
  shape.version = mesh.head[kMeshVersion];
  shape.sheet = int_in(mesh.head[kMeshSheet]);
  shape.cuts = static_cast<std::uint32_t>(mesh.head[kMeshCuts]);
  shape.z_m = number_in(mesh.head[kHeight]);
  shape.is_shown = (mesh.head[kFlags] & kIsShown) != 0;
  shape.xyw = floats(values.first(3 * vertices));
  const auto triangles = values.subspan(3 * vertices);
  shape.triangles.assign(triangles.begin(), triangles.end());
  return true;
}

bool TelemetryReader::writer_is_alive() const noexcept {
  struct flock lock = whole_file();
  return ::fcntl(fd_, F_OFD_GETLK, &lock) == 0 && lock.l_type != F_UNLCK;
}

void TelemetryReader::screen(bool is_held) noexcept {
  Word& word = commands_[kTelemetryCommands];
  const std::uint64_t now = word.load(std::memory_order_acquire);
  word.store(is_held ? (now | 1) + 2 : (now & ~std::uint64_t{1}) + 2, std::memory_order_release);
}

void TelemetryReader::command(TelemetryCommand command) noexcept {
  commands_[static_cast<std::size_t>(command)].fetch_add(1, std::memory_order_acq_rel);
}

void TelemetryReader::hand(const TelemetryHand& hand) noexcept {
  // A process that ended in the middle of a write has left an odd sequence.
  const std::uint64_t sequence = hand_[kHandSequence].load(std::memory_order_acquire) | 1U;
  hand_[kHandSequence].store(sequence, std::memory_order_release);
  hand_[kHandCount].store(hand.count, std::memory_order_release);
  hand_[kHandHeld].store(hand.is_held ? 1 : 0, std::memory_order_release);
  for (std::size_t i = 0; i < hand.target.size(); ++i)
    hand_[kHandPose + i].store(word_of(hand.target[i]), std::memory_order_release);
  hand_[kHandSequence].store(sequence + 1, std::memory_order_release);
}

Result<std::unique_ptr<TelemetryWriter>> TelemetryWriter::make(const TelemetrySizes& sizes) {
  if (sizes.columns > kMaxTelemetryColumns || sizes.sheets.size() > kMaxTelemetrySheets ||
      sizes.about.size() > kMaxAbout)
    return bug("shared-memory telemetry: too many columns or sheets, or too long a description");
  const auto [header, directory] = layout_of(sizes);
  const std::size_t bytes = header[kBytes];
  std::unique_ptr<TelemetryWriter> writer(new TelemetryWriter());
  const auto failed = [&](const char* what, int error) {
    return unwritable("shared memory of " + std::to_string(bytes) + " bytes: " + what + ": " +
                      system_message(error));
  };
  writer->fd_ = ::memfd_create("trocar-live", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (writer->fd_ < 0) return failed("memfd_create", errno);
  if (const int error = ::posix_fallocate(writer->fd_, 0, static_cast<off_t>(bytes)); error != 0)
    return failed("cannot be allocated", error);
  if (::fcntl(writer->fd_, F_ADD_SEALS, kSeals) != 0) return failed("seals", errno);
  struct flock lock = whole_file();
  if (::fcntl(writer->fd_, F_OFD_SETLK, &lock) != 0) return failed("lock", errno);
  void* memory =
      ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, writer->fd_, 0);
  if (memory == MAP_FAILED) return failed("mmap", errno);
  writer->memory_ = memory;
  writer->bytes_ = bytes;
  // If locking is not allowed, the pages are resident anyway, but may be swapped out.
  (void)::mlock(memory, bytes);

  const auto words_at = [&](std::size_t offset) {
    return reinterpret_cast<Word*>(static_cast<char*>(memory) + offset);
  };
  std::memcpy(static_cast<char*>(memory) + header[kAboutOffset], sizes.about.data(),
              sizes.about.size());
  writer->snapshot_ = {words_at(header[kSnapshotOffset]), sizes.columns, 0};
  writer->event_words_ = words_at(header[kEventsOffset]);
  writer->commands_ = words_at(header[kCommandsOffset]);
  if (sizes.has_hand) writer->hand_ = words_at(header[kHandOffset]);
  if (sizes.has_shape) writer->shape_ = {words_at(header[kShapeOffset]), header[kShapeWords], 0};
  for (std::size_t i = 0; i < directory.size(); ++i) {
    const auto [offset, words] = directory[i];
    writer->sheets_.push_back({words_at(offset), words, 0});
    words_at(header[kDirectoryOffset])[2 * i].store(offset, std::memory_order_release);
    words_at(header[kDirectoryOffset])[2 * i + 1].store(words, std::memory_order_release);
  }
  // The magic comes last, so that a reader finds either nothing or a complete header.
  for (std::size_t i = kHeaderWords; i-- > 0;)
    words_at(0)[i].store(header[i], std::memory_order_release);
  return writer;
}

TelemetryWriter::~TelemetryWriter() {
  if (!link_.empty() && read_link(link_) == target_) ::unlink(link_.c_str());
  if (memory_ != nullptr) ::munmap(memory_, bytes_);
  if (fd_ >= 0) ::close(fd_);
}

Result<void> TelemetryWriter::link(const std::filesystem::path& file) {
  const std::string name = file.string();
  target_ = "/proc/" + std::to_string(::getpid()) + "/fd/" + std::to_string(fd_);
  std::error_code error;
  const std::filesystem::file_status old = std::filesystem::symlink_status(file, error);
  if (old.type() != std::filesystem::file_type::not_found) {
    const std::string target = read_link(file);
    if (!is_session_link(target))
      return unwritable(name + ": exists and is not the link of a session; remove it");
    const auto other = TelemetryReader::open(file);
    if (other && (*other)->writer_is_alive())
      return unwritable(name + ": it belongs to a running session (" + target +
                        "); end it or name another file");
    // The link may lead nowhere or to another file, because the process number may have been
    // reused.
    if (!other && ::access(file.c_str(), F_OK) != 0 && errno != ENOENT)
      return unwritable(name + ": what it links to cannot be checked: " + system_message(errno) +
                        "; remove it if no session runs");
  }
  std::filesystem::path temporary = file;
  temporary += std::to_string(::getpid()).insert(0, 1, '.') + ".new";
  ::unlink(temporary.c_str());
  if (::symlink(target_.c_str(), temporary.c_str()) != 0)
    return unwritable(name + ": " + system_message(errno));
  if (::rename(temporary.c_str(), file.c_str()) != 0) {
    const int reason = errno;
    ::unlink(temporary.c_str());
    return unwritable(name + ": " + system_message(reason));
  }
  link_ = std::filesystem::absolute(file, error);
  return {};
}

void TelemetryWriter::snapshot(std::span<const double> values) noexcept {
  Word* words = snapshot_.words;
  words[0].store(++snapshot_.sequence, std::memory_order_release);
  const std::size_t count = std::min(values.size(), snapshot_.data_words);
  for (std::size_t i = 0; i < count; ++i)
    words[1 + i].store(word_of(values[i]), std::memory_order_release);
  words[0].store(++snapshot_.sequence, std::memory_order_release);
}

void TelemetryWriter::event(TelemetryEvent& event) noexcept {
  event.number = ++events_;
  const FaultDetail& found = event.found;
  const bool has_end = event.kind == TelemetryEventKind::kEnded;
  const std::array<std::uint64_t, kEventWords> values = {
      2 * events_,
      static_cast<std::uint64_t>(event.kind),
      word_of(event.t_s),
      word_of(event.sheet),
      word_of(event.slice),
      has_end ? static_cast<std::uint64_t>(event.end) : event.cut,
      word_of(event.tool_z_m),
      word_of(event.penetration_m),
      word_of(event.tip_N),
      word_of(event.trial_force_N),
      static_cast<std::uint64_t>(found.fault),
      static_cast<std::uint64_t>(found.quantity),
      word_of(std::int32_t{found.index}),
      word_of(found.value),
      word_of(found.limit),
      word_of(event.kind == TelemetryEventKind::kPuncture ? event.hand_N
                                                          : event.retract_distance_m),
  };
  Word* slot = event_words_ + kEventsHead + (events_ - 1) % kTelemetryEvents * kEventWords;
  slot[0].store(values[0] - 1, std::memory_order_release);
  for (std::size_t i = 1; i < kEventWords; ++i)
    slot[i].store(values[i], std::memory_order_release);
  slot[0].store(values[0], std::memory_order_release);
  event_words_[0].store(events_, std::memory_order_release);
}

bool TelemetryWriter::hand(TelemetryHand& hand) const noexcept {
  if (hand_ == nullptr) return false;
  const std::uint64_t sequence = hand_[kHandSequence].load(std::memory_order_acquire);
  if (sequence == 0 || sequence % 2 != 0) return false;
  TelemetryHand found;
  found.count = hand_[kHandCount].load(std::memory_order_acquire);
  found.is_held = hand_[kHandHeld].load(std::memory_order_acquire) == 1;
  for (std::size_t i = 0; i < found.target.size(); ++i)
    found.target[i] = number_in(hand_[kHandPose + i].load(std::memory_order_acquire));
  if (hand_[kHandSequence].load(std::memory_order_acquire) != sequence) return false;
  hand = found;
  return true;
}

void TelemetryWriter::lose_events(std::uint64_t count) noexcept {
  if (count == 0) return;
  events_ += count;
  event_words_[0].store(events_, std::memory_order_release);
}

// The sequence is odd while the mesh is being written. `values` has the coordinates of all
// vertices. `hu` has one number for each vertex, or is empty.
void TelemetryWriter::write_mesh(Region& region, const MeshHead& head,
                                 std::span<const float> values, std::span<const float> hu,
                                 std::span<const std::uint32_t> triangles) noexcept {
  const std::size_t numbers = values.size() + hu.size() + triangles.size();
  const bool fits = words_for(4 * numbers) <= region.data_words;
  Word* words = region.words;
  const auto put = [words](Mesh word, std::uint64_t value) {
    words[word].store(value, std::memory_order_release);
  };
  put(kSequence, ++region.sequence);
  put(kMeshVersion, region.sequence / 2 + 1);
  put(kFlags, fits ? kIsShown | (hu.empty() ? 0 : kHasHu) : 0);
  put(kVertices, fits ? head.vertices : 0);
  put(kTriangles, fits ? triangles.size() / 3 : 0);
  put(kMeshSheet, word_of(head.sheet));
  put(kMeshCuts, head.cuts);
  put(kHeight, word_of(head.z_m));
  if (fits) {
    Packer to(words + kMeshHead);
    for (const std::span<const float> list : {values, hu}) {
      for (const float value : list)
        to.put(std::bit_cast<std::uint32_t>(value));
    }
    for (const std::uint32_t v : triangles)
      to.put(v);
    to.finish();
  }
  put(kSequence, ++region.sequence);
}

void TelemetryWriter::sheet(std::size_t index, const TelemetrySheet& sheet) noexcept {
  const std::size_t vertices = sheet.xy_m.size() / 2;
  const bool has_hu = sheet.hu.size() == vertices;
  write_mesh(sheets_[index], {vertices, static_cast<std::int32_t>(index), sheet.cuts, 0},
             sheet.xy_m, has_hu ? std::span(sheet.hu) : std::span<const float>(), sheet.triangles);
}

void TelemetryWriter::shape(const TelemetryShape& shape) noexcept {
  if (shape_.words == nullptr) return;
  write_mesh(shape_, {shape.xyw.size() / 3, shape.sheet, shape.cuts, shape.z_m}, shape.xyw, {},
             shape.triangles);
}

}  // namespace trocar
