// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include "formats/base/system_message.h"
#include "formats/session/telemetry.h"
#include "formats/session/telemetry_layout.h"

namespace trocar {

using namespace telemetry_layout;  // NOLINT(google-build-using-namespace): its own layout

namespace {

// A reader gives up after this many attempts to read a value that is being written.
constexpr int kAttempts = 200;

std::vector<float> floats(std::span<const std::uint32_t> values) {
  std::vector<float> result(values.size());
  std::transform(values.begin(), values.end(), result.begin(),
                 [](std::uint32_t bits) { return std::bit_cast<float>(bits); });
  return result;
}

}  // namespace

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
  TelemetryEvent found;
  found.number = number;
  found.kind = kind;
  found.t_s = number_in(values[2]);
  found.sheet = int_in(values[3]);
  found.slice = int_in(values[4]);
  const bool has_end = kind == TelemetryEventKind::kEnded;
  if (has_end) {
    found.end = static_cast<TelemetryEnd>(values[5]);
  } else {
    found.cut = static_cast<std::uint32_t>(values[5]);
  }
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

}  // namespace trocar
