// SPDX-License-Identifier: Apache-2.0
#include "formats/session/live_memory.h"

#include <fcntl.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <climits>
#include <cstring>
#include <system_error>
#include <utility>

namespace trocar {
namespace {

using Word = std::atomic<std::uint64_t>;
static_assert(sizeof(Word) == 8 && Word::is_always_lock_free);
static_assert(std::endian::native == std::endian::little);

// live_memory.md. Places in the header, in words.
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
  kHeaderWords = 16
};
constexpr std::uint64_t kMagicWord =
    std::bit_cast<std::uint64_t>(std::array<char, 8>{'T', 'R', 'C', 'R', 'L', 'I', 'V', 'E'});

// Words of a mesh's head, of an event, and of the events' head.
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
constexpr std::uint64_t kIsShown = 1, kHasHu = 2;
constexpr std::size_t kEventWords = 16, kEventsHead = 8;

constexpr std::size_t kPage = 4096;
constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 34;
constexpr std::uint64_t kMostAbout = std::uint64_t{1} << 24;
constexpr std::size_t kSpareBytes = std::size_t{64} << 10;
constexpr int kSeals = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL;
constexpr int kAttempts = 200;

std::string why(int error) {
  return std::generic_category().message(error);
}

constexpr std::size_t words_for(std::size_t bytes) {
  return (bytes + 7) / 8;
}
constexpr std::size_t align(std::size_t bytes, std::size_t to) {
  return (bytes + to - 1) / to * to;
}

std::uint64_t word_of(double x) {
  return std::bit_cast<std::uint64_t>(x);
}
double number_in(std::uint64_t word) {
  return std::bit_cast<double>(word);
}
/// Sign-extended.
std::uint64_t word_of(std::int32_t x) {
  return static_cast<std::uint64_t>(std::int64_t{x});
}
std::int32_t int_in(std::uint64_t word) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(word));
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

std::size_t mesh_words(std::size_t vertices, std::size_t of_vertex, std::size_t triangles) {
  return words_for(4 * (vertices * of_vertex + 3 * triangles));
}

struct flock whole_file() {
  struct flock lock {};
  lock.l_type = F_WRLCK;
  lock.l_whence = SEEK_SET;
  return lock;
}

/// The link's text; empty: not a link.
std::string read_link(const std::filesystem::path& file) {
  std::array<char, PATH_MAX> text;
  const ssize_t size = ::readlink(file.c_str(), text.data(), text.size());
  return size <= 0 ? std::string() : std::string(text.data(), static_cast<std::size_t>(size));
}

/// As link() writes it: "/proc/PID/fd/N".
bool is_ours(const std::string& target) {
  int pid = 0, fd = 0, end = 0;
  return std::sscanf(target.c_str(), "/proc/%9d/fd/%9d%n", &pid, &fd, &end) == 2 &&
         static_cast<std::size_t>(end) == target.size() && pid > 0 && fd >= 0;
}

}  // namespace

const char* to_string(LiveCommand command) {
  constexpr std::array kNames{"stop", "pause", "resume", "zero", "recover", "emergency_stop"};
  static_assert(kNames.size() == kLiveCommands);
  return kNames.at(static_cast<std::size_t>(command));
}

const char* to_string(LiveEventKind kind) {
  constexpr std::array kNames{"puncture",  "fault",  "not_recovered", "recovered",
                              "cut_shown", "paused", "resumed",       "ended"};
  static_assert(kNames.size() == static_cast<std::size_t>(LiveEventKind::kEnded));
  return kNames.at(static_cast<std::size_t>(kind) - 1);
}

const char* to_string(LiveEnd end) {
  constexpr std::array kNames{"done", "interrupted", "fault"};
  return kNames.at(static_cast<std::size_t>(end));
}

// The writer.

Result<std::unique_ptr<LiveWriter>> LiveWriter::make(const LiveSizes& sizes) {
  if (sizes.columns > kMostLiveColumns || sizes.sheets.size() > kMostLiveSheets ||
      sizes.about.size() > kMostAbout)
    return bug("live memory: too many columns or sheets, or too long a description");
  std::array<std::uint64_t, kHeaderWords> header{};
  std::size_t end = sizeof header;
  const auto place = [&](std::size_t bytes) {
    const std::size_t at = end;
    end += align(bytes, 64);
    return at;
  };
  header[kMagic] = kMagicWord;
  header[kVersion] = kLiveVersion;
  header[kAboutOffset] = place(sizes.about.size());
  header[kAboutBytes] = sizes.about.size();
  header[kSnapshotOffset] = place(8 * (1 + sizes.columns));
  header[kColumns] = sizes.columns;
  header[kDirectoryOffset] = place(16 * sizes.sheets.size());
  header[kSheets] = sizes.sheets.size();
  header[kEventsOffset] = place(8 * (kEventsHead + kLiveEvents * kEventWords));
  header[kEventSlots] = kLiveEvents;
  std::vector<std::pair<std::size_t, std::size_t>> directory;
  std::size_t shape_words = 0;
  for (const LiveSizes::Mesh& mesh : sizes.sheets) {
    const auto room = [&](std::size_t of_vertex) {
      return 2 * mesh_words(mesh.vertices, of_vertex, mesh.triangles) + kSpareBytes / 8;
    };
    directory.emplace_back(0, room(mesh.has_hu ? 3 : 2));
    directory.back().first = place(8 * (kMeshHead + directory.back().second));
    if (sizes.has_shape) shape_words = std::max(shape_words, room(3));
  }
  if (sizes.has_shape) {
    header[kShapeOffset] = place(8 * (kMeshHead + shape_words));
    header[kShapeWords] = shape_words;
  }
  end = align(end, kPage);
  header[kCommandsOffset] = place(kPage);
  header[kBytes] = end;

  std::unique_ptr<LiveWriter> writer(new LiveWriter());
  const auto failed = [&](const char* what, int error) {
    return unwritable("live memory of " + std::to_string(end) + " bytes: " + what + ": " +
                      why(error));
  };
  writer->fd_ = ::memfd_create("trocar-live", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (writer->fd_ < 0) return failed("memfd_create", errno);
  if (const int error = ::posix_fallocate(writer->fd_, 0, static_cast<off_t>(end)); error != 0)
    return failed("no room", error);
  if (::fcntl(writer->fd_, F_ADD_SEALS, kSeals) != 0) return failed("seals", errno);
  struct flock lock = whole_file();
  if (::fcntl(writer->fd_, F_OFD_SETLK, &lock) != 0) return failed("lock", errno);
  void* memory =
      ::mmap(nullptr, end, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, writer->fd_, 0);
  if (memory == MAP_FAILED) return failed("mmap", errno);
  writer->memory_ = memory;
  writer->bytes_ = end;
  // Where locking is not allowed the pages are there all the same, and may be swapped out.
  (void)::mlock(memory, end);

  const auto words_at = [&](std::size_t offset) {
    return reinterpret_cast<Word*>(static_cast<char*>(memory) + offset);
  };
  std::memcpy(static_cast<char*>(memory) + header[kAboutOffset], sizes.about.data(),
              sizes.about.size());
  writer->snapshot_ = {words_at(header[kSnapshotOffset]), sizes.columns, 0};
  writer->event_words_ = words_at(header[kEventsOffset]);
  writer->commands_ = words_at(header[kCommandsOffset]);
  if (sizes.has_shape) writer->shape_ = {words_at(header[kShapeOffset]), shape_words, 0};
  for (std::size_t i = 0; i < directory.size(); ++i) {
    const auto& [offset, words] = directory[i];
    writer->sheets_.push_back({words_at(offset), words, 0});
    words_at(header[kDirectoryOffset])[2 * i].store(offset, std::memory_order_release);
    words_at(header[kDirectoryOffset])[2 * i + 1].store(words, std::memory_order_release);
  }
  for (std::size_t i = kHeaderWords; i-- > 0;)  // the magic last
    words_at(0)[i].store(header[i], std::memory_order_release);
  return writer;
}

LiveWriter::~LiveWriter() {
  if (!link_.empty() && read_link(link_) == target_) ::unlink(link_.c_str());
  if (memory_ != nullptr) ::munmap(memory_, bytes_);
  if (fd_ >= 0) ::close(fd_);
}

Result<void> LiveWriter::link(const std::filesystem::path& file) {
  const std::string name = file.string();
  target_ = "/proc/" + std::to_string(::getpid()) + "/fd/" + std::to_string(fd_);
  std::error_code error;
  const std::filesystem::file_status old = std::filesystem::symlink_status(file, error);
  if (old.type() != std::filesystem::file_type::not_found) {
    const std::string target = read_link(file);
    if (!is_ours(target))
      return unwritable(name + ": exists and is not the link of a session; remove it");
    const auto other = LiveReader::open(file);
    if (other && (*other)->writer_is_alive())
      return unwritable(name + ": a session runs that is shown there (" + target +
                        "); end it or name another file");
    // Nothing there, or something else that has got the number of a process that has ended.
    if (!other && ::access(file.c_str(), F_OK) != 0 && errno != ENOENT)
      return unwritable(name + ": what it links to cannot be checked: " + why(errno) +
                        "; remove it if no session runs");
  }
  std::filesystem::path temporary = file;
  temporary += std::to_string(::getpid()).insert(0, 1, '.') + ".new";
  ::unlink(temporary.c_str());
  if (::symlink(target_.c_str(), temporary.c_str()) != 0)
    return unwritable(name + ": " + why(errno));
  if (::rename(temporary.c_str(), file.c_str()) != 0) {
    const int reason = errno;
    ::unlink(temporary.c_str());
    return unwritable(name + ": " + why(reason));
  }
  link_ = std::filesystem::absolute(file, error);
  return {};
}

void LiveWriter::snapshot(std::span<const double> values) noexcept {
  Word* words = snapshot_.words;
  words[0].store(++snapshot_.sequence, std::memory_order_release);
  const std::size_t count = std::min(values.size(), snapshot_.data_words);
  for (std::size_t i = 0; i < count; ++i)
    words[1 + i].store(word_of(values[i]), std::memory_order_release);
  words[0].store(++snapshot_.sequence, std::memory_order_release);
}

void LiveWriter::event(LiveEvent& event) noexcept {
  event.number = ++events_;
  const FaultDetail& found = event.found;
  const bool has_end = event.kind == LiveEventKind::kEnded;
  const std::array<std::uint64_t, kEventWords> values = {
      2 * events_,
      static_cast<std::uint64_t>(event.kind),
      word_of(event.t_s),
      word_of(event.sheet),
      word_of(event.slice),
      has_end ? static_cast<std::uint64_t>(event.end) : event.cut,
      word_of(event.tool_z_m),
      word_of(event.penetration_m),
      word_of(event.force_N),
      word_of(event.judged_force_N),
      static_cast<std::uint64_t>(found.fault),
      static_cast<std::uint64_t>(found.quantity),
      word_of(std::int32_t{found.index}),
      word_of(found.value),
      word_of(found.limit),
      word_of(event.lift_m),
  };
  Word* slot = event_words_ + kEventsHead + (events_ - 1) % kLiveEvents * kEventWords;
  slot[0].store(values[0] - 1, std::memory_order_release);
  for (std::size_t i = 1; i < kEventWords; ++i)
    slot[i].store(values[i], std::memory_order_release);
  slot[0].store(values[0], std::memory_order_release);
  event_words_[0].store(events_, std::memory_order_release);
}

void LiveWriter::lose_events(std::uint64_t count) noexcept {
  if (count == 0) return;
  events_ += count;
  event_words_[0].store(events_, std::memory_order_release);
}

void LiveWriter::sheet(std::size_t index, const LiveSheet& sheet) noexcept {
  Part& part = sheets_[index];
  const std::size_t vertices = sheet.xy_m.size() / 2, triangles = sheet.triangles.size() / 3;
  const bool has_hu = sheet.hu.size() == vertices && vertices > 0;
  const bool fits = mesh_words(vertices, has_hu ? 3 : 2, triangles) <= part.data_words;
  Word* words = part.words;
  words[kSequence].store(++part.sequence, std::memory_order_release);
  words[kMeshVersion].store(part.sequence / 2 + 1, std::memory_order_release);
  words[kFlags].store(fits ? kIsShown | (has_hu ? kHasHu : 0) : 0, std::memory_order_release);
  words[kVertices].store(fits ? vertices : 0, std::memory_order_release);
  words[kTriangles].store(fits ? triangles : 0, std::memory_order_release);
  words[kMeshSheet].store(index, std::memory_order_release);
  words[kMeshCuts].store(sheet.cuts, std::memory_order_release);
  if (fits) {
    Packer to(words + kMeshHead);
    for (std::size_t i = 0; i < 2 * vertices; ++i)
      to.put(std::bit_cast<std::uint32_t>(sheet.xy_m[i]));
    if (has_hu) {
      for (const float hu : sheet.hu)
        to.put(std::bit_cast<std::uint32_t>(hu));
    }
    for (std::size_t i = 0; i < 3 * triangles; ++i)
      to.put(sheet.triangles[i]);
    to.finish();
  }
  words[kSequence].store(++part.sequence, std::memory_order_release);
}

void LiveWriter::shape(const LiveShape& shape) noexcept {
  if (shape_.words == nullptr) return;
  const std::size_t vertices = shape.xyw.size() / 3, triangles = shape.triangles.size() / 3;
  const bool fits = mesh_words(vertices, 3, triangles) <= shape_.data_words;
  Word* words = shape_.words;
  words[kSequence].store(++shape_.sequence, std::memory_order_release);
  words[kMeshVersion].store(shape_.sequence / 2 + 1, std::memory_order_release);
  words[kFlags].store(fits ? kIsShown : 0, std::memory_order_release);
  words[kVertices].store(fits ? vertices : 0, std::memory_order_release);
  words[kTriangles].store(fits ? triangles : 0, std::memory_order_release);
  words[kMeshSheet].store(word_of(shape.sheet), std::memory_order_release);
  words[kMeshCuts].store(shape.cuts, std::memory_order_release);
  words[kHeight].store(word_of(shape.z_m), std::memory_order_release);
  if (fits) {
    Packer to(words + kMeshHead);
    for (std::size_t i = 0; i < 3 * vertices; ++i)
      to.put(std::bit_cast<std::uint32_t>(shape.xyw[i]));
    for (std::size_t i = 0; i < 3 * triangles; ++i)
      to.put(shape.triangles[i]);
    to.finish();
  }
  words[kSequence].store(++shape_.sequence, std::memory_order_release);
}

// The reader.

Result<std::unique_ptr<LiveReader>> LiveReader::open(const std::filesystem::path& file) {
  const std::string name = file.string();
  std::unique_ptr<LiveReader> reader(new LiveReader());
  reader->fd_ = ::open(file.c_str(), O_RDWR | O_CLOEXEC | O_NOCTTY | O_NONBLOCK);
  if (reader->fd_ < 0) {
    const int error = errno;
    if (error == ENOENT && is_ours(read_link(file)))
      return refused(name + ": its session has ended");
    return refused(name + ": " + why(error));
  }
  if (Result<void> mapped = reader->map(name); !mapped) return mapped.error();
  return reader;
}

LiveReader::~LiveReader() {
  if (memory_ != nullptr) ::munmap(const_cast<void*>(memory_), bytes_);
  if (command_page_ != nullptr) ::munmap(command_page_, kPage);
  if (fd_ >= 0) ::close(fd_);
}

Result<void> LiveReader::map(const std::string& name) {
  const auto no = [&](const std::string& what) {
    return refused(name + ": not the memory of a session: " + what);
  };
  struct stat status {};
  if (::fstat(fd_, &status) != 0) return no(why(errno));
  const int seals = ::fcntl(fd_, F_GET_SEALS);
  if (!S_ISREG(status.st_mode) || seals < 0) return no("not a memfd");
  if ((seals & kSeals) != kSeals) return no("it is not sealed");
  const auto size = static_cast<std::uint64_t>(status.st_size);
  if (size < 2 * kPage || size > kMostBytes || size % kPage != 0)
    return no("its size of " + std::to_string(size) + " bytes is not possible");
  void* memory = ::mmap(nullptr, size, PROT_READ, MAP_SHARED, fd_, 0);
  if (memory == MAP_FAILED) return no("mmap: " + why(errno));
  memory_ = memory;
  bytes_ = size;

  const auto words_at = [&](std::uint64_t offset) {
    return reinterpret_cast<const Word*>(static_cast<const char*>(memory) + offset);
  };
  std::array<std::uint64_t, kHeaderWords> header;
  for (std::size_t i = 0; i < kHeaderWords; ++i)
    header[i] = words_at(0)[i].load(std::memory_order_acquire);
  if (header[kMagic] != kMagicWord) return no("it does not begin with TRCRLIVE");
  if (header[kVersion] != kLiveVersion)
    return refused(name + ": is of version " + std::to_string(header[kVersion]) +
                   "; this program reads version " + std::to_string(kLiveVersion));
  if (header[kBytes] != size) return no("it has another size than it says");
  const auto is_inside = [&](std::uint64_t offset, std::uint64_t bytes) {
    return offset % 8 == 0 && offset >= sizeof header && offset <= size && bytes <= size - offset;
  };
  if (header[kAboutBytes] > kMostAbout || !is_inside(header[kAboutOffset], header[kAboutBytes]))
    return no("its description is not inside it");
  if (header[kColumns] > kMostLiveColumns ||
      !is_inside(header[kSnapshotOffset], 8 * (1 + header[kColumns])))
    return no("its snapshot is not inside it");
  if (header[kSheets] > kMostLiveSheets ||
      !is_inside(header[kDirectoryOffset], 16 * header[kSheets]))
    return no("its list of sheets is not inside it");
  if (header[kEventSlots] != kLiveEvents ||
      !is_inside(header[kEventsOffset], 8 * (kEventsHead + kLiveEvents * kEventWords)))
    return no("its events are not inside it");
  if (header[kCommandsOffset] % kPage != 0 || !is_inside(header[kCommandsOffset], kPage))
    return no("its commands are not inside it");
  const auto mesh_part = [&](std::uint64_t offset, std::uint64_t words, Part& part) {
    if (words > kMostBytes / 8 || !is_inside(offset, 8 * (kMeshHead + words))) return false;
    part = {words_at(offset), words};
    return true;
  };
  if (header[kShapeOffset] != 0 && !mesh_part(header[kShapeOffset], header[kShapeWords], shape_))
    return no("its shape is not inside it");
  for (std::size_t i = 0; i < header[kSheets]; ++i) {
    const Word* entry = words_at(header[kDirectoryOffset]) + 2 * i;
    const std::uint64_t offset = entry[0].load(std::memory_order_acquire);
    const std::uint64_t words = entry[1].load(std::memory_order_acquire);
    if (!mesh_part(offset, words, sheets_.emplace_back()))
      return no("sheet " + std::to_string(i) + " is not inside it");
  }
  void* page = ::mmap(nullptr, kPage, PROT_READ | PROT_WRITE, MAP_SHARED, fd_,
                      static_cast<off_t>(header[kCommandsOffset]));
  if (page == MAP_FAILED) return no("mmap: " + why(errno));
  command_page_ = page;
  commands_ = static_cast<Word*>(page);
  about_.assign(static_cast<const char*>(memory) + header[kAboutOffset], header[kAboutBytes]);
  columns_ = header[kColumns];
  snapshot_ = {words_at(header[kSnapshotOffset]), columns_};
  event_words_ = words_at(header[kEventsOffset]);
  return {};
}

bool LiveReader::snapshot(std::vector<double>& values) {
  const Word* words = snapshot_.words;
  std::vector<double> found(columns_);
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const std::uint64_t sequence = words[0].load(std::memory_order_acquire);
    if (sequence == seen_snapshot_) return false;
    if (sequence % 2 != 0) {
      ::sched_yield();
      continue;
    }
    for (std::size_t i = 0; i < columns_; ++i)
      found[i] = number_in(words[1 + i].load(std::memory_order_acquire));
    if (words[0].load(std::memory_order_acquire) != sequence) continue;
    seen_snapshot_ = sequence;
    values = std::move(found);
    return true;
  }
  return false;
}

std::uint64_t LiveReader::last_event() const noexcept {
  return event_words_[0].load(std::memory_order_acquire);
}

LiveReader::Next LiveReader::next_event(LiveEvent& event, std::uint64_t& lost) {
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
    return lose_to(newest > kLiveEvents ? std::max(number + 1, newest - kLiveEvents + 2)
                                        : number + 1);
  };
  if (last - number >= kLiveEvents) return lapped(last);
  const Word* slot = event_words_ + kEventsHead + (number - 1) % kLiveEvents * kEventWords;
  std::array<std::uint64_t, kEventWords> values;
  for (std::size_t i = 0; i < kEventWords; ++i)
    values[i] = slot[i].load(std::memory_order_acquire);
  if (values[0] != 2 * number || slot[0].load(std::memory_order_acquire) != 2 * number)
    return lapped(last_event());
  const auto kind = static_cast<LiveEventKind>(values[1]);
  LiveEvent found;
  found.number = number;
  found.kind = kind;
  found.t_s = number_in(values[2]);
  found.sheet = int_in(values[3]);
  found.slice = int_in(values[4]);
  const bool has_end = kind == LiveEventKind::kEnded;
  if (has_end) {
    found.end = static_cast<LiveEnd>(values[5]);
  } else {
    found.cut = static_cast<std::uint32_t>(values[5]);
  }
  found.tool_z_m = number_in(values[6]);
  found.penetration_m = number_in(values[7]);
  found.force_N = number_in(values[8]);
  found.judged_force_N = number_in(values[9]);
  const auto index = static_cast<std::int64_t>(values[12]);
  const bool is_possible =
      values[1] >= 1 && values[1] <= static_cast<std::uint64_t>(LiveEventKind::kEnded) &&
      (!has_end || values[5] <= static_cast<std::uint64_t>(LiveEnd::kFault)) &&
      values[10] < kFaults && values[11] < kFaultQuantities && index >= -1 && index < 16;
  if (!is_possible) return lose_to(number + 1);
  found.found = FaultDetail(static_cast<Fault>(values[10]), static_cast<FaultQuantity>(values[11]),
                            static_cast<int>(index), number_in(values[13]), number_in(values[14]));
  found.lift_m = number_in(values[15]);
  if (!is_known(found.found)) return lose_to(number + 1);
  event = found;
  next_event_ = number + 1;
  return Next::kEvent;
}

std::uint64_t LiveReader::sheet_version(std::size_t index) const noexcept {
  if (index >= sheets_.size()) return 0;
  return sheets_[index].words[kSequence].load(std::memory_order_acquire) / 2;
}

std::uint64_t LiveReader::shape_version() const noexcept {
  if (shape_.words == nullptr) return 0;
  return shape_.words[kSequence].load(std::memory_order_acquire) / 2;
}

bool LiveReader::read_mesh(const Part& part, std::size_t of_vertex, bool may_have_hu,
                           MeshCopy& mesh) {
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const std::uint64_t sequence = part.words[kSequence].load(std::memory_order_acquire);
    if (sequence == 0) return false;
    if (sequence % 2 != 0) {
      ::sched_yield();
      continue;
    }
    for (std::size_t i = 0; i < kMeshHead; ++i)
      mesh.head[i] = part.words[i].load(std::memory_order_acquire);
    const std::uint64_t vertices = mesh.head[kVertices], triangles = mesh.head[kTriangles];
    const bool has_hu = may_have_hu && (mesh.head[kFlags] & kHasHu) != 0;
    const std::size_t numbers = of_vertex + (has_hu ? 1 : 0);
    const std::uint64_t most = 2 * part.data_words;  // values of 32 bits
    const bool fits = vertices <= most / numbers && triangles <= most / 3 &&
                      vertices * numbers + 3 * triangles <= most;
    if (fits) {
      mesh.values.resize(vertices * numbers + 3 * triangles);
      for (std::size_t i = 0; i < mesh.values.size(); i += 2) {
        const std::uint64_t word = part.words[kMeshHead + i / 2].load(std::memory_order_acquire);
        mesh.values[i] = static_cast<std::uint32_t>(word);
        if (i + 1 < mesh.values.size())
          mesh.values[i + 1] = static_cast<std::uint32_t>(word >> 32U);
      }
    }
    if (part.words[kSequence].load(std::memory_order_acquire) != sequence) continue;
    const auto first_triangle =
        mesh.values.begin() + static_cast<std::ptrdiff_t>(fits ? vertices * numbers : 0);
    return fits && std::all_of(first_triangle, mesh.values.end(),
                               [&](std::uint32_t v) { return v < vertices; });
  }
  return false;
}

namespace {

std::vector<float> floats(std::span<const std::uint32_t> values) {
  std::vector<float> result(values.size());
  std::transform(values.begin(), values.end(), result.begin(),
                 [](std::uint32_t bits) { return std::bit_cast<float>(bits); });
  return result;
}

}  // namespace

bool LiveReader::sheet(std::size_t index, LiveSheet& sheet) {
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

bool LiveReader::shape(LiveShape& shape) {
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

bool LiveReader::writer_is_alive() const noexcept {
  struct flock lock = whole_file();
  return ::fcntl(fd_, F_OFD_GETLK, &lock) == 0 && lock.l_type != F_UNLCK;
}

void LiveReader::command(LiveCommand command) noexcept {
  commands_[static_cast<std::size_t>(command)].fetch_add(1, std::memory_order_acq_rel);
}

}  // namespace trocar
