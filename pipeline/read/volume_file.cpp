// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/volume_file.h"

#include <fcntl.h>
#include <isa-l/crc.h>
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <mutex>
#include <thread>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace trocar::pipeline {
namespace {

#if defined(__x86_64__)
[[gnu::target("avx")]] void clear_upper_halves() {
  _mm256_zeroupper();
}
void clear_vector_registers() {
  if (__builtin_cpu_supports("avx")) clear_upper_halves();
}
#else
void clear_vector_registers() {}
#endif

constexpr std::size_t kPackedBytes = 1 << 17;
constexpr std::array<char, 2> kMagic{'\x1f', '\x8b'};

// Deflate cannot compress by a factor of more than 1032.
constexpr std::int64_t kDeflateLimit = 1032;

Error truncated(const std::string& name, std::int64_t wanted, std::int64_t have) {
  return refused(name + ": truncated: its header declares voxels up to byte " +
                 std::to_string(wanted) + ", there are " + std::to_string(have));
}

Result<int> open_nameless(const std::filesystem::path& for_file) {
  std::error_code error;
  const std::filesystem::path folder = std::filesystem::temp_directory_path(error);
  int descriptor = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (descriptor < 0) {  // not every file system supports O_TMPFILE
    std::string name = (folder / "trocar-XXXXXX").string();
    descriptor = ::mkostemp(name.data(), O_CLOEXEC);
    if (descriptor >= 0) ::unlink(name.c_str());
  }
  if (descriptor < 0)
    return refused_for_now(for_file.string() + ": no temporary file in " + folder.string() +
                           " for its voxels (" + system_message(errno) + "); set TMPDIR");
  return descriptor;
}

}  // namespace

int inflate_on(inflate_state& state) {
  const int out = isal_inflate(&state);
  clear_vector_registers();
  return out;
}

std::uint32_t gzip_checksum(std::span<const std::uint8_t> bytes) {
  const std::uint32_t out = crc32_gzip_refl(0, bytes.data(), bytes.size());
  clear_vector_registers();
  return out;
}

bool GzipReader::is_gzip(int descriptor, std::int64_t from) {
  std::array<char, 2> magic{};
  return read_at(descriptor, from, magic) == magic.size() && magic == kMagic;
}

GzipReader::GzipReader(int descriptor, std::string name, std::int64_t from)
    : descriptor_(descriptor),
      name_(std::move(name)),
      at_(from),
      packed_(kPackedBytes),
      state_(std::make_unique<inflate_state>()) {
  isal_inflate_init(state_.get());
  state_->crc_flag = ISAL_GZIP;
}

// Reads more packed bytes behind those that are left. False if the file has no more bytes.
bool GzipReader::fill() {
  inflate_state& s = *state_;
  std::copy_n(s.next_in, s.avail_in, packed_.begin());  // downwards, if they overlap
  const std::size_t n = read_at(descriptor_, at_, std::span(packed_).subspan(s.avail_in));
  at_ += static_cast<std::int64_t>(n);
  s.next_in = reinterpret_cast<std::uint8_t*>(packed_.data());
  s.avail_in += static_cast<std::uint32_t>(n);
  return n > 0;
}

// Begins the next member, or sets `ended_` if there is none.
Result<void> GzipReader::begin_member() {
  inflate_state& s = *state_;
  // ISA-L has given back the bytes that it had read beyond the member.
  while (s.avail_in < kMagic.size() && fill()) {
  }
  if (s.avail_in >= kMagic.size() && std::memcmp(kMagic.data(), s.next_in, kMagic.size()) == 0) {
    isal_inflate_reset(&s);
    s.crc_flag = ISAL_GZIP;
    return {};
  }
  do {
    if (std::any_of(s.next_in, s.next_in + s.avail_in, [](std::uint8_t b) { return b != 0; }))
      return refused(name_ + ": damaged gzip: other bytes follow its end");
    s.avail_in = 0;
  } while (fill());
  ended_ = true;
  return {};
}

Result<std::size_t> GzipReader::read(std::span<char> to) {
  inflate_state& s = *state_;
  s.next_out = reinterpret_cast<std::uint8_t*>(to.data());
  s.avail_out = static_cast<std::uint32_t>(to.size());
  while (s.avail_out > 0 && !ended_) {
    if (s.block_state == ISAL_BLOCK_FINISH) {
      if (const auto ok = begin_member(); !ok) return ok.error();
      if (ended_) break;
    }
    const std::uint32_t in_before = s.avail_in, out_before = s.avail_out;
    if (inflate_on(s) < 0) return refused(name_ + ": damaged gzip");
    if (s.block_state == ISAL_BLOCK_FINISH || s.avail_out != out_before) continue;
    if (s.avail_in == 0 && fill()) continue;
    is_truncated_ = s.avail_in == 0;
    if (is_truncated_ && s.avail_out < to.size()) break;  // the error follows at the next call
    if (is_truncated_) return refused(name_ + ": truncated: its gzip data end early");
    if (s.avail_in == in_before) return refused(name_ + ": damaged gzip");
  }
  return to.size() - s.avail_out;
}

// Unpacks on its thread; readers wait for the bytes that they need.
class VolumeFile::Unpacking {
 public:
  Unpacking(FileDescriptor from, std::int64_t from_at, int to, std::string name, std::int64_t start,
            std::int64_t size, std::int64_t whole)
      : from_(std::move(from)),
        from_at_(from_at),
        to_(to),
        name_(std::move(name)),
        start_(start),
        size_(size),
        whole_(whole) {
    thread_ = std::thread([this] {
      auto outcome = unpack();
      const std::lock_guard lock(mutex_);
      outcome_ = std::move(outcome);
      changed_.notify_all();
    });
  }
  ~Unpacking() {
    stopped_.store(true);
    thread_.join();
  }
  Unpacking(const Unpacking&) = delete;
  Unpacking& operator=(const Unpacking&) = delete;

  /// Waits until `bytes` bytes are unpacked, or until there will be no more.
  Result<void> wait_for(std::int64_t bytes) {
    const auto start = std::chrono::steady_clock::now();
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return done_ >= bytes || outcome_; });
    waited_ += std::chrono::steady_clock::now() - start;
    if (done_ >= bytes) return {};
    return *outcome_;
  }
  Result<void> finish() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return outcome_.has_value(); });
    return *outcome_;
  }
  double waited_ms() {
    const std::lock_guard lock(mutex_);
    return std::chrono::duration<double, std::milli>(waited_).count();
  }

 private:
  Result<void> unpack() {
    GzipReader in(from_.get(), name_, from_at_);
    std::vector<char> block(1 << 18);
    // Checksums are verified only when the end is read, so what follows is unpacked, too.
    for (std::int64_t done = 0; !stopped_.load();) {
      const std::int64_t end = start_ + size_;
      const std::int64_t wanted = (done < start_ ? start_ : done < end ? end : whole_ + 1) - done;
      if (wanted <= 0) break;
      const auto n = in.read(std::span(block).first(static_cast<std::size_t>(
          std::min<std::int64_t>(static_cast<std::int64_t>(block.size()), wanted))));
      if (!n && !(in.is_truncated() && done < end)) return n.error();
      if (done < end && (!n || *n == 0)) return truncated(name_, end, done);
      if (*n == 0) break;
      if (done >= start_ && done < end && !write_all(to_, std::span(block).first(*n))) {
        return refused_for_now(name_ + ": no space for a temporary file to unpack it (" +
                               system_message(errno) + "); set TMPDIR");
      }
      done += static_cast<std::int64_t>(*n);
      const std::lock_guard lock(mutex_);
      done_ = std::min(done, end) - start_;
      changed_.notify_all();
    }
    return {};
  }

  FileDescriptor from_;
  std::int64_t from_at_;
  int to_;  // descriptor of the VolumeFile
  std::string name_;
  std::int64_t start_, size_, whole_;
  std::atomic<bool> stopped_{false};
  std::mutex mutex_;
  std::condition_variable changed_;
  std::int64_t done_ = 0;  // number of unpacked bytes
  std::chrono::steady_clock::duration waited_{};
  std::optional<Result<void>> outcome_;
  std::thread thread_;
};

Result<std::vector<std::uint8_t>> VolumeFile::head(const std::filesystem::path& file,
                                                   std::size_t bytes) {
  const FileDescriptor in(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  if (in.get() < 0) return refused_by_system(file.string(), errno);
  std::vector<std::uint8_t> out(bytes);
  const std::span<char> to(reinterpret_cast<char*>(out.data()), bytes);
  if (GzipReader::is_gzip(in.get())) {
    const auto n = GzipReader(in.get(), file.string()).read(to);
    if (!n) return n.error();
    out.resize(*n);
    return out;
  }
  out.resize(read_at(in.get(), 0, to));
  return out;
}

Result<VolumeFile> VolumeFile::open(const std::filesystem::path& file, std::int64_t start,
                                    std::int64_t size, bool behind, std::int64_t whole) {
  const FileDescriptor in(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  const bool is_gzip = in.get() >= 0 && GzipReader::is_gzip(in.get());
  return open_part(file, 0, is_gzip, start, size, behind, whole);
}

Result<VolumeFile> VolumeFile::open_part(const std::filesystem::path& file, std::int64_t from,
                                         bool is_gzip, std::int64_t start, std::int64_t size,
                                         bool behind, std::int64_t whole) {
  const std::string name = file.string();
  VolumeFile packed;
  packed.descriptor_ = FileDescriptor(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  if (packed.descriptor_.get() < 0) return refused_by_system(name, errno);
  packed.start_ = from + start;
  const std::int64_t on_disk = ::lseek(packed.descriptor_.get(), 0, SEEK_END) - from;
  if (!is_gzip) {
    if (on_disk < start + size) return truncated(name, start + size, on_disk);
    return packed;
  }
  if (!GzipReader::is_gzip(packed.descriptor_.get(), from))
    return refused(name + ": its data are not packed by gzip as its header says");
  if ((start + size) / kDeflateLimit > on_disk) {
    return refused(name + ": truncated: its header declares " + std::to_string(start + size) +
                   " bytes, more than " + std::to_string(on_disk) + " bytes of gzip can hold");
  }
  const auto out = open_nameless(file);
  if (!out) return out.error();
  VolumeFile unpacked;
  unpacked.descriptor_ = FileDescriptor(*out);
  unpacked.unpacking_ = std::make_unique<Unpacking>(std::move(packed.descriptor_), from, *out, name,
                                                    start, size, std::max(whole, start + size));
  if (behind) return unpacked;
  if (const auto ok = unpacked.finish(); !ok) return ok.error();
  return unpacked;
}

Result<VolumeFile> VolumeFile::temporary(const std::filesystem::path& for_file) {
  const auto descriptor = open_nameless(for_file);
  if (!descriptor) return descriptor.error();
  VolumeFile out;
  out.descriptor_ = FileDescriptor(*descriptor);
  return out;
}

Result<void> VolumeFile::append(std::span<const char> bytes,
                                const std::filesystem::path& for_file) {
  if (write_all(descriptor_.get(), bytes)) return {};
  return refused_for_now(for_file.string() + ": no space for a temporary file of its voxels (" +
                         system_message(errno) + "); set TMPDIR");
}

Result<void> VolumeFile::read(std::int64_t at, std::span<char> to, const std::string& name) const {
  if (unpacking_ != nullptr) {
    if (auto ok = unpacking_->wait_for(at + static_cast<std::int64_t>(to.size())); !ok) return ok;
  }
  if (read_at(descriptor_.get(), start_ + at, to) == to.size()) return {};
  return refused_for_now(name + ": the file has become shorter");
}

Result<void> VolumeFile::finish() const {
  return unpacking_ == nullptr ? Result<void>() : unpacking_->finish();
}

double VolumeFile::waited_ms() const {
  return unpacking_ == nullptr ? 0 : unpacking_->waited_ms();
}

VolumeFile::VolumeFile() = default;
VolumeFile::VolumeFile(VolumeFile&& other) noexcept = default;
VolumeFile& VolumeFile::operator=(VolumeFile&& other) noexcept = default;
VolumeFile::~VolumeFile() = default;

}  // namespace trocar::pipeline
