// SPDX-License-Identifier: Apache-2.0
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "formats/base/system_message.h"
#include "formats/session/telemetry.h"
#include "formats/session/telemetry_layout.h"

namespace trocar {

using namespace telemetry_layout;  // NOLINT(google-build-using-namespace): its own layout

namespace {

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
    if (is_second_) {
      to_++->store(low_ | std::uint64_t{value} << 32U, std::memory_order_release);
    } else {
      low_ = value;
    }
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
