// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/volume_file.h"

#include <fcntl.h>
#include <unistd.h>
#include <zlib.h>

#include <cerrno>
#include <cstring>
#include <memory>
#include <system_error>
#include <utility>

namespace trocar::pipeline {
namespace {

struct GzClose {
  void operator()(gzFile_s* file) const { gzclose_r(file); }
};
using GzFile = std::unique_ptr<gzFile_s, GzClose>;

// Deflate cannot pack more than 1032 to 1.
constexpr std::int64_t kDeflateLimit = 1032;

bool is_gzip(int descriptor) {
  unsigned char magic[2];
  return ::pread(descriptor, magic, 2, 0) == 2 && magic[0] == 0x1f && magic[1] == 0x8b;
}

bool write_all(int descriptor, const char* from, std::size_t bytes) {
  while (bytes > 0) {
    const ssize_t n = ::write(descriptor, from, bytes);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    from += n;
    bytes -= static_cast<std::size_t>(n);
  }
  return true;
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
    return refused(for_file.string() + ": no temporary file in " + folder.string() +
                   " for its voxels (" + std::generic_category().message(errno) + "); set TMPDIR");
  return descriptor;
}

}  // namespace

Result<std::vector<std::uint8_t>> VolumeFile::head(const std::filesystem::path& file,
                                                   std::size_t bytes) {
  const GzFile in(gzopen(file.c_str(), "rbe"));  // plain files pass through
  if (!in) return refused(file.string() + ": " + std::generic_category().message(errno));
  std::vector<std::uint8_t> out(bytes);
  const int n = gzread(in.get(), out.data(), static_cast<unsigned>(bytes));
  if (n < 0) return refused(file.string() + ": damaged gzip");
  out.resize(static_cast<std::size_t>(n));
  return out;
}

Result<VolumeFile> VolumeFile::open(const std::filesystem::path& file, std::int64_t start,
                                    std::int64_t size) {
  const std::string name = file.string();
  VolumeFile packed;
  packed.descriptor_ = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (packed.descriptor_ < 0) return refused(name + ": cannot be opened");
  packed.start_ = start;
  const std::int64_t on_disk = ::lseek(packed.descriptor_, 0, SEEK_END);
  const auto truncated = [&](std::int64_t have) {
    return refused(name + ": truncated: its header declares voxels up to byte " +
                   std::to_string(start + size) + ", there are " + std::to_string(have));
  };
  if (!is_gzip(packed.descriptor_)) {
    if (on_disk < start + size) return truncated(on_disk);
    return packed;
  }
  if ((start + size) / kDeflateLimit > on_disk) {
    return refused(name + ": truncated: its header declares " + std::to_string(start + size) +
                   " bytes, more than " + std::to_string(on_disk) + " bytes of gzip can hold");
  }
  const GzFile in(gzopen(file.c_str(), "rbe"));
  if (!in) return refused(name + ": cannot be opened");
  gzbuffer(in.get(), 1 << 17);
  const auto out = open_nameless(file);
  if (!out) return out.error();
  VolumeFile unpacked;
  unpacked.descriptor_ = *out;
  std::vector<char> block(1 << 18);
  for (std::int64_t done = 0; done < start + size;) {
    const auto want = static_cast<unsigned>(std::min<std::int64_t>(
        static_cast<std::int64_t>(block.size()), (done < start ? start : start + size) - done));
    const int n = gzread(in.get(), block.data(), want);
    if (n < 0) return refused(name + ": damaged gzip");
    if (n == 0) return truncated(done);
    if (done >= start &&
        !write_all(unpacked.descriptor_, block.data(), static_cast<std::size_t>(n))) {
      return refused(name + ": no space for a temporary file to unpack it (" +
                     std::generic_category().message(errno) + "); set TMPDIR");
    }
    done += n;
  }
  // The checksum follows the data and is only verified when the end is read.
  if (char rest; gzread(in.get(), &rest, 1) < 0) return refused(name + ": damaged gzip");
  return unpacked;
}

Result<VolumeFile> VolumeFile::temporary(const std::filesystem::path& for_file) {
  const auto descriptor = open_nameless(for_file);
  if (!descriptor) return descriptor.error();
  VolumeFile out;
  out.descriptor_ = *descriptor;
  return out;
}

Result<void> VolumeFile::append(std::span<const char> bytes,
                                const std::filesystem::path& for_file) {
  if (write_all(descriptor_, bytes.data(), bytes.size())) return {};
  return refused(for_file.string() + ": no space for a temporary file of its voxels (" +
                 std::generic_category().message(errno) + "); set TMPDIR");
}

bool VolumeFile::read(std::int64_t at, std::span<char> to) const {
  std::size_t done = 0;
  while (done < to.size()) {
    const ssize_t n = ::pread(descriptor_, to.data() + done, to.size() - done,
                              start_ + at + static_cast<std::int64_t>(done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    done += static_cast<std::size_t>(n);
  }
  return true;
}

VolumeFile::VolumeFile(VolumeFile&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)), start_(other.start_) {}

VolumeFile& VolumeFile::operator=(VolumeFile&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(start_, other.start_);
  return *this;
}

VolumeFile::~VolumeFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

}  // namespace trocar::pipeline
